"""The ways in which a request can end badly, and what to say of a package that is missing."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any


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
