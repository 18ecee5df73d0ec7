"""Other programs that take the same Runge-Kutta step, to time the engine against.

    peer = Plain.load()               # or a false `Skipped` with a reason, never an exception
    peer.prepare(scene)               # or (scene, columns, rows): as many of the scene's cells
    peer.advance(steps, threads=1)
    peer.state()                      # positions, velocities, impactor, time, ledger

Plain, Vectors and Numba compute what the engine computes without contact of pieces (`check`);
Lammps is another model of the same size.
"""

from .constants import Case, Skipped, State, lattice_of
from .lammps_peer import PLASTIC, ROTATIONAL, Lammps
from .native import Plain, Vectors
from .numba_peer import Numba

__all__ = [
    "PLASTIC",
    "ROTATIONAL",
    "Case",
    "Lammps",
    "Numba",
    "Plain",
    "Skipped",
    "State",
    "Vectors",
    "lattice_of",
]
