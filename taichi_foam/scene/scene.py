"""The whole scene, and the checks that involve more than one of its parts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import Field, ValidationError, model_validator

from taichi_foam.errors import UserError
from taichi_foam.laws.bond import FOAMS, BondFoam, BondLaw
from taichi_foam.laws.bond.kinds.crushable import Foam
from taichi_foam.laws.shape import SHAPES, Impactor
from taichi_foam.parts import Part
from taichi_foam.scene import assumed, filling, library, motion, support
from taichi_foam.scene.assumed import Origin
from taichi_foam.scene.block import Across, Block, Layer
from taichi_foam.scene.keys import all_parts
from taichi_foam.scene.layers import foams_of
from taichi_foam.scene.messages import explain, titled
from taichi_foam.scene.options import Base, Model, Numerics, Output, Start
from taichi_foam.scene.reference import Reference
from taichi_foam.scene.support import Support
from taichi_foam.scene.values import changed

_OPTIONS = {
    "heeds_rate": "rate, which only one of them gives",
    "overshoots": "overshoot_strain, which only one of them gives",
}
"""Words for the options in which foams of one law may differ for the kernels, by option."""


MOST_INERTIA, LEAST_INERTIA = 10.0, 1e-3
"""Limits of a moment of inertia, over that of all the mass at the outline's furthest point, and
over that of a uniform plate. A value beyond them is probably in another unit."""


class Scene(Part):
    """One impact on one block, complete: everything that determines its result. SI units.

    The frame: x to the right from the block's mid-width, y up from its bottom; displacement and
    impactor velocity are positive downwards. Unless the lattice is turned, mass point (i, j) is at
    x = (i - (columns-1)/2) dx, y = block.foot + j dy.
    """

    name: str = Field(
        default="scene",
        min_length=1,
        max_length=100,
        pattern=r"^[^\x00-\x1f\x7f]+$",
        description="name, for titles and tables",
        json_schema_extra={"allowed": "1 to 100 printable characters", "fix": "shorten it"},
    )
    block: Block = Field(default=Block(), description="the foam block and its lattice")
    foam: Annotated[BondFoam, FOAMS] = Field(default=Foam(), description="the foam's law")
    across: Across = Field(
        default=Across(),
        description="the foam across its rise direction, if it differs from that along it",
    )
    impactor: Annotated[Impactor, SHAPES] | None = Field(
        default=None, description="what hits the block; none: nothing does"
    )
    base: Base = Field(default=Base(), description="what holds the bottom row")
    support: Support = Field(
        default=Support(), description="what the block rests on, if not a floor"
    )
    model: Model = Field(
        default=Model(), description="model choices, for what the paper leaves open"
    )
    numerics: Numerics = Field(
        default=Numerics(), description="time steps, damping, end of the run"
    )
    start: Start = Field(default=Start(), description="deformation and motion at the start")
    output: Output = Field(default=Output(), description="what a run stores and draws")
    reference: Reference | None = Field(
        default=None,
        description="what was measured in this impact, and its title in pictures",
        json_schema_extra={
            "allowed": "none, or a table with source and figures, and optionally title and readings"
        },
    )

    assumed: tuple[Origin, ...] | None = Field(
        default=None,
        strict=False,
        description="values of a user's foam that were not given, and so were assumed; written "
        "by the program",
        json_schema_extra={"allowed": "none, or a list of tables with key and why"},
    )

    @model_validator(mode="before")
    @classmethod
    def _complete(cls, data: Any) -> Any:
        return library.completed(data)

    @model_validator(mode="after")
    def _check_parts_agree(self) -> Scene:
        self._follow()
        unfilled = filling.problems(self.block)
        problems = [
            *_problems_of_foam(self),
            *_problems_of_layers(self),
            *_problems_of_base(self),
            *support.problems(self.support, self.base, self.block),
            *assumed.problems(self.assumed or (), self),
            *_problems_of_start(self),
            *_problems_of_times(self),
            *_problems_of_inertia(self),
            *(
                unfilled
                or motion.problems_of_driving(self.impactor, self.base, self.numerics)
                or _problems_of_fall(self)
                or _problems_of_contact(self)
            ),
        ]
        if problems:
            raise ValueError("\n".join(problems))
        return self

    def _follow(self) -> None:
        """Set the values that follow from given ones: of falls, crossheads and users' foams."""
        found = assumed.followed(self)
        if self.impactor is not None:
            found["impactor"], found["numerics"] = motion.followed(self.impactor, self.numerics)
        for name, value in found.items():
            object.__setattr__(self, name, value)

    @model_validator(mode="after")
    def _tell_reference(self) -> Scene:
        """Tie a new reference to this impact; it keeps it when the scene is changed."""
        if self.reference is not None and self.reference.impact is None:
            vars(self)["reference"] = self.reference.of(self)  # it is frozen
        return self

    @classmethod
    def checked(cls, data: Mapping[str, Any], source: str) -> Scene:
        """The scene of raw data. Raises UserError, titled with the source, naming every problem."""
        try:
            return cls.model_validate(data)
        except ValidationError as error:
            raise UserError(titled(source, explain(error, cls))) from None

    def with_values(self, values: Mapping[str, Any] | None = None, /, **more: Any) -> Scene:
        """A scene with other values, checked anew; this one is unchanged.

            scene.with_values({"impactor.velocity": 3.0, "block.rows": 40})
            scene.with_values(impactor__velocity=3.0, block__rows=40)

        Keys are those of the scene's TOML; as keywords they have two underscores for each dot. None
        clears an optional key. A new `impactor.shape` drops the keys that it does not have, and a
        new `impactor.velocity` drops the drop height.

        Raises UserError, naming every problem: unknown keys, invalid values.
        """
        wanted = {**(values or {}), **{key.replace("__", "."): more[key] for key in more}}
        if not wanted:
            return self
        return self.checked(changed(self.given_data(), wanted), self.name)

    def given_data(self) -> dict[str, Any]:
        """Nested data without values that follow from others, as `values.changed` takes it."""
        return assumed.given_data(self)

    @property
    def turns(self) -> bool:
        """Whether there is an impactor that moves and turns in the plane."""
        return self.impactor is not None and not self.impactor.guided

    @property
    def is_tilted(self) -> bool:
        """Whether there is an impactor whose outline is not, or does not stay, upright."""
        return self.impactor is not None and (self.turns or self.impactor.rotation_deg != 0.0)

    @property
    def is_driven(self) -> bool:
        """Whether a motion is prescribed: of a crosshead, or of a shaken base."""
        crosshead = self.impactor is not None and self.impactor.motion == "crosshead"
        return crosshead or self.base.shaking is not None

    @property
    def is_slowed(self) -> bool:
        """Whether there is an impactor that contact slows down, that is, not a crosshead."""
        return self.impactor is not None and self.impactor.motion != "crosshead"

    @property
    def most_rows(self) -> int:
        """Number of rows of the history that a run does not exceed."""
        return math.floor(self.numerics.latest_end / self.output.history_interval) + 2

    @property
    def most_snapshots(self) -> int:
        """Number of snapshots, and so of frames, that a run does not exceed."""
        return math.floor(self.numerics.latest_end / self.output.snapshot_interval) + 2

    @property
    def contact_height(self) -> float:
        """Height of the impactor's lowest point at first contact [m].

        The height of the top row; for a block with an outline, that of the highest foam under the
        impactor, which reaches to the outline.
        """
        filled = filling.filling(self.block)
        if filled.is_full:  # the same height, exactly
            return self.block.height - self.block.dy / 2
        ends = motion.ends_of(self.impactor) if self.impactor else (-math.inf, math.inf)
        return _top(self.block, self.block.positions[filled.there], *ends)

    @property
    def thickness(self) -> float:
        """Thickness of the fresh block under the impactor's lowest point, at first contact [m].

        From the first row of mass points: the foam above it is what is compressed.
        """
        return self.contact_height - self.block.foot


