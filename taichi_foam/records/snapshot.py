"""One instant of a lattice."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from taichi_foam.records.cushion import BONDS_A, BONDS_B, CELLS, NODES, Per

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Snapshot:
    """One instant of one lattice of I x J mass points.

    time          s
    impactor_y    m, height of the impactor's lowest point; NaN without one. For an impactor that
                  rotates: of its initially lowest point, moved with its centre of mass
    position      (I, J, 2) m, x and y of mass point (i, j)
    velocity      (I, J, 2) m/s
    e_min_a       (I-1, J), worst compressive strain so far of bond A(i,j), <= 0
    e_min_b       (I, J-1), the same for bond B(i,j)
    break_time_a  (I-1, J) s, when bond A(i,j) broke; NaN while intact
    break_time_b  (I, J-1) s, the same for bond B(i,j)
    shear_set     (I-1, J-1), lasting shear strain of cell (i, j)
    impactor_shift  m, how far the impactor's centre of mass has moved sideways since the start
    impactor_angle  rad, its rotation about its centre of mass, counter-clockwise
    own           what bonds remember besides, by the names of `records.cushion.remembered`
    stress        (I, J, 3) Pa, xx, yy and xy about mass point (i, j), tension positive, 32 bits;
                  see `engine.virial`. None if the run does not keep it
    """

    time: Annotated[float, Per(None)]
    impactor_y: Annotated[float, Per(None)]
    position: Annotated[Array, Per(NODES, (2,))]
    velocity: Annotated[Array, Per(NODES, (2,))]
    e_min_a: Annotated[Array, Per(BONDS_A)]
    e_min_b: Annotated[Array, Per(BONDS_B)]
    break_time_a: Annotated[Array, Per(BONDS_A)]
    break_time_b: Annotated[Array, Per(BONDS_B)]
    shear_set: Annotated[Array, Per(CELLS, absent=0.0)]
    impactor_shift: Annotated[float, Per(None)] = 0.0
    impactor_angle: Annotated[float, Per(None)] = 0.0
    own: Mapping[str, Array] = field(default_factory=dict)
    stress: NDArray[np.float32] | None = None

    def __repr__(self) -> str:
        columns, rows = self.position.shape[:2]
        return f"<Snapshot of {columns} x {rows} mass points at {self.time:.6g} s>"

    @property
    def broken_a(self) -> NDArray[np.bool_]:
        """(I-1, J) whether bond A(i,j) is broken."""
        return ~np.isnan(self.break_time_a)

    @property
    def broken_b(self) -> NDArray[np.bool_]:
        """(I, J-1) whether bond B(i,j) is broken."""
        return ~np.isnan(self.break_time_b)
