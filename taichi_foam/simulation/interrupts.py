"""Ctrl-C at a moment when giving up would lose what is already there."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator


@contextlib.contextmanager
def held_interrupts() -> Iterator[threading.Event]:
    """Let the block end although Ctrl-C is pressed; the event then tells that it was.

    Where Ctrl-C never arrives, outside the main thread or in a process that ignores it, nothing
    changes.
    """
    pressed = threading.Event()
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        yield pressed
        return
    before = signal.signal(signal.SIGINT, lambda number, frame: pressed.set())
    try:
        yield pressed
    finally:
        signal.signal(signal.SIGINT, before)
