"""Options of a scene: base, model choices, numerics, start and output."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from taichi_foam.choices import Mode, Theme
from taichi_foam.parts import Part, choice, quantity
from taichi_foam.units import STANDARD_GRAVITY

LONGEST_RUN = 10.0
"""Longest duration of a run [s]."""

STIFFEST_CONTACT = 10_000
"""Largest penalty stiffness of a contact, over K times the depth."""

# Lists are accepted as tuples: TOML and most scripts write lists.
_Component = Annotated[float, Field(ge=-10, le=10)]
_Row = Annotated[tuple[_Component, _Component], Field(strict=False)]
_Rate = Annotated[float, Field(ge=-1e6, le=1e6)]
_Cut = Annotated[tuple[_Component, _Component, _Component, _Component], Field(strict=False)]
_RateRow = Annotated[tuple[_Rate, _Rate], Field(strict=False)]

MOST_PULSE_POINTS = 2000

PulseShape = Literal["half-sine", "trapezoid", "sawtooth"]
"""The classical pulses of a shock machine (IEC 60068-2-27)."""

SINE_POINTS = 401
"""Points of a half-sine: linear interpolation between them changes its integral by 5e-6."""

RISE = 0.1
"""Fraction of its duration in which a trapezoid rises, and falls."""

DROP = 0.01
"""Fraction of its duration in which a terminal-peak sawtooth falls, to avoid a jump."""

_Time = Annotated[float, Field(ge=0, le=LONGEST_RUN)]
_Acceleration = Annotated[float, Field(ge=-1e6, le=1e6)]


class Pulse(Part):
    """Upward acceleration of the base over time, linear between its points and 0 outside them."""

    time: Annotated[tuple[_Time, ...], Field(strict=False)] = quantity(
        ...,
        "s",
        "times of the points, in rising order",
        allowed=f"2 to {MOST_PULSE_POINTS:,} numbers from 0 to {LONGEST_RUN:g} s",
    )
    acceleration: Annotated[tuple[_Acceleration, ...], Field(strict=False)] = quantity(
        ...,
        "m/s2",
        "upward acceleration of the base at these times",
        allowed="as many numbers from -1e6 to 1e6 m/s2 as there are times",
    )

    @model_validator(mode="after")
    def _check_points(self) -> Pulse:
        times = self.time
        if len(times) != len(self.acceleration) or not 2 <= len(times) <= MOST_PULSE_POINTS:
            raise ValueError(
                f"base.acceleration: {len(times)} times and {len(self.acceleration)} "
                f"accelerations; there must be equally many, from 2 to {MOST_PULSE_POINTS:,}"
            )
        for n, (before, after) in enumerate(pairwise(times)):
            if after <= before:
                raise ValueError(
                    f"base.acceleration.time[{n + 1}] = {after:g}: must be above {before:g} s, the "
                    "time before it; sort the times, and give each once"
                )
        return self

    @classmethod
    def of_shape(cls, shape: PulseShape, peak: float, duration: float) -> Pulse:
        """A classical pulse that begins at time 0.

        Args:
            shape: its velocity change is 2/pi (half-sine), 0.9 (trapezoid) or 0.5 (sawtooth, its
                peak at its end) of peak times duration.
            peak: m/s2, upwards.
            duration: s, from zero to zero.
        """
        if shape == "half-sine":
            share = np.linspace(0.0, 1.0, SINE_POINTS)
            level = np.sin(np.pi * share)
            level[-1] = 0.0
        elif shape == "trapezoid":
            share, level = np.array([0.0, RISE, 1.0 - RISE, 1.0]), np.array([0.0, 1.0, 1.0, 0.0])
        else:
            share, level = np.array([0.0, 1.0 - DROP, 1.0]), np.array([0.0, 1.0, 0.0])
        time, acceleration = (duration * share).tolist(), (peak * level).tolist()
        return cls(time=time, acceleration=acceleration)

    @property
    def peak(self) -> float:
        """The largest acceleration, up or down, with its sign [m/s2]."""
        return max(self.acceleration, key=abs)

    def velocity(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Upward velocity [m/s] of the base at times (n,) [s]; 0 before the pulse.

        It is the exact integral of the piecewise linear acceleration.
        """
        at, level = np.array(self.time), np.array(self.acceleration)
        now = np.clip(time, at[0], at[-1])
        speed = np.append(0.0, np.cumsum(0.5 * (level[1:] + level[:-1]) * np.diff(at)))
        before = np.clip(np.searchsorted(at, now, side="right") - 1, 0, len(at) - 2)
        mean = 0.5 * (level[before] + np.interp(now, at, level))
        return speed[before] + mean * (now - at[before])


