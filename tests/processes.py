"""Processes that tests start, and waiting for what they and other threads do."""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

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


@contextmanager
def without_rights() -> Iterator[None]:
    """Root may write anywhere: it is nobody while the block runs. Skipped without Unix users."""
    if not hasattr(os, "geteuid"):
        pytest.skip("needs Unix permissions")
    is_root = os.geteuid() == 0
    if is_root:
        os.seteuid(65534)
    try:
        yield
    finally:
        if is_root:
            os.seteuid(0)
