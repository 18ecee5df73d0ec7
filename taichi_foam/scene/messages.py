"""Validation errors as readable text: one line per problem, each with its key, value and remedy."""

from __future__ import annotations

import difflib
import reprlib
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from taichi_foam.laws.shape import SHAPES
from taichi_foam.parts import Part, hints_of
from taichi_foam.scene.keys import CHOSEN, all_parts, listed_in, parts

_CLOSE = 0.75
"""Similarity to a known key from which a word counts as misspelt: height is not drop_height."""

_INERTIA = "impactor.inertia, about the centre of mass, in kg m2"
_SPIN = (
    "impactor.spin is its initial angular velocity, in rad/s; impactor.guided = false lets it "
    "rotate"
)
_TILT = "impactor.rotation_deg is its initial rotation, counter-clockwise"
_CURVE = "foam.curve is the file of a compression test; it sets foam.law to tabulated"
_CONCEPTS = {
    "fall_height": "impactor.drop_height is the fall height",
    "falling_height": "impactor.drop_height is the fall height",
    "speed": "impactor.velocity is its initial velocity, impactor.drop_height the fall height",
    "weight": "impactor.mass, in kilograms",
    "g": "numerics.gravity, in m/s2",
    "angular_velocity": _SPIN,
    "spin": _SPIN,
    "inertia": _INERTIA,
    "moment_of_inertia": _INERTIA,
    "rotation": _TILT,
    "tilt": _TILT,
    "curve": _CURVE,
    "stress_strain": _CURVE,
}
"""The key to use instead, or why there is none, by other words that people use for it."""

_NO_TABLE = ("union_tag_not_found", "model_type", "model_attributes_type", "dict_type")
"""Kinds of pydantic errors for a value that is not a table."""

_MOST_PROBLEMS = 20
_LONGEST_LINE = 400
_LONGEST_KEY = 60
"""Limits that keep messages readable, whatever a file contains."""

_KIND_OF_VALUE = {
    "float_type": "a number, ",
    "int_type": "a whole number, ",
    "int_from_float": "a whole number, ",
    "int_parsing_size": "a whole number, ",
    "finite_number": "a finite number, ",
}


def explain(error: ValidationError, scene: type[Part]) -> str:
    """Return the problems of an invalid scene, or of a part of one, one line each.

    `scene` is the scene's class, which defines the known keys and parts.
    """
    lines: dict[str, None] = {}
    for detail in error.errors(include_url=False):
        if len(lines) >= _MOST_PROBLEMS:
            lines[f"and more: {error.error_count():,} problems in all"] = None
            break
        lines |= dict.fromkeys(_printable(line) for line in _lines(error, detail, scene))
    return "\n".join(lines)


def shown(value: Any) -> str:
    """Return a value as a message shows it, shortened if necessary."""
    text = "none" if value is None else _short.repr(value)
    return text if len(text) <= _LONGEST_KEY else text[: _LONGEST_KEY - 3] + "..."


def key_shown(key: str) -> str:
    """Return a key as a message shows it: printable, and shortened if necessary."""
    return _printable(key, _LONGEST_KEY)


def nearest(path: str, here: Mapping[str, str], scene: type[Part]) -> str | None:
    """The known key that an unknown one probably means; None if none is similar.

    Keys in the same place are searched first (`here`, dotted keys by name), then those of the whole
    scene: for the same name, a longer name that begins with it (angle_deg for angle), or a similar
    spelling.
    """
    key = path.rpartition(".")[2][:_LONGEST_KEY]
    # Keys of other shapes have the same path: to suggest one would repeat the question.
    everywhere = {
        name: f"{part}.{name}"
        for part, kind in all_parts(scene)
        for name in _names(kind)
        if f"{part}.{name}" != path
    }
    for known in (here, everywhere):
        near = [name for name in known if name == key or name.startswith(f"{key}_")]
        near.sort(key=len)
        near += difflib.get_close_matches(key, known, n=1, cutoff=_CLOSE)
        if near:
            return known[near[0]]
    return None


def titled(source: str, problems: str, kind: str = "scene") -> str:
    """Return problems as an indented list under the name of their source, a scene or other kind."""
    listed = "\n".join(f"  {line}" for line in problems.splitlines())
    return f"{source}: not a valid {kind}:\n{listed}"


class _Short(reprlib.Repr):
    """Short representations that are quick to make, however long or deep a value is."""

    def __init__(self) -> None:
        super().__init__()
        self.maxstring = self.maxother = self.maxlong = _LONGEST_KEY

    def repr_int(self, x: int, level: int) -> str:
        try:
            return super().repr_int(x, level)
        except ValueError:  # Python refuses to write thousands of digits
            return f"a whole number of {x.bit_length():,} bits"


