"""The controls that change a scene in a live view, and the name of the changed scene.

Ranges and descriptions of the page's controls are those of the scene's own fields.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Annotated, Any

from pydantic import TypeAdapter, ValidationError

from taichi_foam import catalogue
from taichi_foam.errors import UserError
from taichi_foam.laws.bond import BondFoam
from taichi_foam.laws.shape import SHAPES, Impactor
from taichi_foam.parts import Control, Part
from taichi_foam.scene import Block, Scene
from taichi_foam.scene.options import Numerics

Value = int | float | None

#: Largest number of mass points of a scene from the page, unless the served scene has more.
MOST_NODES = 100_000

_COUNTS = frozenset({"block.columns", "block.rows"})

#: The shape of a scene without an impactor.
NO_SHAPE = "none"

#: Longest name of a scene that is named after its changes.
MOST_LETTERS = 100


def offered_shapes() -> tuple[str, ...]:
    """The impactor shapes that a live view offers: those with adjustable sizes."""
    return tuple(name for name, kind in SHAPES.items() if kind.controls)


def heading(scene: Scene, given: Scene, changes: Mapping[str, str]) -> tuple[str, list[str]]:
    """A drop's title, and its other changes, in words.

    changes  by dotted key, in words, how `scene` differs from `given`

    If one of the paper's tests was changed into another impact, the title names the impactor
    instead of the test.
    """
    known = catalogue.reference_by_name(given)
    if known is None or scene.impactor is None:
        return given.name, list(changes.values())
    if known.fits(scene) and "impactor.velocity" not in changes:
        return known.title or given.name, list(changes.values())
    told = ("impactor.shape", "impactor.velocity")
    title = f"{scene.impactor.label}, {scene.impactor.velocity:.6g} m/s"
    if not changes:
        title = catalogue.title(scene)  # `given` was changed already
    return title, [words for key, words in changes.items() if key not in told]


def renamed(scene: Scene, given: Scene, changes: Mapping[str, str]) -> Scene:
    """`scene` named by its heading, for folders and films; `given`'s name if nothing changed."""
    if not changes:
        return scene.model_copy(update={"name": given.name})
    title, rest = heading(scene, given, changes)
    name = f"{title} with {', '.join(rest)}" if rest else title
    short = name if len(name) <= MOST_LETTERS else f"{name[: MOST_LETTERS - 1]}…"
    return scene.model_copy(update={"name": short})


@dataclass(frozen=True)
class Knob:
    """One control of a view.

    group    group that shows it
    head     key of the part with the value: "impactor", "block", ...
    control  the value's field, label and slider
    owner    class of the part that has the field, with its range
    shapes   impactor shapes that have it; empty: independent of the shape
    """

    group: str
    head: str
    control: Control
    owner: type[Part]
    shapes: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """Dotted key of the value in a scene."""
        return f"{self.head}.{self.control.field}"

    @property
    def label(self) -> str:
        """Name of the value, for users."""
        return self.control.label


_IMPACTOR = (
    Control("velocity", "velocity", 0.5, 6.0, 0.02, "m/s"),
    Control("mass", "mass", 1.0, 20.0, 0.1, "kg"),
    Control("rotation_deg", "tilt", -90, 90, 1, "°"),
)
_FRICTION = Control("friction", "friction", 0.0, 1.0, 0.01)
_BLOCK = (
    Control("depth", "depth", 10, 200, 1, "mm", 1e-3),
    Control("columns", "columns", 10, 120, 2),
    Control("rows", "rows", 5, 60, 1),
    Control("density", "density", 10, 100, 0.1, "kg/m³"),
)
_GRAVITY = Control("gravity", "gravity", 0.0, 20.0, 0.01, "m/s²")


def knobs(foam: BondFoam) -> tuple[Knob, ...]:
    """All controls of a scene with this foam, in the page's order.

    Each shape lists its own sizes, and each law its own values. Shapes with a common field share
    its control.
    """
    sizes: dict[str, Knob] = {}
    for shape in offered_shapes():
        for one in SHAPES[shape].controls:
            known = sizes.get(one.field) or Knob("impactor", "impactor", one, SHAPES[shape])
            sizes[one.field] = replace(known, shapes=(*known.shapes, shape))
    return (
        *(Knob("impactor", "impactor", one, Impactor) for one in _IMPACTOR),
        *sizes.values(),
        Knob("impactor", "impactor", _FRICTION, Impactor),
        *(Knob("block", "block", one, Block) for one in _BLOCK),
        Knob("block", "numerics", _GRAVITY, Numerics),
        *(Knob("foam", "foam", one, type(foam)) for one in foam.controls),
    )