class Base(Part):
    """How the block's bottom row of mass points is held."""

    kind: Literal["held", "gripped", "floor"] = choice(
        "gripped",
        "held: fixed vertically, free to slide sideways; gripped: clamped, in x and y; floor: "
        "resting on it, with friction, free to lift off",
    )
    friction: float = quantity(
        0.5, "-", "friction coefficient between block and floor (floor only)", at_least=0, at_most=5
    )
    stops_impactor: bool = choice(
        True, "an impactor that has gone through the block is stopped at its bottom"
    )
    acceleration: Pulse | None = Field(
        default=None,
        description="pulse that shakes the base: a CSV file of time and acceleration, or a table; "
        "displacements and velocities are then relative to the base",
        json_schema_extra={
            "allowed": "none, a CSV file, or a table of time (s) and acceleration (m/s2, upwards)",
            "fix": "base.acceleration = 'pulse.csv'",
        },
    )
    pulse: PulseShape | None = Field(
        default=None,
        description="shape of a pulse that shakes the base, instead of base.acceleration; a "
        "sawtooth has its peak at its end, a trapezoid rises and falls in a tenth of its "
        "duration",
        json_schema_extra={
            "allowed": "none, half-sine, trapezoid, sawtooth",
            "fix": "another pulse is a CSV file, base.acceleration = 'pulse.csv'",
        },
    )
    pulse_peak_g: float | None = quantity(
        None, "g", "largest acceleration of the pulse, upwards", above=0, at_most=100_000
    )
    pulse_duration_ms: float | None = quantity(
        None, "ms", "duration of the pulse, from zero to zero", at_least=1e-3, at_most=10_000
    )

    @model_validator(mode="after")
    def _check_pulse(self) -> Base:
        sizes = {"pulse_peak_g": self.pulse_peak_g, "pulse_duration_ms": self.pulse_duration_ms}
        given = [f"base.{key}" for key, value in sizes.items() if value is not None]
        missing = [f"base.{key}" for key, value in sizes.items() if value is None]
        if self.pulse is None:
            if given:
                raise ValueError(
                    f"{given[0]}: belongs to base.pulse; give base.pulse = 'half-sine', "
                    "'trapezoid' or 'sawtooth', or leave it out"
                )
        elif self.acceleration is not None:
            raise ValueError(
                f"base.pulse = '{self.pulse}': base.acceleration is given too; leave one of the "
                "two out"
            )
        elif missing:
            raise ValueError(
                f"base.pulse = '{self.pulse}': needs {' and '.join(missing)}, such as "
                "base.pulse_peak_g = 50 and base.pulse_duration_ms = 11"
            )
        return self

    @property
    def shaking(self) -> Pulse | None:
        """The pulse that shakes the base, however it was given; None: the base is at rest."""
        if self.pulse is None or self.pulse_peak_g is None or self.pulse_duration_ms is None:
            return self.acceleration
        peak, duration = STANDARD_GRAVITY * self.pulse_peak_g, 1e-3 * self.pulse_duration_ms
        return Pulse.of_shape(self.pulse, peak, duration)


