"""Messages between a live session and its worker. SI units.

Commands with a `do` are also sent by the page: `do` is their name in JSON.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np

    from taichi_foam.records.snapshot import Snapshot
    from taichi_foam.results.result import Result
    from taichi_foam.scene import Scene


@dataclass(frozen=True)
class Keeping:
    """Where a drop writes checkpoints, so that it survives both processes."""

    folder: Path
    every: float | None  # wall time between two [s]; None: default
    goes_on: bool  # whether to continue from an existing checkpoint; if not, it is removed


@dataclass(frozen=True)
class Start:
    """Drop this scene, replacing the current drop; it runs at once, at the current pace."""

    drop: int  # its number, which is in all its events
    scene: Scene
    keeping: Keeping | None = None


@dataclass(frozen=True)
class Pause:
    """Pause, or continue."""

    on: bool
    do: Literal["pause"] = "pause"


@dataclass(frozen=True)
class Step:
    """Advance by this simulated time [s], as fast as possible, then pause.

    Steps requested before the last one is finished add up.
    """

    seconds: float
    do: Literal["step"] = "step"


@dataclass(frozen=True)
class Pace:
    """Simulated seconds per second of wall time; None: as fast as possible."""

    rate: float | None
    do: Literal["pace"] = "pace"


#: "ask": send a Frame, after the engine's current call. "finish": end the drop now and send its
#: result so far. "close": exit.
Command = Start | Pause | Step | Pace | Literal["ask", "finish", "close"]


@dataclass(frozen=True)
class Frame:
    """The current state of a drop."""

    drop: int
    snapshot: Snapshot
    rows: np.ndarray  # (n, `row_columns`) of the history since the drop's last frame
    fraction: float  # of the run that is done, 0 to 1
    steps: int
    wall: float  # wall time that the engine has taken [s]
    paused: bool  # whether it is paused; False during a Step
    ended: bool


@dataclass(frozen=True)
class Ended:
    """A drop is over: at its end, finished early, or because it cannot continue."""

    drop: int
    result: Result | None  # None if there is none
    failure: str | None = None  # why it cannot continue: the message of a RunError


@dataclass(frozen=True)
class Refused:
    """The request cannot be met here, for example because a device is missing."""

    message: str


@dataclass(frozen=True)
class Died:
    """The worker has died. The session itself creates this event, once."""

    message: str


Event = Frame | Ended | Refused | Died