class Controls:
    """The controls for a served scene, and the scenes made with them."""

    def __init__(self, given: Scene) -> None:
        self.given = given
        self.shape = given.impactor.shape if given.impactor else NO_SHAPE
        offered = offered_shapes()
        self.shapes = offered if self.shape in offered else (self.shape, *offered)
        self.knobs = {knob.key: knob for knob in knobs(given.foam)}
        self.defaults = self.values_of(given)

    def told(self) -> dict[str, Any]:
        """The data from which the page builds the controls; numbers in display units."""
        return {"shapes": self.shapes, "knobs": [self._told(knob) for knob in self.knobs.values()]}

    def values_of(self, scene: Scene) -> dict[str, Value]:
        """Each control's value in a scene [SI]; the default if the scene's shape lacks it."""
        return {key: _value(scene, knob) for key, knob in self.knobs.items()}

    def check(self, shape: str, values: Mapping[str, Value]) -> None:
        """Raise UserError for an unknown shape or key, or a value out of range."""
        if shape not in self.shapes:
            raise UserError(f"impactor.shape = {shape!r}: must be one of {', '.join(self.shapes)}")
        for key, value in values.items():
            knob = self.knobs.get(key)
            if knob is None:
                raise UserError(f"{key}: the page has no such control")
            _check_range(knob, value)

    def scene_of(self, shape: str, values: Mapping[str, Value]) -> Scene:
        """The scene with these settings, named after its changes.

        Raises UserError as `with_values`.
        """
        self.check(shape, values)
        changed: dict[str, str | Value] = {"impactor.shape": shape} if shape != self.shape else {}
        if changed and "height" in SHAPES[shape].model_fields:
            # the old shape's height may be too small for the new one
            changed["impactor.height"] = SHAPES[shape].model_fields["height"].default
        for key, value in values.items():
            if self._has(shape, self.knobs[key]) and value != self.defaults[key]:
                changed[key] = value
        if not changed:
            return self.given
        if changed.keys() & _COUNTS:  # the page shows both, so neither is derived from the other
            changed |= {key: values.get(key, self.defaults[key]) for key in _COUNTS}
        scene = self.given.with_values(changed)
        nodes, most = _nodes(scene), max(MOST_NODES, _nodes(self.given))
        if nodes > most:
            raise UserError(
                f"block.columns = {scene.block.columns}, block.rows = {scene.block.rows}: "
                f"{nodes:,} mass points; at most {most:,} here; use fewer, or serve a scene of "
                "that size"
            )
        return renamed(scene, self.given, self.changes(scene))

    def changes(self, scene: Scene) -> dict[str, str]:
        """Differences of a scene from the served one, by key, in words."""
        told = {}
        shape = scene.impactor.shape if scene.impactor else NO_SHAPE
        if shape != self.shape:
            told["impactor.shape"] = shape
        for knob in self.knobs.values():
            value = _value(scene, knob)
            if self._has(shape, knob) and value != self.defaults[knob.key]:
                told[knob.key] = f"{knob.label} {_shown(knob, value)}"
        return told

    def describes(self, scene: Scene) -> bool:
        """Whether the controls can make this scene, whatever its name.

        If they cannot, `changes` does not hold all of its differences.
        """
        shape = scene.impactor.shape if scene.impactor else NO_SHAPE
        try:
            made = self.scene_of(shape, self.values_of(scene))
        except UserError:
            return False
        return made == scene.model_copy(update={"name": made.name})

    def _has(self, shape: str, knob: Knob) -> bool:
        """Whether a control applies to this impactor shape."""
        if knob.group == "impactor" and shape == NO_SHAPE:
            return False
        return not knob.shapes or shape in knob.shapes

    def _told(self, knob: Knob) -> dict[str, Any]:
        schema, control = _schema(knob), knob.control
        limits = {
            "above": schema.get("exclusiveMinimum"),
            "": schema.get("minimum"),
            "to": schema.get("maximum"),
            "below": schema.get("exclusiveMaximum"),
        }
        given = {
            word: limit / control.factor for word, limit in limits.items() if limit is not None
        }
        spoken = " ".join(f"{word} {limit:,.12g}".strip() for word, limit in given.items())
        spoken = spoken.replace(" below", ", below")
        allowed = f"{spoken} {control.unit}".strip()
        return {
            **asdict(control),
            "group": knob.group,
            "key": knob.key,
            "shapes": [shape for shape in self.shapes if self._has(shape, knob)],
            "whole": schema["type"] == "integer",
            "optional": schema["optional"],
            "min": given.get("", given.get("above")),
            "max": given.get("to", given.get("below")),
            "open": [word for word in ("above", "below") if word in given],
            "about": schema["description"],
            "allowed": f"none, or {allowed}" if schema["optional"] else allowed,
        }


@lru_cache(maxsize=64)
def _schema(knob: Knob) -> dict[str, Any]:
    """The field's JSON schema; for an optional number, the schema of the number."""
    schema = knob.owner.model_json_schema()["properties"][knob.control.field]
    numbers = [each for each in schema.get("anyOf", []) if each["type"] != "null"]
    return {**schema, **(numbers[0] if numbers else {}), "optional": bool(numbers)}


def _value(scene: Scene, knob: Knob) -> Value:
    part, field = getattr(scene, knob.head), knob.control.field
    if hasattr(part, field) and (not knob.shapes or part.shape in knob.shapes):
        return getattr(part, field)
    return knob.owner.model_fields[field].default


def _check_range(knob: Knob, value: Value) -> None:
    """Raise UserError, as a scene would, for a value out of the field's range."""
    field = knob.owner.model_fields[knob.control.field]
    number: Any = Annotated[field.annotation, field]
    try:
        TypeAdapter(number, config=Part.model_config).validate_python(value)
    except ValidationError:
        schema, shown = _schema(knob), "none" if value is None else f"{value:.12g}"
        kind = "a whole number, " if schema["type"] == "integer" else ""
        raise UserError(
            f"{knob.key} = {shown}: must be {kind}{schema['allowed']}; {schema['fix']}"
        ) from None


def _shown(knob: Knob, value: Value) -> str:
    control = knob.control
    return "none" if value is None else f"{value / control.factor:.6g} {control.unit}".rstrip()


def _nodes(scene: Scene) -> int:
    return scene.block.columns * scene.block.rows
