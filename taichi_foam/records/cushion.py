"""What a run leaves of its block: what the next impact on it starts with."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.scene import Block

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Cushion:
    """A block of I x J mass points as a run has left it, between two steps. SI units.

    Nothing in it depends on what has computed it, so that a block may be hit on a CPU first and on
    a GPU next.

    position, velocity  (I, J, 2)
    increment       (I, J, 2) motion in the last step, which the floor's friction springs follow [m]
    floor_stretch   (I, J) of these springs [m]
    room            (I, J) most that a mass point's contact radius may be [m]
    surface         (I, J) whether it can touch others
    hold            (I-1, J-1) what a cell holds of its forces, 1 to 0
    worst_a, worst_b    (I-1, J), (I, J-1) most compressive strain so far
    broken_a, broken_b  the same, 1 where a bond is broken, else 0
    intact_a, intact_b  the same, share of a whole bond's face that carries tension and shear
    stiffest        stiffened bond [N/m], which the step size depends on
    crush           largest of any bond, which it depends on, too
    speed           of the fastest mass point in the last step [m/s]
    broken          bonds broken so far
    held            (3,) energy that contacts store: base, its friction, pieces [J]
    """

    position: Array
    velocity: Array
    increment: Array
    floor_stretch: Array
    room: Array
    surface: Array
    hold: Array
    worst_a: Array
    worst_b: Array
    broken_a: Array
    broken_b: Array
    intact_a: Array
    intact_b: Array
    stiffest: float
    crush: float
    speed: float
    broken: float
    held: Array

    @property
    def sha256(self) -> str:
        """SHA-256 of all of it: equal cushions have equal ones."""
        digest = hashlib.sha256()
        for name, array in self.to_arrays().items():
            digest.update(name.encode())
            digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
        return digest.hexdigest()

    def to_arrays(self) -> dict[str, Array]:
        """Everything as arrays by name, as `numpy.savez` takes them."""
        return {field.name: np.asarray(getattr(self, field.name)) for field in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Cushion:
        """The cushion that `to_arrays` gave. Raises KeyError: an array is missing."""
        found: dict[str, Any] = {field.name: arrays[field.name] for field in fields(cls)}
        return cls(**{name: a if a.ndim else a.item() for name, a in found.items()})

    @classmethod
    def shapes(cls, block: Block) -> dict[str, tuple[int, ...]]:
        """Shape of each array of the cushion that a block becomes."""
        columns, rows = block.columns, block.rows
        nodes, a, b = (columns, rows), (columns - 1, rows), (columns, rows - 1)
        pairs = dict.fromkeys(("position", "velocity", "increment"), (*nodes, 2))
        kinds = {"floor_stretch": nodes, "room": nodes, "surface": nodes}
        kinds["hold"] = (columns - 1, rows - 1)
        for name in ("worst", "broken", "intact"):
            kinds |= {f"{name}_a": a, f"{name}_b": b}
        numbers = dict.fromkeys(("stiffest", "crush", "speed", "broken"), ())
        return {**pairs, **kinds, **numbers, "held": (3,)}
