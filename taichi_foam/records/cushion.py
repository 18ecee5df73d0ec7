"""What a run leaves of its block: what the next impact on it starts with."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Annotated, Any, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from taichi_foam.scene import Block

Array = NDArray[np.float64]

# What an array has a place for each of, as how many columns and rows it has less than mass points.
NODES, BONDS_A, BONDS_B, CELLS = (0, 0), (1, 0), (0, 1), (1, 1)


@dataclass(frozen=True)
class Per:
    """Declares an array of a block by its annotation.

    places   what it has a place for each of; None: it is one alone
    numbers  shape of what is in each
    """

    places: tuple[int, int] | None
    numbers: tuple[int, ...] = ()

    def shape(self, columns: int, rows: int) -> tuple[int, ...]:
        """In a block of so many mass points."""
        if self.places is None:
            return self.numbers
        return (columns - self.places[0], rows - self.places[1], *self.numbers)


def declared(kind: type) -> dict[str, Any]:
    """The `Per` of each member of a class that has one, in order."""
    hints = get_type_hints(kind, include_extras=True)
    return {
        name: hint.__metadata__[0] for name, hint in hints.items() if get_origin(hint) is Annotated
    }


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

    position: Annotated[Array, Per(NODES, (2,))]
    velocity: Annotated[Array, Per(NODES, (2,))]
    increment: Annotated[Array, Per(NODES, (2,))]
    floor_stretch: Annotated[Array, Per(NODES)]
    room: Annotated[Array, Per(NODES)]
    surface: Annotated[Array, Per(NODES)]
    hold: Annotated[Array, Per(CELLS)]
    worst_a: Annotated[Array, Per(BONDS_A)]
    worst_b: Annotated[Array, Per(BONDS_B)]
    broken_a: Annotated[Array, Per(BONDS_A)]
    broken_b: Annotated[Array, Per(BONDS_B)]
    intact_a: Annotated[Array, Per(BONDS_A)]
    intact_b: Annotated[Array, Per(BONDS_B)]
    stiffest: Annotated[float, Per(None)]
    crush: Annotated[float, Per(None)]
    speed: Annotated[float, Per(None)]
    broken: Annotated[float, Per(None)]
    held: Annotated[Array, Per(None, (3,))]

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
        told = declared(cls).items()
        return {name: each.shape(block.columns, block.rows) for name, each in told}
