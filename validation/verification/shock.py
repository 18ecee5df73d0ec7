"""A long bar of foam, two columns wide, that a heavy plate hits: a plane compaction front.

The plate hardly slows down, so the front is steady. The bar stands on a support that stops the
foam behind the elastic precursor: a second, weaker front comes up from there. Foam between the two
is at yield and moves with the precursor's velocity until they meet; all is measured before.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.errors import RunError
from taichi_foam.results.result import Result
from taichi_foam.scene import Foam, Numerics, Output, Scene
from verification.jump import Front, front, locking_stress, precursor, thickness
from verification.runs import DENSITY, PLATE, bar, whole

Array = NDArray[np.float64]

VISCOSITY = 2.78e6 * 1e-6 / 0.057  # Pa s, Table 6: the damping of the paper's bonds

# Not to break: ringing foam behind a front must not tear in a test of its mean.
_WHOLE: Any = {"tensile_strain": 2.0, "shear_strain": 2.0, "crushed_tensile_stress": 0.0}
PAPER = Foam(**_WHOLE)
LOCKING_STRAIN = 0.80
# Rigid and locking as nearly as a lattice can be: the plateau of the paper's foam, but 50 times as
# stiff, and locked within one per cent of strain about 0.80.
LOCKING = Foam(
    youngs_modulus=139e6,
    shear_modulus=42e6,
    yield_strain=-0.001,
    densification_strain=-(LOCKING_STRAIN - 0.01),
    locking_strain=-(LOCKING_STRAIN + 0.01),
    **_WHOLE,
)

FOAMS = {"locking foam": LOCKING, "the paper's foam": PAPER}
VELOCITIES = (20.0, 50.0, 100.0, 150.0, 200.0)  # m/s
# One velocity, 100 m/s, in the paper's foam: cells [m], and shares of Table 6's viscosity.
CELLS = (0.010, 0.005, 0.0025, 0.00125)
SHARES = (1.0, 0.3, 0.1)
SMALL_SHARES = (0.03, 0.01, 0.0)
PROFILE_REACH = 0.08  # m about the front's middle: what is kept of its profile

UNTIL = 0.8  # of the time at which the two fronts meet
SETTLED = 0.4  # of the run is over before it counts as steady
SNAPSHOTS = 200


@dataclass(frozen=True)
class Shock:
    """One bar and plate."""

    foam: Foam
    velocity: float  # m/s
    cell: float = 0.005  # m
    viscosity: float = VISCOSITY  # Pa s
    length: float = 1.5  # m
    safety: float = 0.8

    @property
    def front(self) -> Front:
        """What the jump conditions say of the plate's front."""
        ahead = precursor(self.foam, DENSITY).velocity
        return front(self.foam, DENSITY, self.velocity - ahead)

    @property
    def rising(self) -> Front:
        """The front from the support, which stops the foam behind the precursor."""
        return front(self.foam, DENSITY, precursor(self.foam, DENSITY).velocity)

    @property
    def arrival(self) -> float:
        """When the precursor reaches the support [s]."""
        return self.length / precursor(self.foam, DENSITY).speed

    @property
    def end(self) -> float:
        """When to stop [s]: before the fronts meet."""
        plate, support = self.front.speed, self.rising.speed
        return UNTIL * (self.length + support * self.arrival) / (plate + support)

    @property
    def thickness(self) -> float:
        """Width of the plate's front by the dashpots, 10 to 90 % [m]."""
        return thickness(self.foam, self.front, DENSITY, self.viscosity)

    @property
    def locking_stress(self) -> float:
        """Reid and Peng's stress behind the plate's front [Pa]."""
        return locking_stress(self.foam, DENSITY, self.velocity, LOCKING_STRAIN)

    def dissipated(self, since: float, until: float) -> float:
        """What both fronts dissipate over a time [s], per section [J/m2]."""
        risen = until - max(since, self.arrival)
        plate, support = self.front, self.rising
        return plate.speed * plate.dissipated * (
            until - since
        ) + support.speed * support.dissipated * max(risen, 0.0)


@dataclass(frozen=True)
class Measured:
    """What the lattice gave in the steady part, in compression; SI units."""

    stress: float  # mean of the contact force over the section [Pa]
    swing: float  # standard deviation of the force's rows over their mean
    strain: float  # behind the front
    speed: float  # of the front in reference coordinates [m/s]
    thickness: float | None  # of the front [m], 10 to 90 % of its strain; none: not settled
    dissipated: float  # by crushing and dashpots, over what the jump conditions say
    residual: float  # the ledger's, over the plate's work
    broken: int


def scene(shock: Shock) -> Scene:
    """The bar as a scene.

    Densification stiffens within a step in a way that the automatic size does not foresee: fast
    fronts get a shorter one.
    """
    end = shock.end
    return bar(
        f"Shock, {shock.velocity:g} m/s",
        shock.length,
        shock.cell,
        shock.foam,
        shock.velocity,
        Numerics(
            damping_time=shock.viscosity / shock.foam.youngs_modulus,
            safety=min(shock.safety, 20.0 / shock.velocity),
            end=end,
        ),
        Output(history_interval=end / 1000, snapshot_interval=end / SNAPSHOTS),
    )


