"""A lattice on the bench: start it from any state, take steps, read it. No physics in here.

The lattices are the ones that runs borrow, so that each size compiles once a session.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_foam.engine import loading, stepper
from taichi_foam.engine.lattice import BROKEN, Lattice, borrowed
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Block, Numerics, Output, Scene

# The one small block of these tests: 10 x 20 nodes, any size and cell shape.
COLUMNS, ROWS = 10, 20

# A step so short that the state hardly moves: its speeds over it are the accelerations.
INSTANT = 1e-12

Links = Iterable[tuple[int, int]]


def small_scene(dx: float = 0.005, dy: float = 0.005, **parts: object) -> Scene:
    """A scene on 10 x 20 nodes without impactor, 1 ms long unless told otherwise."""
    block = Block(width=COLUMNS * dx, height=ROWS * dy, columns=COLUMNS, rows=ROWS)
    return Scene(**{"block": block, "numerics": Numerics(end=1e-3), **parts})


def numerics(**values: object) -> Numerics:
    """Numerics that end at 1 s: the bench stops by steps or by `pause`."""
    return Numerics(**{"end": 1.0, **values})


@dataclass
class Bench:
    """A loaded lattice."""

    lattice: Lattice

    def step(self, steps: int, advance: Callable | None = None) -> Snapshot:
        """Take exactly `steps` steps, and return the first lattice's state."""
        (advance or stepper.advance_of(self.lattice))(self.lattice, steps)
        loading.harvest(self.lattice)  # makes room for the next rows
        return loading.snapshot(self.lattice, 0)

    def snapshots(self) -> list[Snapshot]:
        return [loading.snapshot(self.lattice, b) for b in range(self.lattice.batch)]


@contextmanager
def bench(
    scenes: Scene | Sequence[Scene],
    *,
    position: np.ndarray | None = None,
    velocity: np.ndarray | None = None,
    broken_a: Links = (),
    broken_b: Links = (),
    worst_a: np.ndarray | None = None,
    worst_b: np.ndarray | None = None,
) -> Iterator[Bench]:
    """Load scenes; what is given replaces the first lattice's start ((I, J, 2), or by bond)."""
    scenes = [scenes] if isinstance(scenes, Scene) else list(scenes)
    block = scenes[0].block
    with borrowed(len(scenes), block.columns, block.rows) as lattice:
        for b, each in enumerate(scenes):
            loading.load(lattice, b, each)
        for values, names in ((position, "xy"), (velocity, "uv")):
            for component, name in enumerate(names if values is not None else ""):
                for motion in (lattice.state, lattice.trial):
                    set_nodes(motion.get_member_field(name), values[..., component])
        given = ((lattice.bond_a, broken_a, worst_a), (lattice.bond_b, broken_b, worst_b))
        for bonds, broken, worst in given:
            if worst is not None:
                set_nodes(bonds.get_member_field("worst"), worst)
            for i, j in broken:
                bonds.get_member_field("condition")[0, i, j // lattice.lanes][j % lattice.lanes] = (
                    BROKEN
                )
        loading.set_pause(lattice, np.full(len(scenes), 1e30))
        for b in range(len(scenes)):
            stepper.prepare(lattice, b)
        yield Bench(lattice)


def set_nodes(field: Any, values: np.ndarray) -> None:
    """Set a node field of the first lattice in nodes (i, j) < values.shape."""
    packs = field.to_numpy()
    columns = packs[0].reshape(packs.shape[1], -1)
    lanes = packs.shape[-1]
    columns[1 : 1 + values.shape[0], lanes : lanes + values.shape[1]] = values
    field.from_numpy(packs)


def node_forces(scene: Scene, **start: object) -> np.ndarray:
    """Force [N] on every node of a block that starts at rest, (I, J, 2).

    Over one step of INSTANT, dt, RK4 gives v = a dt (1 + O((w dt)^2)), and w dt < 1e-6. Dashpots,
    which would add a term in w dt, are off.
    """
    assert start.get("velocity") is None
    instant = scene.numerics.model_copy(update={"dt": INSTANT, "damping_time": 0.0})
    with bench(scene.model_copy(update={"numerics": instant}), **start) as loaded:
        return loaded.step(1).velocity * (scene.block.node_mass / INSTANT)


def run_to(scene: Scene, time: float, steps: int, **start: object) -> Snapshot:
    """State at `time` after `steps` equal steps."""
    given = numerics(
        dt=time / steps,
        damping_time=scene.numerics.damping_time,
        gravity=scene.numerics.gravity,
        contact_stiffness=scene.numerics.contact_stiffness,
    )
    output = Output(history_interval=max(time / 4, 1e-7), snapshot_interval=1.0)
    scene = scene.model_copy(update={"numerics": given, "output": output})
    with bench(scene, **start) as loaded:
        return loaded.step(steps)
