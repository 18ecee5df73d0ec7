"""Notebook display of scenes and results: a picture, key figures, and a small film.

The formatters are registered with IPython here, so that results do not depend on pictures.
"""

from __future__ import annotations

import html
import io
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taichi_foam.records.ending import Ending

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from taichi_foam.results.result import Result
    from taichi_foam.scene import Scene

#: Widths of montage and film [pixels].
MONTAGE, FILM = 1200, 640
#: Largest number of frames of a film in a notebook, since the film is stored in its file.
MOST_FRAMES = 150


def install() -> None:
    """Register with the IPython of this process, if there is one. Imports nothing heavy."""
    from IPython.core.getipython import get_ipython

    shell = get_ipython()
    if shell is None or shell.display_formatter is None:
        return
    # the formatters of a shell are a trait, which type checkers see as `object`
    formatter: Any = getattr(shell.display_formatter, "formatters")["text/html"]  # noqa: B009
    formatter.for_type_by_name("taichi_foam.results.result", "Result", result_html)
    formatter.for_type_by_name("taichi_foam.scene.scene", "Scene", scene_html)


def result_html(result: Result) -> str:
    """A run as self-contained HTML: instants, key figures, and the film."""
    from taichi_foam.catalogue import title
    from taichi_foam.picture.montage import montage

    figures = _figures(result.scene, result.summary)
    if result.ending is Ending.INTERRUPTED:
        figures = "<p>interrupted: these are the results up to that point</p>" + figures
    if not result.snapshots:
        return figures
    picture = _picture(
        montage(result.snapshots, result.scene, width=MONTAGE, title=title(result.scene))
    )
    return picture + _side_by_side(f"<div>{figures}</div>", _film(result))


def scene_html(scene: Scene) -> str:
    """A scene as HTML: its first instant, its impactor, and all values that are not defaults."""
    from taichi_foam.catalogue import title
    from taichi_foam.engine.state import initial_state
    from taichi_foam.picture import raster

    size = (FILM, FILM * 9 // 16)
    start = initial_state(scene).snapshot()
    picture = raster.frame(start, scene, size, title=title(scene))
    return _side_by_side(_picture(picture), _table(("", "value", ""), _given(scene)))


def _side_by_side(*parts: str) -> str:
    style = "display:flex;flex-wrap:wrap;gap:1.5em;align-items:flex-start"
    return f'<div style="{style}">{"".join(parts)}</div>'


def _given(scene: Scene) -> list[tuple[str, ...]]:
    """Key, value and meaning of all values of the impactor, and of others that are not defaults."""
    from taichi_foam.parts import Part, described
    from taichi_foam.scene import Numerics, Scene

    plain = Scene(numerics=Numerics(end=1.0))
    found = []
    for name in type(scene).model_fields:
        part, default = getattr(scene, name), getattr(plain, name)
        fields = type(part).model_fields if isinstance(part, Part) and name != "reference" else {}
        for key, field in fields.items():
            value = getattr(part, key)
            # another law or shape has keys that the default one lacks
            if name == "impactor" or value != getattr(default, key, field.default):
                shown = f"{value:g}" if isinstance(value, float) else str(value)
                found.append((f"{name}.{key}", shown, described(field)))
    return found


def _figures(scene: Scene, summary: dict[str, Any]) -> str:
    """The key figures, measured values where there are any, and the statement and warnings."""
    from taichi_foam.analysis.measures import shown_in
    from taichi_foam.catalogue import reference_of

    reference = reference_of(scene)
    known = reference.figures if reference else {}
    rows = []
    for quantity in shown_in("cell"):
        value, measured = summary[quantity.key], known.get(quantity.key)
        if value is None and measured is None:
            continue
        row = [f"{quantity.label} ({quantity.unit})", quantity.text(value)]
        if known:
            row.append("" if measured is None else quantity.text(measured))
        rows.append(tuple(row))
    table = _table(("", "simulated", "measured") if known else ("", "simulated"), rows)
    said = [summary["statement"] or "", *(f"warning: {text}" for text in summary["warnings"])]
    told = "".join(f"<p>{html.escape(text)}</p>" for text in said if text)
    return table + told + _folded(summary["assumed"])


def _folded(assumed: list[str]) -> str:
    """Assumed values of the foam, as a line that unfolds."""
    if not assumed:
        return ""
    lines = "<br>".join(map(html.escape, assumed))
    return (
        f"<details><summary>assumed values of the foam: {len(assumed)}</summary>{lines}</details>"
    )


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """A table; columns without a header hold text, the others numbers."""
    plain = [k for k, words in enumerate(head) if not words]

    def line(tag: str, cells: tuple[str, ...]) -> str:
        sides = ("left" if k in plain else "right" for k in range(len(cells)))
        return "<tr>{}</tr>".format(
            "".join(
                f'<{tag} style="padding:.1em .6em;text-align:{side}">{html.escape(text)}</{tag}>'
                for side, text in zip(sides, cells, strict=True)
            )
        )

    body = "".join(line("td", row) for row in rows)
    return f"<table><thead>{line('th', head)}</thead><tbody>{body}</tbody></table>"


def _picture(image: NDArray) -> str:
    from PIL import Image

    from taichi_foam.picture.document import data_address

    file = io.BytesIO()
    # There are few colours: a palette halves the size in the notebook's file.
    Image.fromarray(image).quantize(192).save(file, "PNG", optimize=True)
    return f'<img style="max-width:100%" src="{data_address("image/png", file.getvalue())}">'


def _film(result: Result) -> str:
    """The run as a film that plays in the page; the last picture is held."""
    from taichi_foam.catalogue import title
    from taichi_foam.picture import films
    from taichi_foam.picture.document import data_address

    scene = result.scene
    every = -(-len(result.snapshots) // MOST_FRAMES)
    width, height = films.scaled(scene.output.width, scene.output.height, FILM)
    asked = {"width": width, "height": height, "curve": False}
    output = scene.output.model_copy(update=asked)
    small = replace(
        result,
        scene=scene.model_copy(update={"output": output}),
        snapshots=result.snapshots[::every],
    )
    reel, names = films.Reel.of(small, title(scene)), films.Names(mp4="film.mp4")
    with tempfile.TemporaryDirectory() as folder:
        (path,) = reel.write(Path(folder), names=names)
        data = data_address("video/mp4", path.read_bytes())
    return f'<video controls muted loop autoplay width="{width}" src="{data}"></video>'
