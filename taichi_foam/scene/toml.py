"""TOML text as plain data, within limits that no scene exceeds."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from taichi_foam.errors import UserError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

MOST_BYTES = 200_000
"""Most bytes of a scene's text; those of the package have about 1,000."""

LONGEST_LINE = 2_000
"""Most characters of a line. The work of parsing a dotted key grows with the square of the number
of its parts, and a key cannot continue on the next line."""

DEEPEST = 20
"""Most levels of nested tables and arrays; a scene has four."""

_MARKS = {
    b"\xff\xfe\x00\x00": "UTF-32",
    b"\x00\x00\xfe\xff": "UTF-32",
    b"\xff\xfe": "UTF-16",
    b"\xfe\xff": "UTF-16",
}
"""Byte order marks of other encodings, the longer ones first."""


def read_toml(path: Path) -> dict[str, Any]:
    """The data of a TOML file in UTF-8, with or without a byte order mark; not yet validated.

    Raises UserError: unreadable, another encoding, not TOML, or beyond the limits of this module.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError:
        raise UserError(f"{str(path)!r}: not a possible file name") from None
    if len(data) > MOST_BYTES:
        raise UserError(
            f"{path}: longer than {MOST_BYTES:,} bytes; a scene has a few thousand at most; give "
            "the file of a scene"
        )
    for mark, encoding in _MARKS.items():
        if data.startswith(mark):
            raise UserError(f"{path}: {encoding} text; save it as UTF-8")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UserError(f"{path}: not UTF-8 text (byte {error.start}); save it as UTF-8") from None
    return parsed(text, str(path))


def parsed(text: str, source: str) -> dict[str, Any]:
    """The data of TOML text from `source`.

    Raises UserError: not TOML, or beyond the limits of this module.
    """
    for number, line in enumerate(text.split("\n"), 1):
        if len(line) > LONGEST_LINE:
            raise UserError(
                f"{source}: line {number} has {len(line):,} characters; at most {LONGEST_LINE:,}; "
                "break it, or shorten its key"
            )
    try:
        data = tomllib.loads(text)
    except ValueError as error:  # also raised for integers with thousands of digits
        raise UserError(f"{source}: not valid TOML: {_first_words(error)}") from None
    except RecursionError:
        raise UserError(_too_deep(source)) from None
    if _is_deeper(data, DEEPEST):
        raise UserError(_too_deep(source))
    return data


def _first_words(error: ValueError) -> str:
    """The parser's message, shortened, since it may repeat a key of any length."""
    text = str(error)
    if not isinstance(error, tomllib.TOMLDecodeError) and "digits" in text:
        return "a whole number with thousands of digits"
    return text if len(text) <= 200 else f"{text[:120]} ... {text[-40:]}"


def _too_deep(source: str) -> str:
    return (
        f"{source}: tables or arrays nested more than {DEEPEST} deep; a scene has at most four "
        "levels"
    )


def _is_deeper(data: Any, levels: int) -> bool:
    """Whether tables and arrays are nested deeper than `levels`; does not recurse."""
    level = [data]
    for _ in range(levels + 1):
        inner: list[Any] = []
        for value in level:
            if isinstance(value, Mapping):
                inner += value.values()
            elif isinstance(value, list):
                inner += value
        level = inner
        if not level:
            return False
    return True
