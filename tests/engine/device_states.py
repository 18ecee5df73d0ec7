"""What `test_gpu` compares: states and results, computed on the architecture that is asked for.

`python device_states.py ARCH FILE` computes them in a process of its own, as a process has one
architecture. Every lattice compiles its kernels anew, which takes a software device up to a minute:
parts have the same size and features where they can, and so share one.
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
import taichi as ti
from taichi._lib import core

sys.path.insert(0, str(Path(__file__).parents[1]))

from bench import bench, groups_of
from test_same_numbers import EVERYTHING

from taichi_foam.engine import runtime, transfer
from taichi_foam.engine.features import features_of
from taichi_foam.engine.lattice import Lattice, borrowed
from taichi_foam.engine.layout import BLOCK_NODES, THREADS
from taichi_foam.laws.bond import Curve
from taichi_foam.scene import (
    Base,
    Block,
    Cylinder,
    FlatBlock,
    Impactor,
    Numerics,
    Output,
    Scene,
    Support,
    TabulatedFoam,
    Wedge,
)
from taichi_foam.simulation.simulate import run_many

# More nodes than a block has threads; and more than one block steps by itself.
SMALL, BIG = (15, 20), (96, 43)
LATTICES = 4
ALONE = 2  # the place of the lattice that is stepped alone, too
assert THREADS < SMALL[0] * SMALL[1] <= BLOCK_NODES < BIG[0] * BIG[1]

STEPS_PAD = 100  # nothing has broken yet
STEPS_OPTIONS = 700  # free bodies are rounded, and touch later
STEPS_AFTER = 400  # some bonds break on the way
STEPS_BIG = 120
STEPS_ENSEMBLE = 620  # at most, to the end of the runs that break

ENERGIES = ("foam_kinetic_J", "strain_J", "crushing_J", "shearing_J", "damping_J", "fracture_J")

States = dict[str, np.ndarray]


WEDGE = Wedge(angle_deg=60, shank_width=0.03, mass=0.1, velocity=14.0, x=1e-4)


def struck(impactor: Impactor, mass_points: Literal["cells", "faces"] = "faces") -> Scene:
    """An impact on a small block.

    The impactor is to be beside the middle, so that rounding does not say to which side of a
    wedge its point goes.
    """
    columns, rows = SMALL
    return Scene(
        block=Block(
            mass_points=mass_points,
            width=0.005 * columns,
            height=0.005 * rows,
            columns=columns,
            rows=rows,
        ),
        impactor=impactor,
        numerics=Numerics(end=2.0e-3),
        output=Output(history_interval=1e-4, snapshot_interval=1e-3),
    )


def breaking_scenes() -> list[Scene]:
    """Fast impactors of the paper's three shapes, and a faster wedge.

    They touch within a step, not at once: rounding is not to say whether the first stage is damped.
    """
    shapes = (
        WEDGE,
        FlatBlock(width=0.03, mass=0.1, velocity=14.5, x=1e-4),
        Cylinder(radius=0.015, mass=0.1, velocity=13.0, x=1e-4),
        WEDGE.model_copy(update={"velocity": 15.75}),
    )
    return [struck(impactor.model_copy(update={"gap": 1e-5})) for impactor in shapes]


def option_scenes() -> list[Scene]:
    """Wedges, with every option, on a block with a cut, off the rails.

    At a third of the speed: in STEPS_OPTIONS the foam flows, and breaks little.
    """
    return [
        struck(
            WEDGE.model_copy(
                update={"velocity": 4.0 + 0.1 * b, "guided": False, "spin": 40.0 * b - 60.0}
            ),
            "cells",
        ).model_copy(update=EVERYTHING)
        for b in range(LATTICES)
    ]


def big_scenes() -> list[Scene]:
    """Impacts so fast that they crush and break a fine lattice in a few dozen steps."""
    columns, rows = BIG
    block = Block(
        mass_points="cells", width=1e-3 * columns, height=1e-3 * rows, columns=columns, rows=rows
    )
    return [
        Scene(block=block, impactor=impactor, numerics=Numerics(end=1.0), **parts)
        for impactor, parts in (
            (Wedge(angle_deg=60, shank_width=0.02, mass=0.1, velocity=150.0), {}),
            (FlatBlock(width=0.02, mass=0.1, velocity=120.0, rotation_deg=20), {}),
            (
                FlatBlock(width=0.02, mass=0.1, velocity=60.0, rotation_deg=20, guided=False),
                EVERYTHING,
            ),
        )
    ]


def pad_scenes() -> list[Scene]:
    """A pad with oblique sides and a hole, of two foams by their curves, on ribs."""
    columns, rows = SMALL
    width, height = 0.005 * columns, 0.005 * rows
    half, strain = 0.5 * width, (0, 0.05, 0.6, 0.8, 0.9)
    soft, stiff = (
        TabulatedFoam(curve=Curve(strain=strain, stress=[plateau * s for s in (0, 1, 1.2, 3, 9)]))
        for plateau in (120e3, 200e3)
    )
    block = Block(
        mass_points="cells",
        width=width,
        height=height,
        columns=columns,
        rows=rows,
        outline=[(-half, 0), (half, 0), (0.6 * half, height), (-0.7 * half, height)],
        holes=[[(-0.01, 0.03), (0.012, 0.03), (0.0, 0.052)]],
        layers=[{"bottom": 0.06, "top": height, "foam": stiff, "density": 40.0}],
    )
    return [
        Scene(
            block=block,
            foam=soft,
            impactor=FlatBlock(width=0.05, mass=0.1, velocity=velocity),
            base=Base(kind="floor"),
            support=Support(kind="ribs", pitch=0.02, width=0.01, depth=0.01),
            numerics=Numerics(end=2.0e-3, gravity=9.81),
        )
        for velocity in (8.0, 9.0)
    ]


def states_of(scenes: list[Scene], steps: int) -> States:
    """Positions, histories and impactors after some steps, lattice by lattice."""
    parts = []
    for group in groups_of(scenes):
        with bench(group) as loaded:
            loaded.step(steps)
            parts.append(_states(loaded.lattice, len(group)))
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def alone(scene: Scene, steps: int) -> States:
    """The same for one scene on a lattice of a batch whose other places stay empty."""
    with borrowed(LATTICES, *SMALL, features_of(scene)) as lattice:
        for b in range(LATTICES):
            transfer.unload(lattice, b)
        transfer.load(lattice, 0, scene)
        transfer.set_pause(lattice, np.full(LATTICES, 1e30))
        transfer.advance_of(lattice)(lattice, steps)
        transfer.harvest(lattice)
        return _states(lattice, 1)


def _states(lattice: Lattice, count: int) -> States:
    snapshots = [transfer.snapshot(lattice, b) for b in range(count)]
    return {
        "position": np.stack([each.position for each in snapshots]),
        "velocity": np.stack([each.velocity for each in snapshots]),
        "e_min_a": np.stack([each.e_min_a for each in snapshots]),
        "impactor_y": np.array([each.impactor_y for each in snapshots]),
        "impactor_angle": np.array([each.impactor_angle for each in snapshots]),
        "impactor_shift": np.array([each.impactor_shift for each in snapshots]),
        "time": np.array([each.time for each in snapshots]),
        "broken": np.array([each.broken_a.sum() + each.broken_b.sum() for each in snapshots]),
    }


def ensemble() -> States:
    """Of each breaking run: depth, broken bonds, energies at the end, and the residual."""
    histories = [result.history for result in run_many(breaking_scenes())]
    ends = {name: np.array([history[name][-1] for history in histories]) for name in ENERGIES}
    return ends | {
        "depth": np.array([history["displacement_m"].max() for history in histories]),
        "broken": np.array([history["broken_bonds"][-1] for history in histories]),
        "residual": np.array([np.abs(history["residual_J"]).max() for history in histories]),
        "impact": np.array([history["impactor_kinetic_J"][0] for history in histories]),
    }


def misplaced() -> np.ndarray:
    """Fields of 64-bit numbers at addresses that are no multiples of eight.

    Taichi packs Vulkan's fields without padding, and such a number is read from another address.
    """
    pads, free = pad_scenes(), option_scenes()
    named = []
    for count, scene in (
        (LATTICES, breaking_scenes()[0]),
        (len(free), free[0]),
        (len(pads), pads[0]),
    ):
        with borrowed(count, *SMALL, features_of(scene)) as lattice:
            named += [
                (name, scalar)
                for part in (lattice.model, lattice.state, lattice.scratch)
                for name, field in vars(part).items()
                for scalar in _scalars(field)
                if scalar.dtype == ti.f64
            ]
    return np.array([name for name, scalar in named if _is_misplaced(scalar)], dtype=str)


def _scalars(field: Any) -> Iterator[Any]:
    if isinstance(field, ti.StructField):
        for name in field.keys:
            yield from _scalars(field.get_member_field(name))
    elif isinstance(field, ti.MatrixField):
        yield from (field.get_scalar_field(n) for n in range(field.n))
    elif isinstance(field, ti.ScalarField):
        yield field


def _is_misplaced(scalar: Any) -> bool:
    node, distances = scalar.snode, []
    while node is not None and node.ptr.type != core.SNodeType.root:
        distances.append(node._offset_bytes_in_parent_cell)
        if node.ptr.type != core.SNodeType.place:
            distances.append(node._cell_size_bytes)
        node = node.parent()
    return any(distance % 8 for distance in distances)


def everything() -> States:
    """All that is compared, as `part/name`."""
    parts = {
        "after": states_of(breaking_scenes(), STEPS_AFTER),
        "alone": alone(breaking_scenes()[ALONE], STEPS_AFTER),
        "ensemble": ensemble(),
        "options": states_of(option_scenes(), STEPS_OPTIONS),
        "big": states_of(big_scenes(), STEPS_BIG),
        "pad": states_of(pad_scenes(), STEPS_PAD),
    }
    named = {f"{part}/{name}": x for part, xs in parts.items() for name, x in xs.items()}
    device = str(runtime.settings().get("device", ""))
    return named | {"misplaced": misplaced(), "device": np.array(device)}


def main() -> None:
    arch, file = sys.argv[1:]
    runtime.start(arch)
    np.savez(file, **everything())


if __name__ == "__main__":
    main()
