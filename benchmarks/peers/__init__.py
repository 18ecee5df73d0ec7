"""Other programs that take the same Runge-Kutta step, to time the engine against.

    peer = Plain.load()               # or `Skipped` with a reason: not installed
    peer.prepare(scene)
    peer.advance(steps, threads=1)
    peer.state()                      # positions, impactor, time, ledger

Plain, Vectors and Numba compute what the engine computes without contact of pieces, Vectors with
room and softening where asked (`check`). Batch is a prototype, with many lattices side by side:
one in each lane of a vector. Lammps is another model of the same size.
"""

from .constants import Case, Skipped, State
from .lammps_peer import PLASTIC, ROTATIONAL, Lammps
from .native import Batch, Plain, Vectors
from .numba_peer import Numba
from .scenes import CASE, EXTENTS, Choices, Extent, batch_of, lattice_of, scene_with, updated

__all__ = [
    "CASE",
    "EXTENTS",
    "PLASTIC",
    "ROTATIONAL",
    "Batch",
    "Case",
    "Choices",
    "Extent",
    "Lammps",
    "Numba",
    "Plain",
    "Skipped",
    "State",
    "Vectors",
    "batch_of",
    "lattice_of",
    "scene_with",
    "updated",
]
