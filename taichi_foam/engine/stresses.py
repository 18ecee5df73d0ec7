"""Stresses outside a run: of bonds at given strains, and about the mass points of a snapshot."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.backend import ti
from taichi_foam.engine import runtime, virial
from taichi_foam.engine.features import features_of
from taichi_foam.engine.lattice import borrowed
from taichi_foam.engine.state import NEVER, initial_state
from taichi_foam.engine.transfer import load, unload
from taichi_foam.laws.bond import BondLaw
from taichi_foam.laws.bond.base import TABLE_ROWS
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Scene

Array = NDArray[np.float64]
Numbers = ti.types.ndarray(dtype=ti.f64, ndim=1)
WholeNumbers = ti.types.ndarray(dtype=ti.i32, ndim=1)


def with_own_table(law: BondLaw, forget: Callable[[], None]) -> tuple[BondLaw, Any]:
    """A law for use outside a lattice, and the field (1, TABLE_ROWS) of its table.

    The field is None for a law without a table. `forget` is called before the field is lost.
    """
    if not law.tabulated:
        return law, None
    table = ti.Vector.field(law.table_columns, ti.f64)
    runtime.set_aside((1, TABLE_ROWS), table, forget)
    return law.with_table(table), table


@cache
def _kernel(law: BondLaw) -> tuple[Any, Any]:
    """A kernel that maps the law's normal stress over arrays, and the field of its table."""
    law, table = with_own_table(law, _kernel.cache_clear)

    @ti.kernel
    def normal_stresses(
        c: law.Constants, strain: Numbers, worst: Numbers, broken: WholeNumbers, stress: Numbers
    ):
        for n in range(strain.shape[0]):
            history = law.History(worst=worst[n])
            stress[n] = law.normal_stress(c, strain[n], history, broken[n])

    return normal_stresses, table


def normal_stresses(
    scene: Scene,
    strain: Array,
    worst: Array | float,
    broken: NDArray[np.bool_] | None = None,
) -> Array:
    """Engineering stress [Pa] of the scene's foam, tension positive (Eq. 26, Fig. 19).

    Args:
        scene: gives the foam and the model choices.
        strain: engineering strain now, any shape.
        worst: the most compressive strain so far (<= 0), of that shape or a number.
        broken: which bonds are broken, of that shape; default none.
    """
    runtime.start()
    flat = np.ascontiguousarray(strain, dtype=np.float64).ravel()
    history = np.ascontiguousarray(np.broadcast_to(worst, np.shape(strain))).ravel()
    torn = np.zeros(flat.size, dtype=np.int32)
    if broken is not None:
        torn[:] = broken.ravel()
    stress = np.empty_like(flat)
    law = scene.foam.law_for(scene.model)
    constants = law.Constants(**scene.foam.constants(scene.model))
    kernel, table = _kernel(law)
    if table is not None:
        table.from_numpy(scene.foam.table[None])
    kernel(constants, flat, history, torn, stress)
    return stress.reshape(np.shape(strain))


def cell_stresses(scene: Scene, snapshot: Snapshot) -> NDArray[np.float32]:
    """Stress xx, yy and xy [Pa] about each mass point of a snapshot (I, J, 3), tension positive.

    It is the stress that the run kept, or else is recomputed from the snapshot. The recomputed
    stress lacks friction, contact of pieces, contact dashpots, and the softening of bonds.
    """
    if snapshot.stress is not None:
        return snapshot.stress
    # a snapshot does not contain the impactor's velocity
    undamped = scene.numerics.model_copy(update={"contact_damping": 0.0})
    scene = scene.model_copy(update={"numerics": undamped})
    start = initial_state(scene)
    moved = {"x": snapshot.impactor_shift, "angle": snapshot.impactor_angle}
    turn = {**start.turn, **moved} if scene.turns else start.turn
    instant = replace(
        start,
        position=np.asarray(snapshot.position, dtype=np.float64),
        velocity=np.asarray(snapshot.velocity, dtype=np.float64),
        worst_a=np.asarray(snapshot.e_min_a, dtype=np.float64),
        worst_b=np.asarray(snapshot.e_min_b, dtype=np.float64),
        break_time_a=snapshot.break_time_a,
        break_time_b=snapshot.break_time_b,
        shear_set=np.asarray(snapshot.shear_set, dtype=np.float64),
        own={name: np.asarray(each, dtype=np.float64) for name, each in snapshot.own.items()},
        clock={**start.clock, "stiffest": 0.0},
        body={**start.body, "y": snapshot.impactor_y if scene.impactor is not None else NEVER},
        turn=turn,
    )
    block = scene.block
    with borrowed(1, block.columns, block.rows, features_of(scene)) as lattice:
        load(lattice, 0, scene, instant)
        try:
            return virial.stresses(lattice, 0, block)
        finally:
            unload(lattice, 0)
