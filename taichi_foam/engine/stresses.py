"""Stresses of bonds outside a run: of a stored instant, or along a curve."""

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from taichi_foam.engine import runtime
from taichi_foam.engine.parameters import parameters_of
from taichi_foam.laws import foam as foam_law
from taichi_foam.scene import Scene

Array = NDArray[np.float64]
Numbers = ti.types.ndarray(dtype=ti.f64, ndim=1)


@ti.kernel
def _normal_stresses(
    foam: foam_law.Foam,
    strain: Numbers,
    worst: Numbers,
    broken: ti.types.ndarray(dtype=ti.i32, ndim=1),
    stress: Numbers,
):
    for n in range(strain.shape[0]):
        stress[n] = foam_law.normal_stress(foam, strain[n], worst[n], broken[n])


def normal_stresses(
    scene: Scene, strain: Array, worst: Array | float, broken: NDArray[np.bool_] | None = None
) -> Array:
    """Engineering stress [Pa] of the scene's foam, tension positive (Eq. 26, Fig. 19).

    Args:
        scene: whose foam and readings hold.
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
    _normal_stresses(foam_law.Foam(**parameters_of(scene)["foam"]), flat, history, torn, stress)
    return stress.reshape(np.shape(strain))
