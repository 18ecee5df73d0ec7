"""How a request can end badly, what a run may warn of, and what to say of a missing package."""

from __future__ import annotations

import contextlib
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

_INSIDE = ("taichi_foam.", "pydantic.")
"""Modules whose lines are not those that asked for something."""


class UserError(Exception):
    """The request cannot be met: the message says why, and how to mend it (exit code 2).

    `argument` is the one that the message proposes, such as "overwrite=True", as it stands there:
    the command line puts its own option in its place.
    """

    def __init__(self, message: str, argument: str | None = None) -> None:
        super().__init__(message)
        self.argument = argument


class RunError(Exception):
    """A run that started well cannot go on: the message says when and where (exit code 1).

    `results` holds what it gave until then, as `results.result.Result`.
    """

    def __init__(self, message: str, results: Sequence[Any] = ()) -> None:
        super().__init__(message)
        self.results = list(results)


class RunWarning(UserWarning):
    """There is something to say against a run's figures (`Result.warnings`), or of its length."""


class LongRunWarning(RunWarning):
    """A run that has begun will take a very great number of steps."""


class SceneNote(FutureWarning):
    """A scene says something in an old way, which is still understood."""


def note(text: str) -> None:
    """Give a note on a scene at the line, outside the package, that has it."""
    warn_of_run(text, SceneNote)


def warn_of_run(text: str, category: type[Warning] = RunWarning) -> None:
    """Give a warning at the line, outside the package, that asked for the run."""
    depth, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_globals["__name__"].startswith(_INSIDE):
        depth, frame = depth + 1, frame.f_back
    warnings.warn(text, category, stacklevel=depth)


class Interrupted(KeyboardInterrupt):
    """Ctrl-C while several scenes ran.

    `results` holds what they gave until then, as `results.result.Result`, by place in what was
    asked for; scenes that had not begun are not among them.
    """

    def __init__(self, results: Mapping[int, Any]) -> None:
        super().__init__(f"{len(results)} scenes had begun or ended")
        self.results = dict(results)


@contextlib.contextmanager
def installed(purpose: str, package: str) -> Iterator[None]:
    """Import what comes with `package` in this block; UserError says what to install if it fails.

    `package` may be one of the extras, such as "taichi-foam[live]".
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("taichi_foam"):
            raise  # a fault of ours
        raise UserError(
            f"{purpose}: needs {error.name}, which is not installed. "
            f"Fix: python -m pip install '{package}'"
        ) from None
