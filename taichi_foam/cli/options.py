"""Options shared by several commands.

These modules load with the command line, for help and for completion. A command imports the modules
that compute or draw when it runs.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Annotated, Any, get_args, get_type_hints

import typer

from taichi_foam import choices


def _scenes_begun(word: str) -> list[tuple[str, str]]:
    """Built-in scenes that start with `word`, with descriptions; the shell completes files."""
    from taichi_foam.catalogue import list_scenes

    return [(name, about) for name, about in list_scenes().items() if name.startswith(word)]


# for commands that compute
SceneName = Annotated[
    str,
    typer.Argument(metavar="SCENE", help="Built-in name or file.", autocompletion=_scenes_begun),
]
Out = Annotated[str | None, typer.Option(help="Folder for the result; default: runs/NAME.")]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Set one value, e.g. block.rows=40; repeatable."
    ),
]
Choices = Annotated[
    str | None,
    typer.Option(
        metavar="|".join(choices.CHOICE_SETS),
        help="Model choices: a named set of options for what the paper leaves open.",
    ),
]
Dt = Annotated[str | None, typer.Option(metavar="auto|SECONDS", help="Time step.")]
Arch = Annotated[str, typer.Option(metavar="cpu|cuda|vulkan|metal", help="Device to compute on.")]
Threads = Annotated[int | None, typer.Option(help="CPU threads; default: all cores.")]
Tests = Annotated[
    str | None,
    typer.Option(
        metavar="FILE.csv",
        help="Own cushion tests, to compare: height, thickness, static stress, peak, with units in "
        "the header.",
    ),
]
Units = Annotated[
    str, typer.Option(metavar="si|us", help="Units of the options and of the answer.")
]
Checkpoint = Annotated[
    float | None,
    typer.Option(
        metavar="SECONDS",
        help="Wall time between checkpoints, from which `resume` continues; default: 60; inf: "
        "only when the run is interrupted.",
    ),
]
After = Annotated[
    str | None,
    typer.Option(
        metavar="RUN_DIR",
        help="Start on the block as that run left it; the impactor is raised above it.",
    ),
]
Drops = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        help="Drop the impactor N times on the same block; writes a folder for each drop, and a "
        "table.",
    ),
]
Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Replace the result that the folder holds.")
]
NoFilm = Annotated[bool, typer.Option("--no-film", help="Write no GIF or MP4.")]
Frames = Annotated[bool, typer.Option("--frames", help="Write every frame as a PNG.")]
Live = Annotated[
    bool,
    typer.Option("--live", help="Watch the run in a window while it computes; H lists the keys."),
]

# for commands that draw stored runs
Mode = Annotated[
    str | None,
    typer.Option(
        metavar="|".join(get_args(choices.Mode)),
        help="What the colours show; default: as set in the run.",
    ),
]
Theme = Annotated[
    str | None,
    typer.Option(
        metavar="|".join(get_args(choices.Theme)), help="Colour theme; default: as set in the run."
    ),
]
Size = Annotated[
    str | None,
    typer.Option(
        metavar="WIDTHxHEIGHT",
        help="Size of frames in pixels, both even; for a PNG only the width counts. Frames below "
        "512x288 (runs side by side: 640x360) have no text.",
    ),
]
Fps = Annotated[int | None, typer.Option(help="Frames per second of a film.")]
Gif = Annotated[bool, typer.Option("--gif", help="Write a GIF.")]
Mp4 = Annotated[bool, typer.Option("--mp4", help="Write an MP4.")]
OverwriteFiles = Annotated[bool, typer.Option("--overwrite", help="Replace existing files.")]


@dataclass(frozen=True)
class RunRequest:
    """A request for a run, apart from its scene: the options of `run` and of scripts."""

    out: Out = None
    set_: Set = None
    choices: Choices = None
    dt: Dt = None
    arch: Arch = "cpu"
    threads: Threads = None
    overwrite: Overwrite = False
    no_film: NoFilm = False
    frames: Frames = False
    live: Live = False
    checkpoint: Checkpoint = None
    after: After = None
    drops: Drops = None

    @property
    def overrides(self) -> list[str]:
        """The options' changes to the scene; --set comes last and overrides the others."""
        films = ["output.film=false"] if self.no_film else []
        frames = ["output.frames=true"] if self.frames else []
        return [*overrides_of(self.dt), *films, *frames, *(self.set_ or [])]


def overrides_of(dt: str | None, set_: list[str] | None = None) -> list[str]:
    """--dt and --set as scene overrides."""
    return [*([] if dt is None else [f"numerics.dt={dt}"]), *(set_ or [])]


def spread(act: Callable[..., None]) -> Callable[..., None]:
    """`act` as a command, with its last parameter, a request, replaced by the request's fields."""
    *first, last = inspect.signature(act, eval_str=True).parameters.values()
    request = last.annotation
    hints = get_type_hints(request, include_extras=True)
    options = [
        inspect.Parameter(
            field.name, last.kind, default=field.default, annotation=hints[field.name]
        )
        for field in fields(request)
    ]

    @functools.wraps(act)
    def command(**given: Any) -> None:
        ahead = [given.pop(each.name) for each in first]
        act(*ahead, request(**given))

    taken = [*first, *options]
    command.__signature__ = inspect.Signature(taken)  # type: ignore[attr-defined]
    command.__annotations__ = {each.name: each.annotation for each in taken}
    return command
