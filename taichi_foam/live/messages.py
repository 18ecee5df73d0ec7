"""What viewer and worker tell each other. SI units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np

    from taichi_foam.records.snapshot import Snapshot
    from taichi_foam.results.result import Result
    from taichi_foam.scene import Scene


@dataclass(frozen=True)
class Keeping:
    """Where a drop leaves checkpoints, so that it survives both processes."""

    folder: Path
    every: float | None  # wall time between two [s]; None: as usual
    goes_on: bool  # from a checkpoint that is there; else that is removed


@dataclass(frozen=True)
class Start:
    """Drop this scene, whatever goes on; it runs at once, at the pace that is set."""

    drop: int  # its number, which all its events carry
    scene: Scene
    keeping: Keeping | None = None


@dataclass(frozen=True)
class Pause:
    """Stand still, or go on."""

    on: bool


@dataclass(frozen=True)
class Step:
    """Go on by so much simulated time, as fast as it goes, and then stand still."""

    seconds: float


@dataclass(frozen=True)
class Pace:
    """Simulated seconds in a second of wall time; None: as fast as it goes."""

    rate: float | None


@dataclass(frozen=True)
class Ask:
    """Send a Frame, after the engine's current call."""


@dataclass(frozen=True)
class Finish:
    """End the drop now and answer with what there is: Ended, or NothingYet."""


@dataclass(frozen=True)
class Close:
    """Leave."""


Command = Start | Pause | Step | Pace | Ask | Finish | Close


@dataclass(frozen=True)
class Frame:
    """Where a drop stands."""

    drop: int
    snapshot: Snapshot
    rows: np.ndarray  # (n, `row_columns`) of the history, those since the drop's last frame
    fraction: float  # of the run that is done, 0 to 1
    steps: int
    wall: float  # that the engine has taken [s]
    paused: bool  # whether it stands still; False while a Step is being carried out
    ended: bool


@dataclass(frozen=True)
class Ended:
    """A drop is over: at its end, or interrupted by Finish."""

    drop: int
    result: Result


@dataclass(frozen=True)
class NothingYet:
    """A drop that Finish has ended before it gave anything."""

    drop: int


@dataclass(frozen=True)
class Failed:
    """A drop that cannot go on, in the words of a RunError, with what came before."""

    drop: int
    message: str
    result: Result | None


@dataclass(frozen=True)
class Refused:
    """What was asked for cannot be had here, as an absent device."""

    message: str


@dataclass(frozen=True)
class Died:
    """The worker is gone. The session tells it itself, once."""

    message: str


Event = Frame | Ended | NothingYet | Failed | Refused | Died
