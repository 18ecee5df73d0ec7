"""Ctrl-C at a moment when giving up would lose what is already there."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator


@contextlib.contextmanager
def held_interrupts() -> Iterator[threading.Event]:
    """Let the block end although Ctrl-C is pressed; the event then tells that it was.

    Outside the main thread, where Ctrl-C never arrives, nothing changes.
    """
    pressed = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield pressed
        return
    before = signal.signal(signal.SIGINT, lambda number, frame: pressed.set())
    try:
        yield pressed
    finally:
        signal.signal(signal.SIGINT, before)