def _rebuild() -> None:
    """Rebuild the scene's classes after a law or a shape was registered."""
    for part in (Across, Layer, Block, Scene):
        part.model_rebuild(force=True)
    _tell_places()


def _tell_places() -> None:
    """Tell every class of parts where it stands in a scene."""
    Scene.places = ("",)
    for key, part in all_parts(Scene):
        part.places = (key, "block.layers[].foam", "across.foam") if key == "foam" else (key,)


_tell_places()
for registry in (FOAMS, SHAPES):
    registry.watchers.append(_rebuild)


def _problems_of_foam(scene: Scene) -> list[str]:
    foam = scene.foam
    if foam.shear_modulus > foam.youngs_modulus * 10:
        return [
            f"foam.shear_modulus = {foam.shear_modulus:g}: more than ten times "
            f"foam.youngs_modulus = {foam.youngs_modulus:g}; both are in pascals "
            "(0.84 MPa is 0.84e6)"
        ]
    return []


def _problems_of_layers(scene: Scene) -> list[str]:
    """Why foams of layers, or the one across, cannot be combined with the block's."""
    law = scene.foam.law_for(scene.model)
    foams = {f"block.layers[{n}]": layer.foam for n, layer in enumerate(scene.block.layers)}
    found = [
        f"{head}.foam: does not match [foam], as it is {_differing(law, other)}; all foams of a "
        "block need the same law with the same options; give both the same, or give each a curve "
        "(foam.curve)"
        for head, foam in {**foams, "across": scene.across.foam}.items()
        if foam is not None and (other := foam.law_for(scene.model)) != law
    ]
    across, shear = scene.across.foam, scene.foam.shear_modulus
    key = "across.foam.shear_modulus"
    assumed_keys = {each.key for each in scene.assumed or ()}
    if across is None or "shear_modulus" not in across.model_fields_set or key in assumed_keys:
        return found
    if across.shear_modulus != shear:
        found.append(
            f"{key} = {across.shear_modulus:g}: must be that of [foam], {shear:g} Pa; a plane has "
            "one shear modulus; leave it out"
        )
    return found


