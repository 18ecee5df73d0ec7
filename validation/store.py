"""Figures of runs, kept in one JSON file as they come: what is there is not computed again."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from taichi_foam.simulation.progress import Bars

Smoke = Annotated[
    bool,
    typer.Option(
        "--smoke", help="Only see whether everything still works, in seconds; write nothing."
    ),
]
Fresh = Annotated[bool, typer.Option("--fresh", help="Forget all that the parts kept.")]
Compute = Annotated[bool, typer.Option(help="Compute what is missing, or only write.")]
Out = Annotated[Path, typer.Option(help="Where the page goes.")]
Figures = Annotated[Path, typer.Option(help="Where the pictures go.")]


@dataclass
class Store:
    """Figures by part and by the run's name; written after every run."""

    path: Path
    kept: dict[str, dict[str, Any]] = field(default_factory=dict)

    @classmethod
    def open(cls, path: Path) -> Store:
        """Read what earlier calls left, if anything."""
        kept = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        return cls(path, kept)

    def part(self, part: str) -> dict[str, Any]:
        """What there is of one part, by the run's name."""
        return self.kept.setdefault(part, {})

    def forget(self, part: str) -> None:
        """Drop one part, so that it is computed afresh."""
        self.kept.pop(part, None)

    def keep(self, part: str, name: str, figures: Any) -> None:
        """Take the figures of a run that has ended."""
        self.part(part)[name] = figures
        self.path.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps(self.kept, indent=None, separators=(",", ":"), sort_keys=True)
        # Written aside and then renamed: Ctrl-C in between leaves the old file whole.
        scratch = self.path.with_name(f"{self.path.name}.new")
        scratch.write_text(text + "\n", encoding="utf-8")
        scratch.replace(self.path)


def computed(store: Store, parts: Mapping[str, Callable[[], object]], fresh: bool) -> bool:
    """Compute parts of a study, one after the other, and whether all have ended.

    With `fresh` what a part kept is dropped before. Ctrl-C ends it; what has come is kept.
    """
    try:
        for part, compute in parts.items():
            if fresh:
                store.forget(part)
            compute()
    except KeyboardInterrupt:
        return False
    return True


def leave(bars: Bars, out: Path, whole: bool) -> NoReturn:
    """Say where the page is, and exit: 130 after Ctrl-C."""
    bars.say(f"written to {out}" + ("" if whole else ", interrupted"))
    raise typer.Exit(0 if whole else 130)


def chosen(parts: str | None, known: Collection[str]) -> list[str]:
    """Parts of a study given as "shock,waves", or all that it knows.

    Raises:
        typer.BadParameter: a part that it does not know.
    """
    wanted = [part.strip() for part in parts.split(",")] if parts else list(known)
    unknown = [part for part in wanted if part not in known]
    if unknown:
        raise typer.BadParameter(
            f"no such part: {', '.join(unknown)}; choose from {', '.join(known)}"
        )
    return wanted
