"""What a run leaves in memory: its scene, history, snapshots and how it was computed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from taichi_foam.records.cushion import Cushion
from taichi_foam.records.ending import Ending
from taichi_foam.records.history import History
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Scene

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Record:
    """A finished (or interrupted) run.

    scene      what was run, with every default filled in
    history    arrays (n,) by the names of COLUMNS; made a `History` if it is a plain mapping
    snapshots  instants in order of time; of a long run they may lie on disk
    run        how it was computed: ended_by, interrupted, steps, dt_min_s, dt_max_s,
               dt_stable_min_s, wall_s, node_stages_per_s, max_overlap_m, versions,
               ...; values that JSON can hold. `after` is there if it did not start on a fresh
               block: scene and state_sha256 of the run that came before, number of this drop on
               the block, contact_height_m
    cushion    the block as the run has left it; None of one that did not come to its end

    Raises ValueError when the history has no time, or a column of another length, and when
    `ended_by` is no `Ending`.
    """

    scene: Scene
    history: History
    snapshots: Sequence[Snapshot]
    run: dict[str, Any]
    cushion: Cushion | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "history", History(self.history))
        Ending(self.run.get("ended_by", Ending.END_TIME))

    def __repr__(self) -> str:
        return (
            f"<{type(self).__name__} of {self.scene.name!r}: {len(self.history['time_s'])} rows, "
            f"{len(self.snapshots)} snapshots, ended by: {self.ending or 'unknown'}>"
        )

    @property
    def ending(self) -> Ending | None:
        """How the run ended; None if that is not known, as while it goes on."""
        word = self.run.get("ended_by")
        return None if word is None else Ending(word)

    @property
    def contact_height(self) -> float:
        """Height of the impactor's lowest point at first contact [m]; its start has a gap more."""
        after = self.run.get("after") or {}
        height = after.get("contact_height_m")
        return self.scene.contact_height if height is None else height

    def displacement(self, snapshot: Snapshot) -> float | None:
        """Of the impactor from its start, downwards [m], at an instant; None without one."""
        impactor = self.scene.impactor
        return impactor and self.contact_height + impactor.gap - snapshot.impactor_y

    @property
    def drop(self) -> int:
        """How many drops the block has had with this one: 1 on a fresh block."""
        after = self.run.get("after")
        return 1 if after is None else after["drop"]

    def to_pandas(self) -> pandas.DataFrame:
        """The history as a frame; see `History.to_pandas`."""
        return self.history.to_pandas()
