"""The C++ peers, called through ctypes."""

from __future__ import annotations

import ctypes
import functools
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from taichi_foam.scene import Scene

from . import compile as compiling
from .constants import RATE_ONLY, WORKS, Case, Constants, Features, Skipped, State, case_of

if TYPE_CHECKING:
    from typing_extensions import Self

_DOUBLES = ctypes.POINTER(ctypes.c_double)
_LISTS = ctypes.POINTER(_DOUBLES)


@functools.cache
def _library(source: str, features: Features) -> ctypes.CDLL:
    library = compiling.load(source, _macros(features))
    library.create.restype = ctypes.c_void_p
    library.create.argtypes = [
        ctypes.c_int, ctypes.c_int, _DOUBLES, ctypes.c_int, _DOUBLES, _DOUBLES, _DOUBLES,
    ]  # fmt: skip
    library.advance.restype = ctypes.c_long
    library.advance.argtypes = [ctypes.c_void_p, ctypes.c_long, ctypes.c_int]
    library.read.argtypes = [ctypes.c_void_p, _DOUBLES, _DOUBLES]
    library.destroy.argtypes = [ctypes.c_void_p]
    return _checked(library)


@functools.cache
def _batch_library(features: Features, bits: int) -> ctypes.CDLL:
    library = compiling.load("batch.cpp", _macros(features) | {"BITS": bits})
    library.create_batch.restype = ctypes.c_void_p
    library.create_batch.argtypes = [
        ctypes.c_int, ctypes.c_int, ctypes.c_int, _LISTS, ctypes.c_int, _LISTS, _LISTS, _LISTS,
    ]  # fmt: skip
    library.advance.restype = None
    library.advance.argtypes = [ctypes.c_void_p, ctypes.c_long, ctypes.c_int]
    library.read.argtypes = [ctypes.c_void_p, ctypes.c_int, _DOUBLES, _DOUBLES]
    library.destroy.argtypes = [ctypes.c_void_p]
    return _checked(library)


def _macros(features: Features) -> dict[str, int]:
    return {name.upper(): int(value) for name, value in features._asdict().items()}


def _checked(library: ctypes.CDLL) -> ctypes.CDLL:
    assert library.constants_count() == len(Constants._fields), "model.hpp and constants.py"
    return library


class _Native:
    """A compiled library, and what it has created."""

    name: str
    knows: ClassVar[Features] = RATE_ONLY
    _library: ctypes.CDLL  # of the last scene
    _created: int | None = None  # its address

    @classmethod
    def load(cls, *options: Any) -> Self | Skipped:
        """The peer, if there is a compiler."""
        return cls(*options) if compiling.compiler() else Skipped(compiling.ABSENT)

    def close(self) -> None:
        """Free what was created."""
        if self._created is not None:
            self._library.destroy(self._created)
            self._created = None

    def __del__(self) -> None:
        self.close()


class _Single(_Native):
    """One lattice at a time."""

    source: ClassVar[str]

    def prepare(self, scene: Scene) -> None:
        """Stand at the scene's start, compiled for its choices."""
        case = case_of(scene, self.knows)
        self.close()
        self._library = _library(self.source, case.features)
        constants = np.array(case.constants)
        self._created = self._library.create(
            case.columns, case.rows, _pointer(constants), len(case.edges), _pointer(case.edges),
            _pointer(case.start), _pointer(case.body),
        )  # fmt: skip
        self._shape = (case.columns, case.rows)

    def advance(self, steps: int, threads: int = 1) -> int:
        """Take steps; how many were taken: fewer where the lattice went astray."""
        return self._library.advance(self._created, steps, threads)

    def state(self) -> State:
        """Copy the accepted state."""
        nodes = np.empty((*self._shape, 4))
        summary = np.empty(self._library.summary_count())
        self._library.read(self._created, _pointer(nodes), _pointer(summary))
        return _state(nodes, summary)


class Plain(_Single):
    """Structs of nodes, scalar code: what one writes first."""

    name = "C++, plain"
    source = "plain.cpp"


class Vectors(_Single):
    """An array for each quantity, loops without branches: what a compiler turns into vectors."""

    name = "C++, vectors"
    source = "vectors.cpp"
    knows = Features(rate=True, room=True, softening=True)


class Batch(_Native):
    """A lattice in each lane of a vector, of so many bits or of the widest there is below."""

    knows = Features(rate=False, room=True, softening=True)

    def __init__(self, bits: int = 512) -> None:
        self.name = f"C++, a lattice in each lane of {bits} bits"
        self._bits = bits
        self._cases: list[Case] = []

    def prepare(self, scenes: list[Scene]) -> None:
        """Stand at the scenes' starts, compiled for their choices.

        Raises:
            ValueError: they differ in their counts, choices or number of edges; densification_b
                is not 1; or see `case_of`.
        """
        cases = [case_of(scene, self.knows) for scene in scenes]
        if any(case.constants.densification_b != 1.0 for case in cases):
            raise ValueError("a batch knows no densification_b other than 1")
        kinds = {(case.columns, case.rows, case.features, case.edges.shape) for case in cases}
        if len(kinds) > 1:
            raise ValueError("the lattices of a batch have one size and one set of choices")
        self.close()
        first = cases[0]
        self._library = _batch_library(first.features, self._bits)
        constants = [np.array(case.constants) for case in cases]
        self._created = self._library.create_batch(
            len(cases), first.columns, first.rows, _pointers(constants), len(first.edges),
            _pointers([case.edges for case in cases]), _pointers([case.start for case in cases]),
            _pointers([case.body for case in cases]),
        )  # fmt: skip
        self._cases = cases

    def advance(self, steps: int, threads: int = 1) -> int:
        """Take steps, each lattice of its own size; those of a vector go astray together."""
        self._library.advance(self._created, steps, threads)
        return steps

    def states(self) -> list[State]:
        """Copy the accepted state of every lattice."""
        found = []
        for n, case in enumerate(self._cases):
            nodes = np.empty((case.columns, case.rows, 4))
            summary = np.empty(self._library.summary_count())
            self._library.read(self._created, n, _pointer(nodes), _pointer(summary))
            found.append(_state(nodes, summary))
        return found


def _state(nodes: np.ndarray, summary: np.ndarray) -> State:
    time, step, y, _, broken, *works = summary.tolist()
    return State(
        position=nodes[..., :2].copy(),
        impactor_y=y,
        time=time,
        step=step,
        broken=int(broken),
        works=dict(zip(WORKS, works, strict=True)),
    )


def _pointers(arrays: list[np.ndarray]):
    return (_DOUBLES * len(arrays))(*map(_pointer, arrays))


def _pointer(array: np.ndarray):
    return array.ctypes.data_as(_DOUBLES)