_short = _Short()


def _printable(text: str, most: int = _LONGEST_LINE) -> str:
    """Return one line of text, shortened, with unprintable characters escaped."""
    cut = text if len(text) <= most else text[: most - 3] + "..."
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in cut)


def _names(part: type[Part]) -> list[str]:
    """The keys of a part as written in a scene."""
    return [field.alias or name for name, field in part.model_fields.items()]


def _root(title: str, scene: type[Part]) -> tuple[str, type[Part]]:
    """Key and class of a part by its class name, for parts that are built by themselves."""
    return next(
        ((key, part) for key, part in all_parts(scene) if part.__name__ == title), ("", scene)
    )


def _lines(error: ValidationError, detail: ErrorDetails, scene: type[Part]) -> Iterator[str]:
    """Yield the lines for one of pydantic's error details."""
    kind, value, context = detail["type"], detail["input"], detail.get("ctx", {})
    path, owner, field = _locate(error.title, detail["loc"], scene)
    if kind == "value_error":
        head = _head_of_foam(path)
        for line in str(context["error"]).splitlines():
            yield f"{head}{line}" if line.startswith("foam.") else line
        return
    registry = CHOSEN.get(path.rpartition(".")[2], SHAPES)
    tag, tags = registry.tag, ", ".join(registry)
    hints = hints_of(field) if field else {}
    if kind == "extra_forbidden":
        yield _unknown_key(path, owner, scene)
    elif kind == "union_tag_not_found" and isinstance(value, Mapping):
        yield f"{path}.{tag}: missing; choose one of {tags}"
    elif kind == "union_tag_invalid":
        given = value.get(tag) if isinstance(value, Mapping) else context["tag"]
        yield f"{path}.{tag} = {shown(given)}: must be one of {tags}"
    elif kind in _NO_TABLE and "allowed" not in hints:
        known = ", ".join(_names(owner))
        yield f"{path} = {shown(value)}: must be a table with keys such as {known}"
    elif kind == "bool_type":
        yield f"{path} = {shown(value)}: must be true or false"
    elif not (allowed := hints.get("allowed") or context.get("expected")):
        said = detail["msg"].replace("Input should be", "must be")
        yield f"{path}: missing" if kind == "missing" else f"{path} = {shown(value)}: {said}"
    else:
        # Other ranges already say what kind of value is allowed.
        sort = _KIND_OF_VALUE.get(kind, "") if allowed.startswith(("above", "at")) else ""
        given = ": missing;" if kind == "missing" else f" = {shown(value)}:"
        fix = f"; {hints['fix']}" if "fix" in hints else ""
        yield f"{path}{given} must be {sort}{allowed}{fix}"


def _locate(
    title: str, location: tuple[int | str, ...], scene: type[Part]
) -> tuple[str, type[Part], FieldInfo | None]:
    """Return the dotted path of pydantic's location, the innermost part's class, and the field.

    Pydantic puts the names of union members between the keys; these are left out.
    """
    path, owner = _root(title, scene)
    field: FieldInfo | None = None
    for step in location:
        chosen = CHOSEN.get(path.rpartition(".")[2], {})
        if isinstance(step, int):
            path += f"[{step}]"
            if field and (kind := listed_in(field)):
                owner, field = kind, None
        elif owner is scene and step in parts(scene):
            path, owner = step, parts(scene)[step]
        elif field is None and step in chosen:
            owner = chosen[step]
        elif field is None and step in CHOSEN and step in owner.model_fields:
            path, owner = f"{path}.{step}".lstrip("."), next(iter(CHOSEN[step].values()))
        elif field is None:
            path = f"{path}.{step}" if path else step
            field = owner.model_fields.get(step)
    return path, owner, field


def _head_of_foam(path: str) -> str:
    """The part of a path before `foam`: empty except for foams of layers and across."""
    head, between, _ = f".{path}".partition(".foam")
    return f"{head[1:]}." if between and head else ""


def _unknown_key(path: str, owner: type[Part], scene: type[Part]) -> str:
    """The message for an unknown key, with the key that was probably meant."""
    head, _, key = path.rpartition(".")
    here = {name: f"{head}.{name}".lstrip(".") for name in _names(owner)}
    if key in _CONCEPTS:
        answer = _CONCEPTS[key]
    elif near := nearest(path, here, scene):
        answer = f"did you mean {near}?"
    else:
        answer = f"known here: {', '.join(here)}"
    return f"{key_shown(path)}: unknown key; {answer}"
