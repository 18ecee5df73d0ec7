"""Processes that tests start, and waiting for what they and other threads do."""

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import taichi_foam

#: They find the package that the tests import, from any folder.
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(taichi_foam.__file__).parents[1])}

PATIENCE = 120.0
"""For a busy machine that compiles [s]."""


def until(
    is_it: Callable[[], Any],
    what: str,
    patience: float = PATIENCE,
    turn: Callable[[float], object] = time.sleep,
) -> Any:
    """Wait until something holds, and return it.

    what  says what is wrong if it never holds
    turn  takes the time between two looks [s]
    """
    end = time.monotonic() + patience
    while not (found := is_it()):
        assert time.monotonic() < end, what
        turn(0.02)
    return found
