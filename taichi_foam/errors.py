"""The two ways in which a request can end badly."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


class UserError(Exception):
    """The request cannot be met: the message says why, and how to mend it (exit code 2)."""


class RunError(Exception):
    """A run that started well cannot go on: the message says when and where (exit code 1).

    `results` holds what it gave until then, as `results.result.Result`.
    """

    def __init__(self, message: str, results: Sequence[Any] = ()) -> None:
        super().__init__(message)
        self.results = list(results)
