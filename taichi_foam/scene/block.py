"""The block that is hit: its size, its lattice, its density."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from taichi_foam.parts import Part, quantity

MAX_NODES = 4_000_000


class Block(Part):
    """A rectangular block, its lattice of mass points and its density (paper, Table 6, Fig. 14)."""

    width: float = quantity(0.2, "m", "width of the block", at_least=1e-4, at_most=5)
    height: float = quantity(0.1, "m", "height of the block", at_least=1e-4, at_most=5)
    thickness: float = quantity(
        0.057,
        "m",
        "thickness of the block, and of the impactor",
        at_least=1e-5,
        at_most=5,
        fix="lengths are in metres (57 mm is 0.057)",
    )
    columns: int = quantity(
        40,
        "count",
        "number of mass points across",
        at_least=2,
        at_most=MAX_NODES // 2,
        fix="the paper uses 40 by 20",
    )
    rows: int = quantity(
        20,
        "count",
        "number of mass points upwards",
        at_least=2,
        at_most=MAX_NODES // 2,
        fix="the paper uses 40 by 20",
    )
    density: float = quantity(25.6, "kg/m3", "density of the foam", at_least=1, at_most=5000)

    @model_validator(mode="after")
    def _check_size(self) -> Block:
        if self.columns * self.rows > MAX_NODES:
            raise ValueError(
                f"block.columns = {self.columns}, block.rows = {self.rows}: "
                f"{self.columns * self.rows:,} mass points; at most {MAX_NODES:,}; "
                "take fewer columns or rows"
            )
        return self

    @property
    def dx(self) -> float:
        """Width of a cell [m]."""
        return self.width / self.columns

    @property
    def dy(self) -> float:
        """Height of a cell [m]."""
        return self.height / self.rows

    @property
    def node_mass(self) -> float:
        """Mass of a mass point [kg]: that of its cell, rho dX dY Z."""
        return self.density * self.dx * self.dy * self.thickness

    @property
    def positions(self) -> NDArray[Any]:
        """Reference positions of the mass points, (columns, rows, 2) [m]."""
        x = (np.arange(self.columns) - 0.5 * (self.columns - 1)) * self.dx
        y = (np.arange(self.rows) + 0.5) * self.dy
        return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