class Model(Part):
    """Model choices: how what the paper leaves open is interpreted."""

    damping: Literal["stiffness", "absolute"] = choice(
        "stiffness",
        "stiffness: dashpots in proportion to K along bonds and to G in the shear of cells; "
        "absolute: dashpots on each mass point's own velocity (Eqs 28-29 as printed)",
    )
    shear: Literal["cell", "face"] = choice(
        "cell",
        "cell: shear is carried by the foam between four mass points, with forces that derive "
        "from an energy; face: by each bond, on its two mass points (Eqs 10-11, 13, 27), which "
        "creates energy",
    )
    shear_failure: Literal["tension-only", "always", "pressure-dependent", "angle"] = choice(
        "pressure-dependent",
        "shear failure of a bond in compression: tension-only: it does not fail; always: it "
        "fails as in tension; pressure-dependent: its shear strength grows with the compression; "
        "angle: it fails at the angle by which its foam has sheared (less what has yielded), "
        "however short the bond is",
    )
    shear_pressure_coefficient: float = quantity(
        0.7,
        "-",
        "growth of the shear strength with compressive stress (pressure-dependent only)",
        at_least=0,
        at_most=100,
    )
    broken_contact: Literal["reload", "jump"] = choice(
        "reload",
        "faces of a broken bond that meet again: reload: elastically from the strain of "
        "zero stress; jump: on to the loading curve at the worst strain so far",
    )
    self_contact: bool = choice(True, "pieces and powder cannot pass through one another")
    crushed_room: bool = choice(
        True,
        "crushed foam has a packing limit (room): the foam between four neighbouring mass points "
        "resists being pressed below the area that crushing has left it, however its bonds fold",
    )
    shear_yield: bool = choice(
        True,
        "true: in crushable foam, crush and shear have one yield surface, Deshpande and Fleck's "
        "(shear = 'cell' only); false, and foam by its curve: elastic in shear until it breaks",
    )
    piece_size: float = quantity(
        1.04,
        "-",
        "radius of a mass point in contact with others, over half its cell; a pile of discs as "
        "large as their cells needs 1.03 (at random) to 1.075 (closest)",
        at_least=0.1,
        at_most=1.1,
    )
    piece_friction: float = quantity(
        0.0, "-", "friction coefficient between pieces", at_least=0, at_most=5
    )


class Numerics(Part):
    """Step size, damping, contact stiffness and end of the run."""

    dt: Annotated[float, Field(gt=0, le=1e-4)] | Literal["auto"] = quantity(
        "auto",
        "s",
        "time step; auto: from the stiffest bond at that moment",
        allowed="'auto' or above 0 and at most 1e-4 s",
        fix="times are in seconds (the paper uses 1e-7)",
    )
    safety: float = quantity(
        0.8, "-", "fraction of the stability limit that auto uses", above=0, at_most=1
    )
    damping_time: float = quantity(
        1e-6 / 0.057,
        "s",
        "retardation time tau of a bond: its dashpot is tau K area / length "
        "(Table 6's beta is tau times the thickness)",
        at_least=0,
        at_most=1e-2,
        fix="times are in seconds (the paper's beta = 1e-6 m s over 0.057 m is 1.75e-5)",
    )
    contact_stiffness: float = quantity(
        40.0,
        "-",
        "penalty stiffness of a contact over K times the depth",
        above=0,
        at_most=STIFFEST_CONTACT,
    )
    contact_damping: float = quantity(
        0.2,
        "-",
        "dashpot of a contact with a body, as a fraction of critical damping for a mass point on "
        "the contact's spring: without it, foam rattles there, and the steps lose energy that "
        "they do not resolve",
        at_least=0,
        at_most=0.2,
    )
    gravity: float = quantity(
        0.0, "m/s2", "gravity on block and impactor, downwards", at_least=0, at_most=1000
    )
    end: Annotated[float, Field(gt=0, le=LONGEST_RUN)] | Literal["rebound"] = quantity(
        "rebound",
        "s",
        "end of the run; rebound: after the impactor has come to rest",
        allowed=f"'rebound' or above 0 and at most {LONGEST_RUN:g} s",
    )
    time_limit: float = quantity(
        0.12, "s", "end of a run that has not rebounded by then", above=0, at_most=LONGEST_RUN
    )

    @property
    def latest_end(self) -> float:
        """Latest time at which the run ends [s]."""
        return self.time_limit if self.end == "rebound" else float(self.end)


