"""The plain peer in Numba: what one writes when it has to stay Python."""

from __future__ import annotations

import importlib.util
from types import ModuleType

import numpy as np

from taichi_foam.scene import Scene

from .constants import WORKS, Skipped, State, case_of


class Numba:
    """One lattice at a time. The first step of each kind compiles, which takes seconds."""

    name = "Numba"

    def __init__(self, kernels: ModuleType) -> None:
        self._kernels = kernels

    @classmethod
    def load(cls) -> Numba | Skipped:
        """The peer, if Numba is installed."""
        if importlib.util.find_spec("numba") is None:
            return Skipped("Numba: not installed; pip install numba")
        from . import numba_kernels

        return cls(numba_kernels)

    def prepare(self, scene: Scene) -> None:
        """Stand at the scene's start; the first step compiles."""
        case, kernels = case_of(scene), self._kernels
        self._c, self._edges = case.constants, case.edges
        self._features = case.features
        self._shape = (case.columns, case.rows)
        padded = (case.columns + 2, case.rows + 2)

        def per_node(values: int) -> np.ndarray:
            return np.zeros((*padded, values))

        state, bond_a, bond_b, cells = per_node(4), per_node(2), per_node(2), per_node(2)
        state[1:-1, 1:-1] = case.start
        bond_a[..., 1] = bond_b[..., 1] = kernels.NEVER
        bond_a[1:-2, 1:-1, 1] = kernels.INTACT
        bond_b[1:-1, 1:-2, 1] = kernels.INTACT
        cells[1:-2, 1:-2] = 1.0
        trial, rate, forces, slips = state.copy(), per_node(4), per_node(8), per_node(2)
        # a row for every node, in the order of the kernels' arguments
        self._fields = [
            field.reshape(-1, field.shape[-1])
            for field in (state, trial, rate, forces, bond_a, bond_b, cells, slips)
        ]
        self._body = np.zeros(6)
        self._body[[kernels.Y, kernels.TRIAL_Y]] = case.body[0]
        self._body[[kernels.V, kernels.TRIAL_V]] = case.body[1]
        self._column = np.zeros((case.columns, kernels.SUMS))
        self._clock = np.zeros(4)

    def advance(self, steps: int, threads: int = 1) -> int:
        """Take steps; how many were taken: fewer where the lattice went astray."""
        if threads > 1:
            self._kernels.numba.set_num_threads(threads)
        function = self._kernels.advance_function(self._features, threads > 1)
        return function(
            self._c, *self._shape, *self._fields, self._edges, self._body, self._column,
            self._clock, steps,
        )  # fmt: skip

    def state(self) -> State:
        """Copy the accepted state."""
        columns, rows = self._shape
        nodes = self._fields[0].reshape(columns + 2, rows + 2, 4)[1:-1, 1:-1]
        works = self._column[:, self._kernels.WORK :].sum(axis=0)
        return State(
            position=nodes[..., :2].copy(),
            impactor_y=float(self._body[self._kernels.Y]),
            time=float(self._clock[self._kernels.TIME]),
            step=float(self._clock[self._kernels.STEP]),
            broken=int(self._clock[self._kernels.BROKEN]),
            works=dict(zip(WORKS, works.tolist(), strict=True)),
        )
