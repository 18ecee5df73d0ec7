"""The foam's law as curves, from the very functions that the engine calls (Fig. 19)."""

import contextlib
import itertools
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from taichi_foam.engine import runtime
from taichi_foam.engine.parameters import parameters_of
from taichi_foam.errors import UserError
from taichi_foam.laws import foam as foam_law
from taichi_foam.scene import Scene

Array = NDArray[np.float64]
Branch = tuple[Array, Array]

#: Compressive strain from which the unloading branch starts.
TURN = -0.40
#: Stress at which the loading curve leaves the figure, as a multiple of the plateau's.
TOP = 4.0


@ti.kernel
def _normal_stresses(
    foam: foam_law.Foam,  # pyright: ignore[reportGeneralTypeIssues]
    strain: ti.types.ndarray(dtype=ti.f64, ndim=1),  # pyright: ignore[reportInvalidTypeForm]
    worst: ti.types.ndarray(dtype=ti.f64, ndim=1),  # pyright: ignore[reportInvalidTypeForm]
    stress: ti.types.ndarray(dtype=ti.f64, ndim=1),  # pyright: ignore[reportInvalidTypeForm]
):
    for n in range(strain.shape[0]):
        stress[n] = foam_law.normal_stress(foam, strain[n], worst[n], 0)


def branches(scene: Scene) -> dict[str, Branch]:
    """Loading, unloading from `TURN`, and re-tension to fracture of the scene's foam.

    By name, engineering strain and stress [Pa] (n,), tension positive. Loading begins at fracture
    in tension and ends where the stress is `TOP` times the plateau's.
    """
    foam, record = scene.foam, foam_law.Foam(**parameters_of(scene)["foam"])
    corners = (foam.tensile_strain, foam.yield_strain, foam.densification_strain)
    # Cosine spacing towards locking, where the curve turns upwards.
    steep = np.cos(np.linspace(0.0, np.pi / 2, 400))
    locking = foam.locking_strain + (foam.densification_strain - foam.locking_strain) * steep
    down = np.concatenate([np.linspace(a, b, 60) for a, b in itertools.pairwise(corners)])
    strain = np.concatenate([down, locking[1:]])
    loading = _stress(record, strain, np.minimum(strain, 0.0))
    shown = -loading <= TOP * foam.plateau_stress

    turn = max(TURN, foam.densification_strain)
    unloaded = turn - foam.yield_strain
    back = np.linspace(turn, unloaded, 40)
    again = np.linspace(unloaded, foam.crushed_tensile_fraction * foam.tensile_strain, 40)
    return {
        "first loading": (strain[shown], loading[shown]),
        f"unloading from {-100 * turn:.0f} %": (back, _stress(record, back, turn)),
        "tension after crushing": (again, _stress(record, again, turn)),
    }


def _stress(foam: Any, strain: Array, worst: Array | float) -> Array:
    """Engineering stress [Pa] (n,) of an intact connection of foam that has met `worst`."""
    # A runtime that already works on another architecture does just as well.
    with contextlib.suppress(UserError):
        runtime.start()
    stress = np.empty_like(strain)
    history = np.ascontiguousarray(np.broadcast_to(worst, strain.shape))
    _normal_stresses(foam, strain, history, stress)
    return stress
