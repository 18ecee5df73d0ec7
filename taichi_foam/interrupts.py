"""Ctrl-C and its like at a bad moment: heard once, and held while giving up would lose something.

SIGTERM, which batch systems send before they kill, and SIGHUP, which a terminal sends when it is
closed, are taken as Ctrl-C by commands: what there is is kept.
"""

from __future__ import annotations

import atexit
import contextlib
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

SIGNALS = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]


@dataclass
class Heard:
    """The first signal that came, None so far."""

    number: int | None = None

    @property
    def exit_code(self) -> int:
        """What a process that it has ended leaves with: 130 for Ctrl-C."""
        return 128 + (signal.SIGINT if self.number is None else self.number)


# of the command that runs, if one does
_heard: Heard | None = None
# whether signals are held
_holds = False


@contextlib.contextmanager
def heard_once(on_more: Callable[[], object] = lambda: None) -> Iterator[Heard]:
    """Take the first of `SIGNALS` as Ctrl-C; all that come later until the block ends are ignored.

    What follows the first is saving, which a second Ctrl-C must not spoil; `on_more` is called for
    each. A signal that the process ignores, as under nohup, it goes on ignoring. Outside the main
    thread nothing changes.
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

    listening = [number for number in SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
    _heard = heard
    try:
        with _handled(listening, hear):
            yield heard
    finally:
        _heard = outer


def end_undisturbed() -> None:
    """Have a process that ends ignore `SIGNALS`: its exit code is settled.

    While Python takes itself down a signal would end the process as if nobody had heard it.
    """
    atexit.register(lambda: [signal.signal(number, signal.SIG_IGN) for number in SIGNALS])


@contextlib.contextmanager
def held_interrupts() -> Iterator[threading.Event]:
    """Let the block end although a signal comes; the event then tells that one did.

    Held are Ctrl-C and what `heard_once` takes for it. Where they never arrive, outside the main
    thread or in a process that ignores them, nothing changes. Within another hold it is that one
    that tells.
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
        with _handled(raising, hold):
            yield pressed
    finally:
        _holds = False


@contextlib.contextmanager
def _handled(numbers: Sequence[int], handler: Callable[[int, Any], None]) -> Iterator[None]:
    """Have signals handled in another way for as long as the block lasts."""
    before = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)
