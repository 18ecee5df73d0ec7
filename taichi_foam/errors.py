"""Exceptions and warnings of the package, and the message for a missing dependency."""

from __future__ import annotations

import contextlib
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

_INSIDE = ("taichi_foam.", "pydantic.")
"""Modules that are skipped when a warning is attributed to the calling line."""


class UserError(Exception):
    """The request cannot be met: the message says why, and how to fix it (exit code 2).

    `argument` is the Python argument that the message proposes, such as "overwrite=True", as
    written there: the command line replaces it with its own option.
    """

    def __init__(self, message: str, argument: str | None = None) -> None:
        super().__init__(message)
        self.argument = argument


class RunError(Exception):
    """A run that started well cannot continue: the message says when and where (exit code 1).

    `results` holds the results so far, as `results.result.Result`.
    """

    def __init__(self, message: str, results: Sequence[Any] = ()) -> None:
        super().__init__(message)
        self.results = list(results)


class RunWarning(UserWarning):
    """A run's figures are doubtful (`Result.warnings`), or it will take very long."""


class LongRunWarning(RunWarning):
    """A run that has begun will take a very large number of steps."""


class SceneNote(FutureWarning):
    """A scene uses an old notation, which still works."""


def note(text: str) -> None:
    """Issue a `SceneNote`, attributed to the calling line outside the package."""
    warn_of_run(text, SceneNote)


def warn_of_run(text: str, category: type[Warning] = RunWarning) -> None:
    """Issue a warning, attributed to the line outside the package that started the run."""
    depth, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_globals["__name__"].startswith(_INSIDE):
        depth, frame = depth + 1, frame.f_back
    warnings.warn(text, category, stacklevel=depth)


class Interrupted(KeyboardInterrupt):
    """Ctrl-C while several scenes ran.

    `results` holds the results so far, as `results.result.Result`, by index of the scene; scenes
    that had not begun are missing.
    """

    def __init__(self, results: Mapping[int, Any]) -> None:
        super().__init__(f"{len(results)} scenes had started or finished")
        self.results = dict(results)


@contextlib.contextmanager
def installed(purpose: str, package: str) -> Iterator[None]:
    """Import modules of `package` in this block; if that fails, UserError says what to install.

    `package` may be one of the extras, such as "taichi-foam[live]".
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("taichi_foam"):
            raise  # an error in this package
        raise UserError(
            f"{purpose}: needs {error.name}, which is not installed. "
            f"Fix: python -m pip install '{package}'"
        ) from None
