"""Messages of viewers: JSON, checked on arrival, and the inbox in which they wait to be done."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from taichi_foam.live.messages import Pace, Pause, Step

#: No control has larger numbers [SI]. JSON has whole numbers of any length, which no float holds.
MOST = 10**12
#: The longest text of pasted tests: some 500 drops.
MOST_PASTED = 20_000
#: The longest step of a viewer [s], and its slowest and fastest pace.
MOST_SECONDS, PACES = 0.1, (1e-6, 1.0)

Word: TypeAlias = Annotated[str, Field(max_length=20)]
Number: TypeAlias = (
    Annotated[int, Field(ge=-MOST, le=MOST)] | Annotated[float, Field(ge=-MOST, le=MOST)]
)
#: Settings of controls by key, in SI units; None empties an optional one.
Values: TypeAlias = Annotated[
    dict[Annotated[str, Field(max_length=60)], Number | None],
    Field(max_length=64),
]


@dataclass(frozen=True)
class Next:
    """The last picture has come: the next may."""

    do: Literal["next"] = "next"


@dataclass(frozen=True)
class Watch:
    """Whether the viewer wants pictures, and for which page."""

    on: bool
    tone: Literal["light", "dark"]
    do: Literal["watch"] = "watch"


@dataclass(frozen=True)
class Set:
    """Controls have been moved; nothing is dropped yet."""

    shape: Word
    values: Values
    do: Literal["set"] = "set"


@dataclass(frozen=True)
class Drop:
    """Drop with these settings; what is left out stays."""

    shape: Word
    values: Values
    do: Literal["drop"] = "drop"


@dataclass(frozen=True)
class Reset:
    """Drop the scene that the server was given."""

    do: Literal["reset"] = "reset"


@dataclass(frozen=True)
class Look:
    """How pictures are drawn."""

    mode: Word
    theme: Literal["auto", "light", "dark"]
    grid: bool
    do: Literal["look"] = "look"


@dataclass(frozen=True)
class Save:
    """Try again to save what could not be saved."""

    do: Literal["save"] = "save"


@dataclass(frozen=True)
class Cushion:
    """Show the cushion chart of these conditions [SI].

    least, most  static stresses; None: as the formula suggests
    tests        own cushion tests to draw beside it, as a text with a header
    """

    foam: Annotated[str, Field(max_length=60)]
    thickness: Number
    drop_height: Number
    least: Number | None
    most: Number | None
    tests: Annotated[str, Field(max_length=MOST_PASTED)] = ""
    do: Literal["cushion"] = "cushion"


@dataclass(frozen=True)
class Point:
    """Drop the scene of a point of the cushion chart of this number."""

    chart: int
    point: int
    do: Literal["point"] = "point"


#: What concerns the viewer alone, and what concerns all.
Own: TypeAlias = Next | Watch
Shared: TypeAlias = Set | Drop | Reset | Pause | Step | Pace | Look | Save | Cushion | Point
Command: TypeAlias = Own | Shared

#: Commands of one viewer, and of all, that may wait.
MOST_OF_ONE, MOST_OF_ALL = 16, 256
#: Commands that are done before the view looks at the run again.
MOST_AT_ONCE = 16

#: Tells a viewer why its command is not done. Each viewer has one, which stands for it here.
Reply: TypeAlias = Callable[[str], object]

_READER: TypeAdapter[Command] = TypeAdapter(
    Annotated[Own | Shared, Field(discriminator="do")],
    config=ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, hide_input_in_errors=True),
)


def read(text: str) -> Command:
    """A viewer's message. Raises ValueError that says what is wrong with it."""
    try:
        command = _READER.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False, include_context=False)[0]
        where = ".".join(str(step)[:60] for step in first["loc"])
        raise ValueError(f"message refused: {where}{': ' * bool(where)}{first['msg']}") from None
    match command:
        case Step(seconds) if not 0.0 < seconds <= MOST_SECONDS:
            limits = f"greater than 0 and at most {MOST_SECONDS}"
            raise ValueError(f"message refused: step.seconds: Input should be {limits}")
        case Pace(float(rate)) if not PACES[0] <= rate <= PACES[1]:
            limits = f"greater than or equal to {PACES[0]} and at most {PACES[1]:g}"
            raise ValueError(f"message refused: pace.rate: Input should be {limits}")
    return command


class Inbox:
    """Commands in the order in which they came. Any thread may call anything."""

    def __init__(self) -> None:
        self._waiting: list[tuple[Shared, Reply]] = []
        self._lock = threading.Lock()

    def put(self, command: Shared, reply: Reply) -> bool:
        """Keep a command until it is taken; False if too much waits already."""
        with self._lock:
            own = [place for place, (_, whose) in enumerate(self._waiting) if whose == reply]
            if own and _replaces(command, self._waiting[own[-1]][0]):
                self._waiting[own[-1]] = command, reply
                return True
            if len(own) >= MOST_OF_ONE or len(self._waiting) >= MOST_OF_ALL:
                return False
            self._waiting.append((command, reply))
            return True

    def take(self) -> list[tuple[Shared, Reply]]:
        """The next few, which wait no more."""
        with self._lock:
            taken, self._waiting = self._waiting[:MOST_AT_ONCE], self._waiting[MOST_AT_ONCE:]
        return taken


def _replaces(new: Shared, old: Shared) -> bool:
    """Whether the newer command does all that the older one does, as with a slider that moves."""
    if isinstance(new, Set) and isinstance(old, Set):
        return old.values.keys() <= new.values.keys()
    return isinstance(new, Cushion) and isinstance(old, Cushion)