def measure(shock: Shock, result: Result) -> Measured:
    """Take the figures of the steady part of a run."""
    history, block = result.history, result.scene.block
    section = block.width * block.depth
    steady = history["time_s"] > SETTLED * shock.end
    time = history["time_s"][steady]
    force = PLATE * history["deceleration_m_s2"][steady] / section
    lost = (history["crushing_J"] + history["damping_J"])[steady] / section
    times, profiles, places = steady_front(shock, result)
    work = force.sum() * section * shock.velocity * np.diff(time).mean()
    return Measured(
        stress=float(force.mean()),
        swing=float(force.std() / force.mean()),
        strain=_behind(profiles, places, block.dy),
        speed=float(np.polyfit(times, places, 1)[0]),
        thickness=_thickness(*mean_profile(profiles, places, block.dy), shock.front),
        dissipated=float((lost[-1] - lost[0]) / shock.dissipated(time[0], time[-1])),
        residual=float(np.abs(history["residual_J"]).max() / work),
        broken=int(history["broken_bonds"][-1]),
    )


def steady_front(shock: Shock, result: Result) -> tuple[Array, Array, Array]:
    """Of the snapshots (n,) in the steady part: times [s], strains (n, rows - 1), places [m]."""
    dy, late = result.scene.block.dy, SETTLED * shock.end
    snapshots = [each for each in result.snapshots if each.time > late]
    profiles = np.array([strains(each.position, dy) for each in snapshots])
    places = np.array([place(profile, shock.front, dy) for profile in profiles])
    return np.array([each.time for each in snapshots]), profiles, places


def strains(position: Array, dy: float) -> Array:
    """Compressive strains (rows - 1,) of the first column, from the plate down."""
    return 1.0 - np.diff(position[0, :, 1])[::-1] / dy


def place(profile: Array, theory: Front, dy: float) -> float:
    """Where the strain is half way up the plate's front, in reference coordinates [m]."""
    level = 0.5 * (theory.ahead.strain + theory.strain)
    n = int(np.argmax(profile < level))  # the first bond that the front has not passed
    if n == 0:
        return 0.0
    return (n - (level - profile[n]) / (profile[n - 1] - profile[n]) + 0.5) * dy


def mean_profile(profiles: Array, places: Array, dy: float) -> tuple[Array, Array]:
    """Distances (m,) from a steady front's middle [m], and the mean strains there.

    As far behind the front as in all profiles, and as far ahead as that.
    """
    middles = (np.arange(profiles.shape[1]) + 0.5) * dy
    reach = min(places.min(), middles[-1] - places.max())
    distance = np.linspace(-reach, reach, 1001)
    rows = [
        np.interp(place + distance, middles, profile)
        for place, profile in zip(places, profiles, strict=True)
    ]
    return distance, np.mean(rows, axis=0)


def _behind(profiles: Array, places: Array, dy: float) -> float:
    """Mean strain over the first half of what the front has passed, over all profiles."""
    means = [
        profile[: max(1, round(0.5 * place / dy))].mean()
        for profile, place in zip(profiles, places, strict=True)
    ]
    return float(np.mean(means))


def _thickness(distance: Array, strain: Array, theory: Front) -> float | None:
    """From 10 to 90 % of the front's strain, both found from its middle outwards [m]."""
    share = (strain - theory.ahead.strain) / (theory.strain - theory.ahead.strain)
    middle = len(distance) // 2
    behind, ahead = share[middle::-1], share[middle:]
    if behind.max() < 0.9 or ahead.min() > 0.1:
        return None  # the front is thicker than what it has passed
    back = distance[middle::-1][np.argmax(behind > 0.9)]
    return float(distance[middle:][np.argmax(ahead < 0.1)] - back)


def compute(shock: Shock) -> dict[str, object]:
    """Run a bar: what was measured, what theory says, and the mean profile of the front."""
    try:
        result = whole(scene(shock))
    except RunError as error:
        return {"failed": str(error)}
    theory = shock.front
    _, profiles, places = steady_front(shock, result)
    distance, strain = mean_profile(profiles, places, result.scene.block.dy)
    kept = np.abs(distance) < PROFILE_REACH
    return {
        "measured": asdict(measure(shock, result)),
        "jump": {**asdict(theory), "thickness": shock.thickness},
        "locking_stress": shock.locking_stress,
        "steps": result.run["steps"],
        "profile": [[float(f"{x:.4g}") for x in values[kept]] for values in (distance, strain)],
    }


def plan() -> dict[str, Shock]:
    """All bars by name: both foams at all velocities, and one velocity in many lattices."""
    bars = {
        f"{name}, {velocity:g} m/s": Shock(foam, velocity)
        for name, foam in FOAMS.items()
        for velocity in VELOCITIES
    }
    for cell in CELLS:
        for share in SHARES:
            bars[lattice_name(cell, share)] = _lattice(cell, share)
    for share in SMALL_SHARES:
        bars[lattice_name(0.005, share)] = _lattice(0.005, share)
    return bars


def lattice_name(cell: float, share: float) -> str:
    """The name of a bar in the study of cells and dashpots."""
    return f"cells of {1e3 * cell:g} mm, {share:g} of the viscosity"


def _lattice(cell: float, share: float) -> Shock:
    # without dashpots the ringing foam meets the steepest part of its law
    safety = 0.8 if share >= 0.1 else 0.05
    return Shock(PAPER, 100.0, cell, share * VISCOSITY, length=0.75, safety=safety)
