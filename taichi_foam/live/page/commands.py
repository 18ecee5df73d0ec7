"""Messages of viewers: JSON, checked on arrival, and the inbox in which they wait to be done."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Annotated, Literal, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

#: No control has larger numbers [SI]. JSON has whole numbers of any length, which no float holds.
MOST = 10**12

#: Settings of controls by key, in SI units; None empties an optional one.
Values: TypeAlias = dict[
    Annotated[str, Field(max_length=60)],
    Annotated[int, Field(ge=-MOST, le=MOST)] | Annotated[float, Field(ge=-MOST, le=MOST)] | None,
]


class _Command(BaseModel):
    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, hide_input_in_errors=True
    )


class Next(_Command):
    """The last picture has come: the next may."""

    do: Literal["next"]


class Watch(_Command):
    """Whether the viewer wants pictures, and for which page."""

    do: Literal["watch"]
    on: bool
    tone: Literal["light", "dark"]


class Set(_Command):
    """Controls have been moved; nothing is dropped yet."""

    do: Literal["set"]
    shape: Annotated[str, Field(max_length=20)]
    values: Annotated[Values, Field(max_length=64)]


class Drop(_Command):
    """Drop with these settings; what is left out stays."""

    do: Literal["drop"]
    shape: Annotated[str, Field(max_length=20)]
    values: Annotated[Values, Field(max_length=64)]


class Reset(_Command):
    """Drop the scene that the server was given."""

    do: Literal["reset"]


class Pause(_Command):
    """Stand still, or go on."""

    do: Literal["pause"]
    on: bool


class Step(_Command):
    """Go on by so much simulated time [s] and stand still."""

    do: Literal["step"]
    seconds: Annotated[float, Field(gt=0, le=0.1)]


class Pace(_Command):
    """Simulated seconds in a second; None: as fast as it goes."""

    do: Literal["pace"]
    rate: Annotated[float, Field(ge=1e-6, le=1)] | None


class Look(_Command):
    """How pictures are drawn."""

    do: Literal["look"]
    mode: Annotated[str, Field(max_length=20)]
    theme: Literal["auto", "light", "dark"]
    grid: bool


class Save(_Command):
    """Try again to save what could not be saved."""

    do: Literal["save"]


#: What concerns the viewer alone, and what concerns all.
Own: TypeAlias = Next | Watch
Shared: TypeAlias = Set | Drop | Reset | Pause | Step | Pace | Look | Save
Command: TypeAlias = Own | Shared

#: Commands of one viewer, and of all, that may wait.
MOST_OF_ONE, MOST_OF_ALL = 16, 256
#: Commands that are done before the view looks at the run again.
MOST_AT_ONCE = 16

#: Tells a viewer why its command is not done. Each viewer has one, which stands for it here.
Reply: TypeAlias = Callable[[str], object]

_READER: TypeAdapter[Command] = TypeAdapter(Annotated[Own | Shared, Field(discriminator="do")])


def read(text: str) -> Command:
    """A viewer's message. Raises ValueError that says what is wrong with it."""
    try:
        return _READER.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False, include_context=False)[0]
        where = ".".join(str(step)[:60] for step in first["loc"])
        raise ValueError(f"message refused: {where}{': ' * bool(where)}{first['msg']}") from None


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
    """Whether the newer command sets all that the older one sets, as a slider does that moves."""
    return isinstance(new, Set) and isinstance(old, Set) and old.values.keys() <= new.values.keys()
