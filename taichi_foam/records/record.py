"""The data of a run in memory: scene, history, snapshots and how it was computed."""

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

    scene      the scene, with every default filled in
    history    arrays (n,) by the names of COLUMNS; a plain mapping is converted to `History`
    snapshots  instants in order of time; for a long run they may be on disk
    run        how it was computed: ended_by, interrupted, steps, dt_min_s, dt_max_s,
               dt_stable_min_s, wall_s, node_stages_per_s, max_overlap_m, versions,
               ...; values that JSON can hold. `after` exists if the run did not start on a fresh
               block: scene and state_sha256 of the previous run, number of this drop on the
               block, contact_height_m
    cushion    the block as the run has left it; None if the run did not reach its end

    Raises ValueError if the history has no time or a column of another length, or if `ended_by` is
    not an `Ending`.
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
        """How the run ended; None if unknown, as while it is running."""
        word = self.run.get("ended_by")
        return None if word is None else Ending(word)

    @property
    def failure(self) -> str | None:
        """Why the run failed, and what to do; None if it did not."""
        ending = self.ending
        return f"{ending.meaning}; {ending.remedy}" if ending and ending.failed else None

    @property
    def contact_height(self) -> float:
        """Height of the impactor's lowest point at first contact [m]; it starts a gap above it."""
        after = self.run.get("after") or {}
        height = after.get("contact_height_m")
        return self.scene.contact_height if height is None else height

    @property
    def lifted(self) -> float:
        """How far first contact lies above that with a fresh block [m]."""
        return self.contact_height - self.scene.contact_height

    def displacement(self, snapshot: Snapshot) -> float | None:
        """Downward displacement of the impactor from its start [m]; None without an impactor."""
        impactor = self.scene.impactor
        return impactor and self.contact_height + impactor.gap - snapshot.impactor_y

    @property
    def drop(self) -> int:
        """Number of drops on the block including this one: 1 on a fresh block."""
        after = self.run.get("after")
        return 1 if after is None else after["drop"]

    def to_pandas(self) -> pandas.DataFrame:
        """The history as a data frame; see `History.to_pandas`."""
        return self.history.to_pandas()