def _problems_of_base(scene: Scene) -> list[str]:
    """Why the base has nothing to hold."""
    kind = scene.base.kind
    if kind == "floor" or filling.filling(scene.block).on_base.any():
        return []
    return [
        f"block.outline: has no side on the base, y = 0, which base.kind = '{kind}' holds; give it "
        "a level side there, or set base.kind = 'floor'"
    ]


def _differing(law: BondLaw, other: BondLaw) -> str:
    """How the second law differs from the first, in the words of a scene."""
    if type(law) is not type(other):
        return f"of the law {type(other).__name__.lower()}"
    unlike = {key for key, value in vars(other).items() if value != vars(law)[key]}
    words = [text for key, text in _OPTIONS.items() if key in unlike]
    return f"different in {' and '.join(words or sorted(unlike))}"


def _problems_of_start(scene: Scene) -> list[str]:
    problems = []
    limit = max(foam.landmarks.limit for foam in foams_of(scene)[0])
    for axis, strain in zip("xy", scene.start.strains, strict=True):
        if strain <= limit:
            problems.append(
                f"start.deformation_gradient: strain {strain:.3g} along {axis}; must be above "
                f"the foam's limit of {limit:g}; compress it less"
            )
    return problems


def _problems_of_times(scene: Scene) -> list[str]:
    problems = []
    numerics, output = scene.numerics, scene.output
    if scene.impactor is None and numerics.end == "rebound":
        problems.append(
            "numerics.end = 'rebound': nothing rebounds without an impactor; "
            "give a time in seconds, or give [impactor] a shape"
        )
    latest = numerics.latest_end
    if numerics.dt != "auto" and numerics.dt > min(latest, output.history_interval):
        problems.append(
            f"numerics.dt = {numerics.dt:g}: longer than output.history_interval = "
            f"{output.history_interval:g} s or the run's {latest:g} s; use a shorter step"
        )
    if output.history_interval > latest:
        problems.append(
            f"output.history_interval = {output.history_interval:g}: longer than the run's "
            f"{latest:g} s ({_key_of_end(numerics)}); times are in seconds; shorten it"
        )
    return problems


def _key_of_end(numerics: Numerics) -> str:
    """The key that gives `latest_end`."""
    return "numerics.time_limit" if numerics.end == "rebound" else "numerics.end"


def _problems_of_fall(scene: Scene) -> list[str]:
    if scene.impactor is None:
        return []
    plateau = max(foam.landmarks.plateau_stress for foam in foams_of(scene)[0])
    return motion.problems_of_fall(scene.impactor, scene.block, scene.numerics.gravity, plateau)


def _problems_of_inertia(scene: Scene) -> list[str]:
    impactor = scene.impactor
    if impactor is None or impactor.inertia is None:
        return []
    most = MOST_INERTIA * impactor.mass * impactor.reach**2
    least = LEAST_INERTIA * impactor.mass * impactor.squared_gyration
    if least <= impactor.inertia <= most:
        return []
    return [
        f"impactor.inertia = {impactor.inertia:g}: must be from {least:.3g} to {most:.3g} kg m2 "
        f"with {impactor.mass:g} kg and this outline; it is in kg m2 (1 g cm2 is 1e-7); leave it "
        "out to use that of a uniform plate"
    ]


def _problems_of_contact(scene: Scene) -> list[str]:
    """Why the impactor could never touch the block, or would start inside it."""
    impactor = scene.impactor
    if impactor is None:
        return []
    points = _starting_points(scene)
    edge = 0.0 if scene.block.is_rectangle else _edges(scene.block)
    left, right = (points[:, 0] - edge).min(), (points[:, 0] + edge).max()
    low, high = _ends_at_arrival(scene, impactor)
    if high <= left or low >= right:
        return [
            f"impactor.x = {impactor.x:g}: never touches the block; the impactor spans "
            f"{low:.4g} to {high:.4g} m, the block's foam {left:.4g} to {right:.4g} m; "
            "bring impactor.x nearer to 0"
        ]
    if scene.start.is_at_rest and not _meets_a_column(scene, points[:, 0], low, high):
        return [
            f"impactor.x = {impactor.x:g}: never touches the block; with {high - low:.4g} m of "
            f"width it passes between two columns of mass points {scene.block.dx:.4g} m apart; use "
            "more block.columns or a wider impactor"
        ]
    above = scene.contact_height + impactor.gap - _top(scene.block, points, low, high)
    if above < -1e-9 * scene.block.height:
        return [
            f"impactor.gap = {impactor.gap:g}: the impactor starts inside the block, whose top "
            f"start.deformation_gradient raises; must be at least {impactor.gap - above:.4g} m"
        ]
    return _problems_of_arrival(scene)


