"""The two C++ peers, called through ctypes."""

from __future__ import annotations

import ctypes
import functools
from typing import ClassVar

import numpy as np

from taichi_foam.scene import Scene

from . import compile as compiling
from .constants import WORKS, Constants, Features, Skipped, State, case_of

_DOUBLES = ctypes.POINTER(ctypes.c_double)


@functools.cache
def _library(source: str, features: Features) -> ctypes.CDLL:
    macros = {name.upper(): int(value) for name, value in features._asdict().items()}
    library = compiling.load(source, macros)
    library.create.restype = ctypes.c_void_p
    library.create.argtypes = [
        ctypes.c_int, ctypes.c_int, _DOUBLES, ctypes.c_int, _DOUBLES, _DOUBLES, _DOUBLES,
    ]  # fmt: skip
    library.advance.restype = ctypes.c_long
    library.advance.argtypes = [ctypes.c_void_p, ctypes.c_long, ctypes.c_int]
    library.read.argtypes = [ctypes.c_void_p, _DOUBLES, _DOUBLES]
    library.destroy.argtypes = [ctypes.c_void_p]
    assert library.constants_count() == len(Constants._fields), "model.hpp and constants.py"
    return library


class _Native:
    """One lattice at a time in a compiled library."""

    name: ClassVar[str]
    source: ClassVar[str]

    def __init__(self) -> None:
        self._library: ctypes.CDLL | None = None
        self._lattice: int | None = None
        self._shape = (0, 0)

    @classmethod
    def load(cls) -> _Native | Skipped:
        """The peer, if there is a compiler."""
        return cls() if compiling.compiler() else Skipped(compiling.ABSENT)

    def prepare(self, scene: Scene) -> None:
        """Stand at the scene's start, compiled for its choices."""
        case = case_of(scene)
        self.close()
        self._library = _library(self.source, case.features)
        constants = np.array(case.constants)
        self._lattice = self._library.create(
            case.columns, case.rows, _pointer(constants), len(case.edges), _pointer(case.edges),
            _pointer(case.start), _pointer(case.body),
        )  # fmt: skip
        self._shape = (case.columns, case.rows)

    def advance(self, steps: int, threads: int = 1) -> int:
        """Take steps; how many were taken: fewer where the lattice went astray."""
        return self._library.advance(self._lattice, steps, threads)

    def state(self) -> State:
        """Copy the accepted state."""
        nodes = np.empty((*self._shape, 4))
        summary = np.empty(self._library.summary_count())
        self._library.read(self._lattice, _pointer(nodes), _pointer(summary))
        time, step, y, v, broken, *works = summary.tolist()
        return State(
            position=nodes[..., :2].copy(),
            velocity=nodes[..., 2:].copy(),
            impactor_y=y,
            impactor_v=v,
            time=time,
            step=step,
            broken=int(broken),
            works=dict(zip(WORKS, works, strict=True)),
        )

    def close(self) -> None:
        """Free the lattice."""
        if self._lattice is not None:
            self._library.destroy(self._lattice)
            self._lattice = None

    def __del__(self) -> None:
        self.close()


class Plain(_Native):
    """Structs of nodes, scalar code: what one writes first."""

    name = "C++, plain"
    source = "plain.cpp"


class Vectors(_Native):
    """An array for each quantity, loops without branches: what a compiler turns into vectors."""

    name = "C++, vectors"
    source = "vectors.cpp"


def _pointer(array: np.ndarray):
    return array.ctypes.data_as(_DOUBLES)
