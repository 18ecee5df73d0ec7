"""Scenes in and out: built-in names, TOML files, Python scripts; choice sets and overrides.

Also the data known about a scene: the values measured in its impact (`reference_of`), and its
display name (`caption`). Both come from the scene's own reference if it has one, else from the
scenes in the package: results of an older version and scenes written by hand have no reference.
"""

from __future__ import annotations

import ast
import difflib
import os
import runpy
import traceback
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from taichi_foam.analysis.measures import MEASURES
from taichi_foam.errors import UserError
from taichi_foam.laws.bond import FOAMS
from taichi_foam.picture.naming import Caption
from taichi_foam.scene import CHOICE_SETS, Scene
from taichi_foam.scene.assumed import KEPT, READINGS
from taichi_foam.scene.files import read_scene
from taichi_foam.scene.messages import explain, shown, titled
from taichi_foam.scene.paths import NOTHING, at, heads_of_foams
from taichi_foam.scene.reference import Reference
from taichi_foam.scene.toml import read_toml
from taichi_foam.scene.values import changed, settings

_LONGEST_NAME = 1_000

# Keys of a foam that select how the model treats it; the others are its constants.
_FOAM_READINGS = frozenset({"softening"})
_NO_CONSTANTS = _FOAM_READINGS | READINGS | KEPT | {"law", "source"}


def load_scene(
    source: str | Path | Scene,
    choices: str | None = None,
    overrides: Mapping[str, Any] | Sequence[str] = (),
) -> Scene:
    """Load a scene and apply a choice set, then single values.

    Args:
        source: built-in name ("paper/wedge-2.86", "gallery/wave-bar"), a TOML file, a Python
            script that defines `scene`, or a scene itself. A script's
            `if __name__ == "__main__"` part does not run.
        choices: key of `CHOICE_SETS`; None keeps the scene's own.
        overrides: values by dotted key, as for `Scene.with_values`; or texts as on the command
            line, see `scene.values.settings`.

    Raises:
        UserError: the source does not exist or cannot be read, or the scene is invalid.
    """
    if choices is not None and choices not in CHOICE_SETS:
        raise UserError(f"choices = {shown(choices)}: must be one of {', '.join(CHOICE_SETS)}")
    data = source if isinstance(source, Scene) else _read(source)
    values = settings(overrides)
    if isinstance(data, Scene):
        if choices is None and not values:
            return data
        data = data.given_data()
    title = source.name if isinstance(source, Scene) else str(source)
    if choices is not None:
        data = changed(data, dict(_chosen(data, choices)))
    if values and "reference" in data:  # the reference belongs to the unchanged impact
        data = Scene.checked(data, title).given_data()
    return Scene.checked(changed(data, values), title)


def _chosen(data: Mapping[str, Any], choices: str) -> Iterator[tuple[str, Any]]:
    """Yield the keys and values that a choice set changes in a scene, including foams of layers.

    A user's block keeps its lattice, and a user's foam keeps its constants. Values that follow from
    the scene's reference come last.
    """
    for key, value in CHOICE_SETS[choices].items():
        field = key.partition(".")[2]
        if key.startswith("foam."):
            for head in heads_of_foams(data):
                foam = at(data, f"{head}foam")
                own = _is_own(foam)
                law = FOAMS.kind_of({} if foam in (None, NOTHING) else foam)
                # another law may lack fields of the paper's law
                known = law is None or field in law.model_fields
                if known and not (own and field not in _FOAM_READINGS):
                    yield head + key, value
        elif key.startswith("block."):
            if not data.get("block"):
                yield key, value
        elif data.get("impactor") is not None or not key.startswith("impactor."):
            yield key, value
    readings = at(data, "reference.readings")
    own = readings.get(choices) if isinstance(readings, Mapping) else None
    yield from own.items() if isinstance(own, Mapping) else ()


def _is_own(foam: Any) -> bool:
    """Whether a foam's raw data has constants that no choice set has: not the paper's foam."""
    if foam in (None, NOTHING):
        return False
    if not isinstance(foam, Mapping):
        return True  # a name, a file, a law's own object
    return any(
        key not in _NO_CONSTANTS
        and value is not None
        and value not in [choices.get(f"foam.{key}") for choices in CHOICE_SETS.values()]
        for key, value in foam.items()
    )


def list_scenes() -> dict[str, str]:
    """Return names and one-line descriptions of built-in scenes, those with references first."""
    files, first = _built_in(), list(references())
    names = sorted(files, key=lambda name: first.index(name) if name in first else len(first))
    return {name: _first_line(files[name]) for name in names}


def reference_of(scene: Scene) -> Reference | None:
    """The measured values for the impact that a scene describes, whatever its name; None if none.

    The scene's own reference is ignored if the scene has been changed into another impact.
    """
    own = [] if scene.reference is None else [scene.reference]
    return next((each for each in (*own, *references().values()) if each.fits(scene)), None)


def reference_by_name(scene: Scene) -> Reference | None:
    """The reference that belongs to a scene's name, even if its impact has been changed."""
    known = scene.reference or references().get(scene.name)
    return known if known is not None and known.name == scene.name else None


