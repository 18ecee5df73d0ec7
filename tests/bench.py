"""A lattice on the bench: start it from any state, take steps, read it. No physics in here.

The lattices are the ones that runs borrow, so that each size compiles once a session.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from taichi_foam.engine import transfer
from taichi_foam.engine.features import Features, features_of
from taichi_foam.engine.lattice import Lattice, borrowed
from taichi_foam.engine.state import initial_state
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.results.result import Result
from taichi_foam.results.snapshot_file import values_of
from taichi_foam.scene import Base, Block, Foam, Model, Numerics, Output, Scene
from taichi_foam.scene.filling import filling
from taichi_foam.shim2000.impacts import paper_scene
from taichi_foam.simulation.simulate import Progress, run

# The one small block of these tests: 10 x 20 nodes, any size and cell shape.
COLUMNS, ROWS = 10, 20
ALL_A = [(i, j) for i in range(COLUMNS - 1) for j in range(ROWS)]
ALL_B = [(i, j) for i in range(COLUMNS) for j in range(ROWS - 1)]

FREE = Base(kind="floor")
LIFT = np.array([0.0, 0.5])  # m, clear of the floor
UNBREAKABLE = Foam(tensile_strain=1.0, shear_strain=2.0)
# only the forces of bonds, and of cells by their shear
PLAIN = Model(self_contact=False, crushed_room=False, shear_yield=False)

# Positions near 0.5 m are good to 6e-17 m, strains of 5 mm bonds to 2e-14, forces of K A = 792 N
# to 2e-11 N; what a node adds up, and the densified slope, up to 50 K, take it to 1e-9 N.
ROUNDING = 1e-9

# A step so short that the state hardly moves: its speeds over it are the accelerations.
INSTANT = 1e-12

Bonds = Iterable[tuple[int, int]]


def small_scene(dx: float = 0.005, dy: float = 0.005, **parts: object) -> Scene:
    """A scene on 10 x 20 nodes without impactor, 1 ms long unless told otherwise."""
    block = Block(
        mass_points="cells", width=COLUMNS * dx, height=ROWS * dy, columns=COLUMNS, rows=ROWS
    )
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
        (advance or transfer.advance_of(self.lattice))(self.lattice, steps)
        transfer.harvest(self.lattice)  # makes room for the next rows
        return transfer.snapshot(self.lattice, 0)

    @property
    def work(self) -> np.ndarray:
        """What every column of every lattice has booked (batch, columns, works) [J]."""
        size = self.lattice.size
        return self.lattice.state.work.to_numpy()[: size.batch, : size.columns]

    def snapshots(self) -> list[Snapshot]:
        return [transfer.snapshot(self.lattice, b) for b in range(self.lattice.size.batch)]


def groups_of(scenes: Sequence[Scene]) -> list[list[Scene]]:
    """Scenes that can share a batch, together, in their order."""
    groups: dict[Features, list[Scene]] = {}
    for scene in scenes:
        groups.setdefault(features_of(scene), []).append(scene)
    return list(groups.values())


@cache
def paper_run(name: str) -> Result:
    """A test of the paper; several tests look at the same ones."""
    return run(paper_scene(name))


@contextmanager
def bench(
    scenes: Scene | Sequence[Scene],
    *,
    broken_a: Bonds = (),
    broken_b: Bonds = (),
    **start: np.ndarray | None,
) -> Iterator[Bench]:
    """Load scenes; what is given replaces arrays of the first one's `State`.

    They have the same counts and features.
    """
    scenes = [scenes] if isinstance(scenes, Scene) else list(scenes)
    block = scenes[0].block
    state = initial_state(scenes[0])
    given = {name: value for name, value in start.items() if value is not None}
    for name, broken in (("break_time_a", broken_a), ("break_time_b", broken_b)):
        times = getattr(state, name).copy()
        for place in broken:
            times[place] = 0.0
        given[name] = times
    with borrowed(len(scenes), block.columns, block.rows, features_of(scenes[0])) as lattice:
        for b, each in enumerate(scenes):
            assert features_of(each) == lattice.features
            transfer.load(lattice, b, each, replace(state, **given) if b == 0 else None)
        transfer.set_pause(lattice, np.full(len(scenes), 1e30))
        yield Bench(lattice)


def node_forces(scene: Scene, **start: object) -> np.ndarray:
    """Force [N] on every node of a block that starts at rest, (I, J, 2).

    Over one step of INSTANT, dt, RK4 gives v = a dt (1 + O((w dt)^2)), and w dt < 1e-6. Dashpots,
    which would add a term in w dt, are off.
    """
    assert start.get("velocity") is None
    instant = scene.numerics.model_copy(update={"dt": INSTANT, "damping_time": 0.0})
    with bench(scene.model_copy(update={"numerics": instant}), **start) as loaded:
        return loaded.step(1).velocity * (filling(scene.block).mass[..., None] / INSTANT)


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


def assert_same_snapshots(one: Snapshot, other: Snapshot, but: Collection[str] = ()) -> None:
    """To the last bit, in all fields but these."""
    ours, theirs = values_of(one), values_of(other)
    assert ours.keys() == theirs.keys()
    for name in ours.keys() - {*but}:
        np.testing.assert_array_equal(ours[name], theirs[name], err_msg=name)


def interrupt_at(fraction: float) -> Callable[[Progress], None]:
    """What presses Ctrl-C when so much of a run, or of a series of drops, is done."""

    def press(progress: Progress) -> None:
        if progress.fraction >= fraction:
            raise KeyboardInterrupt

    return press


def assert_same(one: Result, other: Result, but: Collection[str] = ()) -> None:
    """Histories and snapshots to the last bit, of the latter all fields but these."""
    for name, column in one.history.items():
        np.testing.assert_array_equal(column, other.history[name], err_msg=name)
    for a, b in zip(one.snapshots, other.snapshots, strict=True):
        assert_same_snapshots(a, b, but)


def assert_same_run(one: Result, other: Result) -> None:
    """All of it, and also how it was computed and how it ended."""
    assert_same(one, other)
    for key in ("ended_by", "steps", "dt_min_s", "dt_max_s", "max_overlap_m", "after"):
        assert one.run.get(key) == other.run.get(key), key
