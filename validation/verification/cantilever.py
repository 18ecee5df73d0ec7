"""A strip of foam, sawn into two arms, that a frictionless cylinder drives apart as it sinks in.

The cylinder holds the arms apart by a given opening while it comes nearer to the crack's tip. What
it costs to push it on is the energy release rate: a virtual shift of the cylinder by dy shortens
the arms by dy, so its force is F = -dU/da = Z G as long as the crack stays. Once the crack grows,
it runs ahead of the cylinder at a constant distance, and F dy is what a new face of Z dy costs.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.laws.bond.base import OPENING
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.results.result import Result
from taichi_foam.scene import (
    Base,
    Block,
    Cylinder,
    Foam,
    Model,
    Numerics,
    Output,
    Scene,
    Start,
)
from verification.beam import THEORIES, Arm
from verification.runs import whole

Array = NDArray[np.float64]

MODULUS, SHEAR_MODULUS = 2.78e6, 0.84e6
WIDTH = 0.057  # m, of the arms' section: the block's thickness
CYLINDER = 1e3  # kg: it does not slow down
DRAG = 100.0  # 1/s: the arms' slowest mode, at 220 /s, then has a fifth of critical damping
ROWS_PER_CELL = 20  # rows of the history while the cylinder sinks by a cell
ALL = THEORIES[-1]
CELLS = (0.010, 0.005)  # m
WHOLE = Foam(youngs_modulus=MODULUS, shear_modulus=SHEAR_MODULUS, tensile_strain=2.0)


@dataclass(frozen=True)
class Strip:
    """One strip; SI units. The cut comes from the top."""

    cell: float
    height: float  # of an arm, across the crack
    length: float  # of the strip
    cut: float  # depth
    radius: float  # of the cylinder
    travel: float  # how far it sinks
    speed: float = 0.125  # m/s; faster, mass points that the cylinder passes are thrown off it
    tensile_strain: float | None = None  # none: the foam does not break

    @property
    def columns(self) -> int:
        """Columns of mass points in an arm."""
        return round(self.height / self.cell)

    @property
    def arm(self) -> Arm:
        return Arm(MODULUS, SHEAR_MODULUS, self.height, WIDTH, self.columns)

    @property
    def deflection(self) -> float:
        """Of an arm's inner column of mass points, which stands half a cell off the cut [m]."""
        return self.radius - 0.5 * self.cell

    def arm_length(self, distance: float) -> float:
        """Length of the arms when the cylinder's axis is so far from the tip [m].

        It touches below its axis, where its slope is that of the arms, 3 delta / (2 a).
        """
        return distance - self.radius * 1.5 * self.deflection / (
            distance + self.arm.chi * self.height
        )

    @property
    def tip(self) -> float:
        """Height of the cut's end [m]."""
        return self.length - self.cut

    @property
    def link_energy(self) -> float:
        """Energy of a bond that breaks, over its share of the crack's face [J/m2]."""
        assert self.tensile_strain is not None
        return 0.5 * MODULUS * self.tensile_strain**2 * self.cell


@dataclass(frozen=True)
class Pushed:
    """What the cylinder met, cell by cell of its way: arrays (n,)."""

    length: Array  # from where the cylinder touches to the crack's tip [m]
    force: Array  # mean over a cell, per width [N/m] = [J/m2]
    energy: Array  # that the strip stores [J]
    tip_strain: Array  # of the first whole bond ahead of the tip


def scene(strip: Strip) -> Scene:
    """The strip as a scene.

    Only bonds in tension may break: the arms are bent far below the other limits. Contact is
    soft, since nothing presses hard, and allows long steps.
    """
    foam = WHOLE
    if strip.tensile_strain is not None:
        # its bonds break at this strain, at once
        held = OPENING * strip.link_energy
        strain = strip.tensile_strain
        update = {"tensile_strain": strain, "fracture_energy": held, "softening": False}
        foam = foam.model_copy(update=update)
    rows = round(strip.length / strip.cell)
    sound = MODULUS / Block().density
    interval = strip.cell / strip.speed / ROWS_PER_CELL
    return Scene(
        name="Double cantilever",
        block=Block(
            width=2 * strip.height,
            height=strip.length,
            depth=WIDTH,
            columns=2 * strip.columns,
            rows=rows,
            mass_points="cells",
        ),
        foam=foam,
        impactor=Cylinder(radius=strip.radius, mass=CYLINDER, velocity=strip.speed, friction=0.0),
        base=Base(kind="gripped"),
        model=Model(
            damping="absolute",
            self_contact=False,
            shear_failure="tension-only",
        ),
        numerics=Numerics(
            damping_time=DRAG * strip.cell**2 / sound,
            contact_stiffness=4.0,
            end=strip.travel / strip.speed,
        ),
        start=Start(cuts=((0.0, strip.tip, 0.0, 1.1 * strip.length),)),
        output=Output(history_interval=interval, snapshot_interval=ROWS_PER_CELL * interval),
    )


