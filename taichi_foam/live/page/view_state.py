"""What the page shows now: the latest message of each kind, pictures and the curve."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from taichi_foam.live.page.curve import Curve
from taichi_foam.results.files import plain

Tone = str  # "light" or "dark"

#: Of the numbers in messages: more than anybody can see.
DIGITS = 6

_EMPTY = np.empty(0)


def as_json(content: dict[str, Any], digits: int | None = DIGITS) -> str:
    """A message's text; `digits` are those that its floats keep, None: all."""
    return json.dumps(plain(content, digits), separators=(",", ":"), allow_nan=False)


class ViewState:
    """Written once for all viewers, who read it in whatever thread they are in.

    notes     by kind: a number that grows with each change, and the message
    pictures  by tone: the same, and the picture as it is sent
    curve     the same of the current drop's curve
    """

    def __init__(self) -> None:
        self.notes: dict[str, tuple[int, str]] = {}
        self.pictures: dict[Tone, tuple[int, bytes]] = {}
        self.curve = (0, Curve(0, _EMPTY, _EMPTY))
        self.wake: Callable[[], object] = lambda: None
        self._wanted: set[Tone] = set()
        self._lock = threading.Lock()  # guards the tones

    def post(self, kind: str, content: dict[str, Any], digits: int | None = DIGITS) -> None:
        """Show this from now on; the same again is no change. `digits` as of `as_json`."""
        text = as_json({"kind": kind, **content}, digits)
        number, before = self.notes.get(kind, (0, ""))
        if text != before:
            self.notes[kind] = (number + 1, text)
            self.wake()

    def set_picture(self, tone: Tone, picture: bytes) -> None:
        """Show this picture from now on."""
        number, _ = self.pictures.get(tone, (0, b""))
        self.pictures[tone] = (number + 1, picture)
        self.wake()

    def set_curve(self, curve: Curve) -> None:
        """Show this curve from now on; the same again is no change."""
        number, before = self.curve
        if curve is not before:
            self.curve = (number + 1, curve)
            self.wake()

    def want(self, tone: Tone) -> None:
        """Some viewer is ready for the next picture in this tone."""
        with self._lock:
            self._wanted.add(tone)

    def take_wanted(self) -> set[Tone]:
        """The tones in which a picture is wanted; the caller has to draw them."""
        with self._lock:
            wanted, self._wanted = self._wanted, set()
        return wanted