def caption(scene: Scene) -> Caption:
    """The display name of a scene: its reference's title, such as "wedge, 2.86 m/s".

    A scene changed into another impact is called "paper/wedge-2.86, changed"; all others are
    called by their name.
    """
    named = reference_by_name(scene)
    if named is None:
        return Caption(scene.name)
    found = reference_of(scene)
    title = (found or named).title or scene.name
    told = (
        scene.impactor is not None
        and scene.impactor.label in title
        and (found or named).has_velocity_of(scene)
    )
    says = frozenset({"impactor.shape", "impactor.velocity"} if told else ())
    return Caption(title if found else f"{scene.name}, changed", says)


def title(scene: Scene) -> str:
    """The title of a scene's `caption`."""
    return caption(scene).title


@lru_cache(maxsize=1)
def references() -> Mapping[str, Reference]:
    """References of the scenes in the package, by scene name, ordered by source."""
    tables = {n: read_toml(path) for n, path in _built_in().items() if path.suffix == ".toml"}
    scenes = [Scene.checked(data, name) for name, data in tables.items() if "reference" in data]
    found = {scene.name: scene.reference for scene in scenes if scene.reference}
    return dict(sorted(found.items(), key=lambda item: item[1].source))


def _read(source: str | Path) -> Scene | dict[str, Any]:
    """Return the scene of a script, or the raw data of a TOML file."""
    name, path = str(source), Path(source)
    path = _built_in().get(name, path)
    if not os.path.isfile(path):  # unlike Path's, False for an invalid path
        raise UserError(_missing(name, path))
    if path.suffix == ".toml":
        data = read_scene(path)
        _check_figures(data, name)
        # a scene written by a run also holds the assumed values
        return Scene.checked(data, name).given_data() if "assumed" in data else data
    if path.suffix == ".py":
        return _run_script(path)
    raise UserError(
        f"{name}: a scene is a .toml or a .py file, or a built-in name ('taichi-foam scenes' "
        "lists them); rename the file"
    )


def _check_figures(data: Mapping[str, Any], source: str) -> None:
    """Raise UserError for figures in a reference that no run has: nothing to compare them with."""
    figures = at(data, "reference.figures")
    for key in figures if isinstance(figures, Mapping) else ():
        if key not in MEASURES:
            near = difflib.get_close_matches(key, MEASURES, n=1, cutoff=0.5)
            guess = (
                f"did you mean {near[0]}?"
                if near
                else "docs/results.md lists those of summary.json"
            )
            raise UserError(
                f"{source}: reference.figures.{shown(key)}: not a figure of a run; {guess}"
            )


def _missing(name: str, path: Path) -> str:
    """The message for a source that is not a file, with the most similar built-in name."""
    if len(name) > _LONGEST_NAME or not name.isprintable():
        return (
            f"{shown(name)}: no such file; a name has at most {_LONGEST_NAME:,} printable "
            "characters; 'taichi-foam scenes' lists the built-in ones"
        )
    if os.path.isdir(path):
        return f"{name}: is a folder; a scene is a .toml or a .py file, or a built-in name"
    near = difflib.get_close_matches(name, _built_in(), n=1, cutoff=0.5)
    guess = f"did you mean {near[0]}? " if near else ""
    return (
        f"{name}: no such file and no built-in scene of that name; {guess}"
        "'taichi-foam scenes' lists the built-in ones"
    )


def _run_script(path: Path) -> Scene:
    """Run a scene script, without its `__main__` part, and return its `scene`."""
    try:
        names = runpy.run_path(str(path), run_name="taichi_foam_scene")
    except ValidationError as error:
        raise UserError(titled(_where(path, error), explain(error, Scene))) from None
    except (Exception, SystemExit) as error:
        what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        raise UserError(f"{_where(path, error)}: the script failed: {what}") from None
    if "scene" not in names:
        raise UserError(f"{path}: defines no `scene`; add scene = Scene(...)")
    if not isinstance(names["scene"], Scene):
        raise UserError(
            f"{path}: `scene` is {type(names['scene']).__name__}, not taichi_foam.scene.Scene; "
            "write scene = Scene(...)"
        )
    return names["scene"]


def _where(path: Path, error: BaseException) -> str:
    """Return "file:line" of the script's line that an exception came from."""
    lines = [
        frame.lineno
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename == str(path)
    ]
    if isinstance(error, SyntaxError) and error.filename == str(path):
        lines.append(error.lineno)
    return f"{path}:{lines[-1]}" if lines else str(path)


def _built_in() -> dict[str, Path]:
    """Return the scene files that come with the package, by built-in name."""
    package = Path(__file__).parent
    # In the wheel they are inside the package, in a source tree beside it.
    folder = next((f for f in (package / "gallery", package.parent / "scenes") if f.is_dir()), None)
    return {
        f"{kind}/{path.stem.replace('_', '-')}": path
        for kind, files in (("gallery", "*.*"), ("paper", "paper/*.*"))
        for path in sorted(folder.glob(files) if folder else ())
        if path.suffix in (".py", ".toml")
    }


def _first_line(path: Path) -> str:
    """Return the first line of a script's docstring, or of a TOML file's opening comment."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        text = ast.get_docstring(ast.parse(text)) or ""
    return text.lstrip("# ").partition("\n")[0].strip()
