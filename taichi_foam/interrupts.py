"""Handling of Ctrl-C and similar signals: taken once, and deferred while data would be lost.

Commands treat SIGTERM, which batch systems send before they kill a process, and SIGHUP, which a
terminal sends when it is closed, like Ctrl-C: the data so far is saved.
"""

from __future__ import annotations

import atexit
import contextlib
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

SIGNALS = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]


@dataclass
class Heard:
    """The first signal received; None so far."""

    number: int | None = None

    @property
    def exit_code(self) -> int:
        """Exit code of a process that the signal has ended: 130 for Ctrl-C."""
        return 128 + (signal.SIGINT if self.number is None else self.number)


# of the running command, if there is one
_heard: Heard | None = None
# whether signals are deferred
_holds = False


@contextlib.contextmanager
def heard_once(on_more: Callable[[], object] = lambda: None) -> Iterator[Heard]:
    """Treat the first of `SIGNALS` as Ctrl-C, and ignore later ones until the block ends.

    Data is saved after the first signal, and a second Ctrl-C must not disturb that; `on_more` is
    called for each later signal. Signals that the process ignores already, as under nohup, stay
    ignored. Outside the main thread nothing changes.
    """
    global _heard
    if threading.current_thread() is not threading.main_thread():
        yield Heard()
        return
    outer, heard = _heard, Heard()

    def hear(number: int, frame: object) -> None:
        if heard.number is None:
            heard.number = number
            raise KeyboardInterrupt
        on_more()

    _heard = heard
    try:
        with handled(listening(), hear):
            yield heard
    finally:
        _heard = outer


def end_undisturbed() -> None:
    """Ignore `SIGNALS` from now on, since the process ends and its exit code is settled.

    A signal during Python's shutdown would otherwise kill the process and change its exit code.
    """
    atexit.register(ignore)


def ignore() -> None:
    """Ignore `SIGNALS` from now on."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


@contextlib.contextmanager
def held_interrupts() -> Iterator[threading.Event]:
    """Defer signals until the block ends; the yielded event is set if one came.

    This applies to Ctrl-C and to the signals that `heard_once` treats like it. Outside the main
    thread, or in a process that ignores them, nothing changes. If blocks are nested, only the
    outer one sets its event.
    """
    global _holds
    pressed = threading.Event()
    if _holds or threading.current_thread() is not threading.main_thread():
        yield pressed
        return

    def hold(number: int, frame: object) -> None:
        if _heard is None:
            pressed.set()
        elif _heard.number is None:
            _heard.number = number
            pressed.set()

    raising = [number for number in SIGNALS if callable(signal.getsignal(number))]
    _holds = True
    try:
        with handled(raising, hold):
            yield pressed
    finally:
        _holds = False


def listening() -> list[int]:
    """Those of `SIGNALS` that the process does not ignore, as it does under nohup."""
    return [number for number in SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]


@contextlib.contextmanager
def handled(numbers: Iterable[int], handler: Callable[[int, Any], object]) -> Iterator[None]:
    """Install a handler for signals while the block runs; outside the main thread, none."""
    is_main = threading.current_thread() is threading.main_thread()
    before = {number: signal.signal(number, handler) for number in numbers if is_main}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)
