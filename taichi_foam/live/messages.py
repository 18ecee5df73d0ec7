"""What a live session and its worker tell each other. SI units.

Commands with a `do` are those of the page, too: it is the word that stands for them in JSON.
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
    do: Literal["pause"] = "pause"


@dataclass(frozen=True)
class Step:
    """Go on by so much simulated time [s], as fast as it goes, and then stand still.

    Steps that are asked for before the last one is done add up.
    """

    seconds: float
    do: Literal["step"] = "step"


@dataclass(frozen=True)
class Pace:
    """Simulated seconds in a second of wall time; None: as fast as it goes."""

    rate: float | None
    do: Literal["pace"] = "pace"


#: "ask": send a Frame, after the engine's current call. "finish": end the drop now and answer with
#: what there is. "close": leave.
Command = Start | Pause | Step | Pace | Literal["ask", "finish", "close"]


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
    """A drop is over: at its end, finished early, or because it cannot go on."""

    drop: int
    result: Result | None  # what it gave; None if that is nothing
    failure: str | None = None  # why it cannot go on, in the words of a RunError


@dataclass(frozen=True)
class Refused:
    """What was asked for cannot be had here, as an absent device."""

    message: str


@dataclass(frozen=True)
class Died:
    """The worker is gone. The session tells it itself, once."""

    message: str


Event = Frame | Ended | Refused | Died
