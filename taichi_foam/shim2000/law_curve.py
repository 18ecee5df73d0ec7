"""The foam's law as curves, from the very functions that the engine calls (Fig. 19)."""

import itertools

import numpy as np
from numpy.typing import NDArray

from taichi_foam.engine.stresses import normal_stresses
from taichi_foam.scene import Scene

Array = NDArray[np.float64]
Branch = tuple[Array, Array]

#: Compressive strain from which the unloading branch starts.
TURN = -0.40
#: Stress at which the loading curve leaves the figure, as a multiple of the plateau's.
TOP = 4.0


def branches(scene: Scene) -> dict[str, Branch]:
    """Loading, unloading from `TURN`, and re-tension to fracture of the scene's foam.

    By name, engineering strain and stress [Pa] (n,), tension positive. Loading begins at fracture
    in tension and ends where the stress is `TOP` times the plateau's.
    """
    marks = scene.foam.landmarks
    corners = (marks.tensile, marks.crush_start, marks.crush_end)
    # Cosine spacing towards locking, where the curve turns upwards.
    steep = np.cos(np.linspace(0.0, np.pi / 2, 400))
    locking = marks.limit + (marks.crush_end - marks.limit) * steep
    down = np.concatenate([np.linspace(a, b, 60) for a, b in itertools.pairwise(corners)])
    strain = np.concatenate([down, locking[1:]])
    loading = normal_stresses(scene, strain, np.minimum(strain, 0.0))
    shown = -loading <= TOP * marks.plateau_stress

    turn = max(TURN, marks.crush_end)
    unloaded = float(scene.foam.permanent_strain(np.array(turn)))
    back = np.linspace(turn, unloaded, 40)
    again = np.linspace(unloaded, marks.crushed_tensile, 40)
    return {
        "first loading": (strain[shown], loading[shown]),
        f"unloading from {-100 * turn:.0f} %": (back, normal_stresses(scene, back, turn)),
        "tension after crushing": (again, normal_stresses(scene, again, turn)),
    }
