"""The block as a run has left it: the initial state of the next impact on it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, TypeVar, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from taichi_foam.laws.bond import BondLaw
from taichi_foam.scene import Scene

Array = NDArray[np.float64]
T = TypeVar("T")

# Where the entries of an array live, as (columns, rows) fewer than those of the mass points.
NODES, BONDS_A, BONDS_B, CELLS = (0, 0), (1, 0), (0, 1), (1, 1)


@dataclass(frozen=True)
class Per:
    """Annotation that declares the shape of an array of a block.

    places   NODES, BONDS_A, BONDS_B or CELLS: one entry for each; None: a single entry
    numbers  shape of each entry
    absent   value of all entries in a file without it; None: such a file holds no block
    """

    places: tuple[int, int] | None
    numbers: tuple[int, ...] = ()
    absent: float | None = None

    def shape(self, columns: int, rows: int) -> tuple[int, ...]:
        """Shape of the array in a block of `columns` x `rows` mass points."""
        if self.places is None:
            return self.numbers
        return (columns - self.places[0], rows - self.places[1], *self.numbers)


def declared(kind: type) -> dict[str, Any]:
    """The `Per` of each member of a class that is annotated with one, in order."""
    hints = get_type_hints(kind, include_extras=True)
    return {
        name: hint.__metadata__[0] for name, hint in hints.items() if get_origin(hint) is Annotated
    }


def remembered(law: BondLaw) -> dict[str, Per]:
    """What the bonds of a law remember besides their worst strain: `NAME_a` and `NAME_b`."""
    own = [name for name in law.History.members if name != "worst"]
    return {
        f"{name}_{end}": Per(at) for name in own for end, at in (("a", BONDS_A), ("b", BONDS_B))
    }


_OWN = "own."


def with_prefix(own: Mapping[str, T]) -> dict[str, T]:
    """What bonds remember, by the names that it has among arrays in files: `own.NAME`."""
    return {_OWN + name: each for name, each in own.items()}


def without_own(arrays: Mapping[str, T]) -> tuple[dict[str, T], dict[str, T]]:
    """Arrays in files without what bonds remember, and that, by the names of `remembered`."""
    others, own = {}, {}
    for name, each in arrays.items():
        (own if name.startswith(_OWN) else others)[name.removeprefix(_OWN)] = each
    return others, own


def absent_of(kind: type) -> dict[str, float | None]:
    """Values of a class's arrays that files of other versions may lack, see `Per.absent`."""
    return {name: told.absent for name, told in declared(kind).items()}


def shapes_of(kind: type, scene: Scene) -> dict[str, tuple[int, ...]]:
    """Shape of each member of a class that is annotated with `Per`, and of each `own.NAME`.

    They are those of a scene's block; `own.NAME` is what the bonds of its law remember.
    """
    block, law = scene.block, scene.foam.law_for(scene.model)
    told = declared(kind) | with_prefix(remembered(law))
    return {name: each.shape(block.columns, block.rows) for name, each in told.items()}


@dataclass(frozen=True)
class Cushion:
    """A block of I x J mass points as a run has left it, between two steps. SI units.

    It does not depend on the device, so a block may be hit on a CPU first and on a GPU next.

    position, velocity  (I, J, 2)
    increment       (I, J, 2) displacement in the last step, for the floor's friction springs [m]
    floor_stretch   (I, J) stretch of these springs [m]
    room            (I, J) upper limit of a mass point's contact radius [m]
    surface         (I, J) whether a mass point can touch others
    hold            (I-1, J-1) share of its forces that a cell still carries, 1 to 0
    shear_set       (I-1, J-1) lasting shear strain of a cell
    worst_a, worst_b    (I-1, J), (I, J-1) most compressive strain so far
    broken_a, broken_b  same shapes, 1 where a bond is broken, else 0
    intact_a, intact_b  same shapes, share of a bond's face that carries tension and shear
    stiffest        stiffness of the stiffest bond [N/m], on which the step size depends
    crush           largest compressive strain of any bond, on which the step size depends, too
    speed           speed of the fastest mass point in the last step [m/s]
    broken          number of bonds broken so far
    held            (3,) energy stored in contacts: base, its friction, pieces [J]
    own             what bonds remember besides, by the names of `remembered`
    """

    position: Annotated[Array, Per(NODES, (2,))]
    velocity: Annotated[Array, Per(NODES, (2,))]
    increment: Annotated[Array, Per(NODES, (2,))]
    floor_stretch: Annotated[Array, Per(NODES)]
    room: Annotated[Array, Per(NODES)]
    surface: Annotated[Array, Per(NODES)]
    hold: Annotated[Array, Per(CELLS)]
    shear_set: Annotated[Array, Per(CELLS, absent=0.0)]
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
    own: Mapping[str, Array] = field(default_factory=dict)

    @property
    def sha256(self) -> str:
        """SHA-256 of the whole state: equal cushions have equal hashes.

        An array that is as if it were absent is left out, so that hashes of older files stay valid.
        """
        digest, absent = hashlib.sha256(), absent_of(Cushion)
        for name, array in self.to_arrays().items():
            if absent.get(name) is not None and np.all(array == absent[name]):
                continue
            digest.update(name.encode())
            digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
        return digest.hexdigest()

    def to_arrays(self) -> dict[str, Array]:
        """Everything as arrays by name, for `numpy.savez`."""
        arrays = {name: np.asarray(getattr(self, name)) for name in declared(Cushion)}
        return arrays | with_prefix(self.own)

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Cushion:
        """The cushion from the arrays of `to_arrays`. Raises KeyError: an array is missing."""
        others, own = without_own(arrays)
        found: dict[str, Any] = {name: others[name] for name in declared(cls)}
        return cls(**{name: a if a.ndim else a.item() for name, a in found.items()}, own=own)