def measure(strip: Strip, result: Result) -> Pushed:
    """Means over the cells of the cylinder's way, from where it is in by a diameter."""
    history = result.history
    rows = range(ROWS_PER_CELL, len(history["time_s"]), ROWS_PER_CELL)
    sunk = history["displacement_m"]
    force = CYLINDER * history["deceleration_m_s2"] / WIDTH
    stored = history["strain_J"] + history["shear_J"]
    found = []
    for n, end in enumerate(rows, start=1):
        axis = strip.length - 0.5 * strip.cell - sunk[end - ROWS_PER_CELL // 2] + strip.radius
        if sunk[end] < 2 * strip.radius or n >= len(result.snapshots):
            continue
        cell = slice(end - ROWS_PER_CELL + 1, end + 1)
        tip, strain = _tip(strip, result.snapshots[n])
        found.append(
            (strip.arm_length(axis - tip), force[cell].mean(), stored[cell].mean(), strain)
        )
    return Pushed(*np.array(found).T)


def _tip(strip: Strip, snapshot: Snapshot) -> tuple[float, float]:
    """Height of the crack's tip [m], between two bonds, and the strain ahead of it."""
    middle = strip.columns - 1
    rows = round(strip.tip / strip.cell)
    broken = np.flatnonzero(snapshot.broken_a[middle, :rows])
    first = int(broken[0]) if len(broken) else rows
    ahead = snapshot.position[middle : middle + 2, first - 1]
    return first * strip.cell, float(np.linalg.norm(ahead[1] - ahead[0]) / strip.cell - 1.0)


def toughness(strip: Strip, pushed: Pushed) -> float:
    """How many times the energy of its bond at the tip the release rate is.

    Of a strip whose crack stands still, by the beam's release rate; the median over its way. A
    bond then breaks when the release rate is this many times K e_t^2 dx / 2.
    """
    theory = np.array([strip.arm.release(strip.deflection, a, ALL) for a in pushed.length])
    linked = 0.5 * MODULUS * pushed.tip_strain**2 * strip.cell
    return float(np.median(theory / linked))


def growth(strip: Strip, pushed: Pushed, result: Result) -> dict[str, float]:
    """What a growing crack took: figures per area of its face [J/m2].

    The beam's share is what the arms give back, at a given opening, as they become longer. Drag
    also takes something from arms that move along a standing crack: as much per way of the cylinder
    as before the crack began to grow.
    """
    first = len(result.snapshots) - len(pushed.length)
    ends = ROWS_PER_CELL * np.arange(first, len(result.snapshots))
    history = result.history
    lost = history["damping_J"][ends] + history["fracture_J"][ends] + history["crushing_J"][ends]
    advances = np.rint((np.diff(pushed.length) + strip.cell) / strip.cell).clip(0) * strip.cell
    grows = np.flatnonzero(advances)
    begins = grows[0]
    face = float(advances[begins:].sum()) * WIDTH
    idle = (lost[begins] - lost[0]) / begins  # in the time of one cell
    taken = lost[-1] - lost[begins]
    released = [
        strip.arm.energy(strip.deflection, pushed.length[n], ALL)
        - strip.arm.energy(strip.deflection, pushed.length[n] + advances[n], ALL)
        for n in grows
    ]
    starts = [strip.arm.release(strip.deflection, pushed.length[n], ALL) for n in grows]
    return {
        "grown_m": face / WIDTH,
        "dissipated": float(taken) / face,
        "idle": float(idle * (len(lost) - 1 - begins)) / face,
        "released": float(sum(released)) / face,
        "at_start": float(np.median(starts)),
        "fracture": float(history["fracture_J"][-1]) / face,
        "strays": strays(strip, result),
    }


def strays(strip: Strip, result: Result) -> int:
    """Bonds that have broken off the strip's middle line."""
    last = result.snapshots[-1]
    off = last.broken_a.copy()
    off[strip.columns - 1] = False
    return int(off.sum() + last.broken_b.sum())


def compute(strip: Strip) -> dict[str, Any]:
    """Run a strip; what the cylinder met, and what the crack took."""
    result = whole(scene(strip))
    pushed = measure(strip, result)
    found = {"pushed": {name: values.tolist() for name, values in asdict(pushed).items()}}
    if strip.tensile_strain is None:
        return {**found, "toughness": toughness(strip, pushed)}
    return {**found, "growth": growth(strip, pushed, result)}


def plan() -> dict[str, Strip]:
    """All strips by name: a crack that stands, in two cells; one that grows, in two sizes.

    The second of these is the first at half its size, cells and all.
    """
    standing = Strip(0.005, height=0.06, length=0.5, cut=0.35, radius=0.02, travel=0.20)
    growing = Strip(0.010, 0.06, 0.7, 0.30, 0.02, travel=0.36, speed=0.25, tensile_strain=0.03)
    half = Strip(0.005, 0.03, 0.35, 0.15, 0.01, travel=0.18, speed=0.25, tensile_strain=0.03)
    return {
        "standing, 10 mm": replace(standing, cell=0.010),
        "standing, 5 mm": standing,
        "growing, 10 mm": growing,
        "growing, 5 mm": half,
    }
