"""What a run leaves in memory: its scene, history, snapshots and how it was computed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.records.history import HISTORY_COLUMNS
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Scene

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Record:
    """A finished (or interrupted) run.

    scene      what was run, with every default filled in
    history    one array (n,) for each of HISTORY_COLUMNS
    snapshots  instants in order of time
    run        how it was computed: steps, dt_min_s, dt_max_s, wall_s, node_stages_per_s,
               interrupted, max_overlap_m, versions, ...; values that JSON can hold

    Raises ValueError when a history column is missing, unknown or of another length.
    """

    scene: Scene
    history: dict[str, Array]
    snapshots: list[Snapshot]
    run: dict[str, Any]

    def __post_init__(self) -> None:
        if set(self.history) != set(HISTORY_COLUMNS):
            odd = sorted(set(self.history) ^ set(HISTORY_COLUMNS))
            raise ValueError(f"history columns missing or unknown: {', '.join(odd)}")
        if len({np.shape(column) for column in self.history.values()}) != 1:
            raise ValueError("history columns differ in length")

    def __repr__(self) -> str:
        return (
            f"<Result of {self.scene.name!r}: {len(self.history['time_s'])} rows, "
            f"{len(self.snapshots)} snapshots, ended by {self.run.get('ended_by', 'nobody knows')}>"
        )
