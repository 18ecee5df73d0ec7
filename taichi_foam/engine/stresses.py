"""Stresses of bonds outside a run: of a stored instant, or along a curve."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from taichi_foam.engine import runtime
from taichi_foam.laws.bond import BondFoam, BondLaw
from taichi_foam.laws.bond.base import TABLE_COLUMNS, TABLE_ROWS
from taichi_foam.scene import Scene

Array = NDArray[np.float64]
Numbers = ti.types.ndarray(dtype=ti.f64, ndim=1)
WholeNumbers = ti.types.ndarray(dtype=ti.i32, ndim=1)


def with_own_table(law: BondLaw, forget: Callable[[], None]) -> tuple[BondLaw, Any]:
    """A law to be called outside a lattice, and the field (1, TABLE_ROWS) that it looks up.

    The field is None for a law without one. `forget` is called before it is lost.
    """
    if not law.tabulated:
        return law, None
    table = ti.Vector.field(TABLE_COLUMNS, ti.f64)
    runtime.set_aside((1, TABLE_ROWS), table, forget)
    return law.with_table(table), table


@cache
def _kernel(law: BondLaw) -> tuple[Any, Any]:
    """The law's normal stress, mapped over arrays, and the table that it looks up."""
    law, table = with_own_table(law, _kernel.cache_clear)

    @ti.kernel
    def normal_stresses(
        c: law.Constants, strain: Numbers, worst: Numbers, broken: WholeNumbers, stress: Numbers
    ):
        for n in range(strain.shape[0]):
            stress[n] = law.normal_stress(c, strain[n], worst[n], broken[n])

    return normal_stresses, table


def normal_stresses(
    scene: Scene,
    strain: Array,
    worst: Array | float,
    broken: NDArray[np.bool_] | None = None,
    foam: BondFoam | None = None,
) -> Array:
    """Engineering stress [Pa] of the scene's foam, tension positive (Eq. 26, Fig. 19).

    Args:
        scene: whose foam and readings hold.
        strain: engineering strain now, any shape.
        worst: the most compressive strain so far (<= 0), of that shape or a number.
        broken: which bonds are broken, of that shape; default none.
        foam: that of a layer, in place of the scene's.
    """
    foam = foam or scene.foam
    runtime.start()
    flat = np.ascontiguousarray(strain, dtype=np.float64).ravel()
    history = np.ascontiguousarray(np.broadcast_to(worst, np.shape(strain))).ravel()
    torn = np.zeros(flat.size, dtype=np.int32)
    if broken is not None:
        torn[:] = broken.ravel()
    stress = np.empty_like(flat)
    law = foam.law_for(scene.model)
    constants = law.Constants(**foam.constants(scene.model))
    kernel, table = _kernel(law)
    if table is not None:
        table.from_numpy(foam.table[None])
    kernel(constants, flat, history, torn, stress)
    return stress.reshape(np.shape(strain))