def _problems_of_arrival(scene: Scene) -> list[str]:
    impactor, numerics = scene.impactor, scene.numerics
    assert impactor is not None
    if scene.base.shaking is not None:
        return []  # the foam may move to the impactor
    if impactor.velocity == 0 and numerics.gravity == 0 and impactor.spin == 0:
        return [
            "impactor.velocity = 0: never touches the block without gravity; must be above 0 m/s "
            "(positive downwards), or give impactor.drop_height"
        ]
    arrival = _arrival(scene, impactor)
    if impactor.spin == 0 and arrival >= numerics.latest_end:
        return [
            f"impactor.gap = {impactor.gap:g}: never touches the block; at {impactor.velocity:g} "
            f"m/s it arrives after {arrival:.4g} s, and the run ends at "
            f"{_key_of_end(numerics)} = {numerics.latest_end:g} s; lengths are in metres; bring it "
            "closer"
        ]
    return []


def _arrival(scene: Scene, impactor: Impactor) -> float:
    """Time [s] at which an impactor that does not turn has closed its gap; infinite if never."""
    # Fall from rest at the gap: gap = v t + g t^2 / 2, in the form that is exact for g = 0.
    speed = math.sqrt(impactor.velocity**2 + 2 * scene.numerics.gravity * impactor.gap)
    if impactor.gap == 0:
        return 0.0
    return 2 * impactor.gap / (impactor.velocity + speed) if speed > 0 else math.inf


def _ends_at_arrival(scene: Scene, impactor: Impactor) -> tuple[float, float]:
    """The leftmost and rightmost x [m] of an impactor when it reaches the block's top.

    A spinning impactor may touch with any of its sides, somewhat earlier or later; these are then
    bounds.
    """
    if impactor.spin == 0:
        left, right = motion.ends_of(impactor)
        way = impactor.velocity_x and impactor.velocity_x * _arrival(scene, impactor)
        return left + way, right + way
    middle = impactor.x + impactor.centre_of_mass[0]
    way = impactor.velocity_x and impactor.velocity_x * scene.numerics.latest_end
    ends = (middle, middle + way)
    return min(ends) - impactor.reach, max(ends) + impactor.reach


def _starting_points(scene: Scene) -> np.ndarray:
    """Positions (n, 2) [m] of mass points at the start: a rectangle's corner points, or all."""
    block = scene.block
    if block.is_rectangle:
        half, low, high = (block.width - block.dx) / 2, block.dy / 2, scene.contact_height
        X = np.array([[-half, low], [half, low], [half, high], [-half, high]])
    else:
        X = block.positions[filling.filling(block).there]
    origin = np.array([0.0, block.foot])
    return origin + (X - origin) @ np.array(scene.start.deformation_gradient).T


def _top(block: Block, points: np.ndarray, low: float, high: float) -> float:
    """Height [m] to which the foam of the mass points at `points` (n, 2) reaches between two x [m].

    A rectangle has only its corner points.
    """
    if block.is_rectangle:
        return float(points[:, 1].max())
    top = points[:, 1] + _edges(block)
    return float(top[_is_between(block, points[:, 0], low, high)].max(initial=0.0))


def _edges(block: Block) -> np.ndarray:
    """`Filling.edge` of the mass points (n,) [m]."""
    filled = filling.filling(block)
    return filled.edge[filled.there]


def _is_between(block: Block, x: np.ndarray, low: float, high: float) -> np.ndarray:
    """Which mass points at x (n,) [m] have foam strictly between two positions."""
    edge = _edges(block)
    return (x > low - edge) & (x < high + edge)


def _meets_a_column(scene: Scene, x: np.ndarray, low: float, high: float) -> bool:
    """Whether any column of mass points lies strictly between two positions [m].

    `x` holds the positions of all mass points, unless the block is a rectangle.
    """
    block = scene.block
    if not block.is_rectangle:
        return bool(_is_between(block, x, low, high).any())
    first = math.floor(low / block.dx + (block.columns - 1) / 2) + 1
    position = (max(first, 0) - (block.columns - 1) / 2) * block.dx
    return position < high
