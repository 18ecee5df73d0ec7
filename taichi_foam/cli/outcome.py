"""The frame of a command: its output, and its end with a message and an exit code."""

from __future__ import annotations

import contextlib
import os
import warnings
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import typer
from rich.console import Console, RenderableType
from rich.table import Table
from rich.text import Text

from taichi_foam.errors import LongRunWarning, RunError, RunWarning, SceneNote, UserError
from taichi_foam.interrupts import end_undisturbed, heard_once
from taichi_foam.simulation.progress import Bars

FAILED, REFUSED, INTERRUPTED = 1, 2, 130


class Terminal:
    """Output of a command.

    out     for requested output
    errors  for everything else
    bars    progress, on `errors`
    """

    def __init__(self, out: Console | None = None, errors: Console | None = None) -> None:
        """The default is the two standard streams of the process."""
        self.out = out or Console(highlight=False)
        self.errors = errors or Console(stderr=True, highlight=False)
        self.bars = Bars(self.errors)

    def show(self, *parts: RenderableType) -> None:
        """Print tables, and text wrapped to the terminal."""
        for part in parts:
            self.out.print(part)

    def line(self, text: str) -> None:
        """Print a line of plain text, unwrapped, for programs that read it."""
        self.out.print(text, soft_wrap=True, markup=False)

    def warn(self, texts: Iterable[str], word: str = "warning") -> None:
        """Print such lines on standard error, each preceded by `word`."""
        for text in texts:
            self.errors.print(f"{word}: {text}", soft_wrap=True, markup=False)

    def where(self, folder: str) -> None:
        """List the files just written into a folder, those of most interest first."""
        from taichi_foam.results.folders import UNFINISHED
        from taichi_foam.results.manifest import MANIFEST

        order = ("report.html", "film.mp4", "film.gif", "frames", "summary.json")
        names = [name for name in os.listdir(folder) if name not in (UNFINISHED, MANIFEST)]
        names.sort(key=lambda n: (order.index(n) if n in order else 99, n))
        self.line(f"in {folder}: {', '.join(names)}")


def columns(*heads: str, **style: Any) -> Table:
    """A table of narrow columns without lines; a leading > in a head right-aligns its column."""
    table = Table(box=None, pad_edge=False, **style)
    for head in heads:
        right = head.startswith(">")
        table.add_column(head.removeprefix(">"), justify="right" if right else "left", no_wrap=True)
    return table


def check_name(path: Path, overwrite: bool, what: str) -> None:
    """Raise UserError for a path that is taken; `what` could be chosen instead, with --out."""
    if os.path.lexists(path) and not overwrite:
        raise UserError(
            f"{path}: already exists. Fix: pass --overwrite to replace it, or choose another "
            f"{what} with --out."
        )


@contextlib.contextmanager
def command() -> Iterator[Terminal]:
    """Frame of a command: yields its output, and ends it as `exit_codes` does."""
    terminal = Terminal()
    with exit_codes(terminal.errors):
        yield terminal


@contextlib.contextmanager
def exit_codes(console: Console) -> Iterator[None]:
    """Print errors of the block without a traceback, and exit with their exit code.

    SIGTERM and SIGHUP end it like Ctrl-C. Python warnings about runs are not printed, since the
    commands print these themselves.
    """
    with heard_once(_ask_for_patience) as heard, warnings.catch_warnings():
        warnings.simplefilter("ignore", RunWarning)
        warnings.simplefilter("always", LongRunWarning)
        warnings.showwarning = partial(_say_warning, console, warnings.showwarning)
        try:
            yield
        except UserError as error:
            raise _told(console, _with_options(error), REFUSED) from None
        except RunError as error:
            raise _told(console, str(error), FAILED) from None
        except KeyboardInterrupt as error:
            end_undisturbed()
            text = str(error) or "there was nothing to save yet"
            raise _told(console, text, heard.exit_code) from None
        except BrokenPipeError:
            raise  # the reader of the output is gone; Typer exits quietly
        except OSError as error:
            where = f"{error.filename}: " if error.filename else ""
            text = (
                f"{where}{error.strerror or error}; check the disk, the folder and its permissions"
            )
            raise _told(console, text, REFUSED) from None
        except ImportError as error:
            text = str(error)
            if "libX11" in text:
                text = (
                    f"Taichi cannot be loaded ({text}); install libX11 (Debian: apt install "
                    "libx11-6)"
                )
            elif error.name != "taichi_foam.backend":
                raise
            raise _told(console, text, REFUSED) from None


def _say_warning(
    console: Console, otherwise: Callable, message: Warning | str, category: type, *rest: Any
) -> None:
    """Print warnings of this package as lines; leave all others to Python."""
    if issubclass(category, LongRunWarning | SceneNote):
        word = "note" if issubclass(category, SceneNote) else "warning"
        console.print(f"{word}: {message}", soft_wrap=True, markup=False)
    else:
        otherwise(message, category, *rest)


def _ask_for_patience() -> None:
    """Respond to a second Ctrl-C while data is being saved."""
    with contextlib.suppress(OSError):
        os.write(2, b"saving what there is; one moment\n")


def _with_options(error: UserError) -> str:
    """The message, with the argument that it proposes replaced by the command line's option."""
    text, argument = str(error), error.argument
    if argument is None:
        return text
    name, _, value = argument.partition("=")
    option = f"--{name.replace('_', '-')}"
    if value != "True":
        option += " " + value.strip("'")
    return text.replace(argument, option)


def _told(console: Console, text: str, code: int) -> typer.Exit:
    word = "interrupted" if code > 128 else "error"
    message = Text(f"{word}: ", style="bold red") + Text(text, style="not bold default")
    # Without a terminal the line is not wrapped.
    console.print(message, soft_wrap=not console.is_terminal)
    return typer.Exit(code)