class Start(Part):
    """Initial state of the block: cuts, and a homogeneous deformation and motion.

    A mass point with reference position X starts at x = b + F (X - b) with velocity L (X - b). Here
    b = (0, dy/2) is the middle of the bottom row, or (0, 0) if that row is on the base.
    """

    deformation_gradient: Annotated[tuple[_Row, _Row], Field(strict=False)] = quantity(
        ((1.0, 0.0), (0.0, 1.0)),
        "-",
        "deformation gradient F, by rows",
        allowed="two rows of two numbers from -10 to 10",
        fix="no deformation is [[1, 0], [0, 1]]",
    )
    velocity_gradient: Annotated[tuple[_RateRow, _RateRow], Field(strict=False)] = quantity(
        ((0.0, 0.0), (0.0, 0.0)),
        "1/s",
        "velocity gradient L, over reference positions, by rows",
        allowed="two rows of two numbers from -1e6 to 1e6 1/s",
        fix="rest is [[0, 0], [0, 0]]",
    )
    cuts: Annotated[tuple[_Cut, ...], Field(strict=False, max_length=1000)] = quantity(
        (),
        "m",
        "saw cuts: straight lines [x0, y0, x1, y1] in the undeformed block; bonds that cross "
        "one, from mass point to mass point, are broken from the start",
        allowed="up to 1000 lines of four numbers from -10 to 10 m",
    )

    wait: float = quantity(
        0.0,
        "s",
        "time for which the block has rested since the drop before: foam that recovers does so, "
        "and comes to rest; 0: a drop follows at once",
        at_least=0,
        at_most=1e9,
    )

    @field_validator("deformation_gradient")
    @classmethod
    def _check_orientation(cls, F: tuple) -> tuple:
        determinant = F[0][0] * F[1][1] - F[0][1] * F[1][0]
        if determinant <= 0:
            raise ValueError(
                f"start.deformation_gradient = {[list(row) for row in F]}: its determinant is "
                f"{determinant:g}, which turns the block inside out; must be above 0; "
                "no deformation is [[1, 0], [0, 1]]"
            )
        return F

    @property
    def is_at_rest(self) -> bool:
        """Whether the block starts undeformed and at rest."""
        start = Start()
        return (
            self.deformation_gradient == start.deformation_gradient
            and self.velocity_gradient == start.velocity_gradient
        )

    @property
    def strains(self) -> tuple[float, float]:
        """Initial engineering strains of bonds A and B."""
        (a, b), (c, d) = self.deformation_gradient
        return math.hypot(a, c) - 1, math.hypot(b, d) - 1


def _pixels(default: int, meaning: str) -> Any:
    """A field for a size of a film's frames."""
    return quantity(
        default,
        "px",
        meaning,
        at_least=64,
        at_most=7680,
        multiple_of=2,
        allowed="even, at least 64 and at most 7680 px",
        fix="films need even sizes (1280 by 720)",
    )


class Output(Part):
    """Output: what a run stores."""

    history_interval: float = quantity(
        1e-4, "s", "time between rows of the history", at_least=1e-7, at_most=0.1
    )
    snapshot_interval: float = quantity(
        1e-3, "s", "time between snapshots, and so between frames", at_least=1e-7, at_most=1
    )
    snapshot_precision: Literal["double", "single"] = choice(
        "double", "precision of the numbers in snapshots: 64 bits, or 32 bits in half the space"
    )
    mode: Mode = choice("worst-strain", "what the colours of the pictures show")
    stress: bool = choice(
        False,
        "store the stress at each mass point in snapshots; always stored if mode is stress",
    )
    theme: Theme = choice("light", "colour theme of the pictures")
    curve: bool = choice(False, "draw the deceleration up to that time into each frame")
    frames: bool = choice(False, "write each frame as a PNG")
    film: bool = choice(True, "write a GIF and an MP4")
    width: int = _pixels(1280, "width of a frame")
    height: int = _pixels(720, "height of a frame")
    fps: int = quantity(
        25,
        "count",
        "frames per second of the film",
        at_least=1,
        at_most=120,
        fix="25 is usual",
    )

    @property
    def keeps_stress(self) -> bool:
        """Whether snapshots hold stresses."""
        return self.stress or self.mode == "stress"

    @model_validator(mode="after")
    def _check_intervals(self) -> Output:
        if self.snapshot_interval < self.history_interval:
            raise ValueError(
                f"output.snapshot_interval = {self.snapshot_interval:g}: must be at least "
                f"output.history_interval = {self.history_interval:g} s; lengthen one or shorten "
                "the other"
            )
        return self
