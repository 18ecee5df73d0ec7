"""What studies of many runs of the nine tests share: the tests, their figures, tables."""

from __future__ import annotations

from collections.abc import Sequence

from taichi_foam.analysis.bands import Band, band
from taichi_foam.analysis.measures import (
    DISPLACEMENT,
    DURATION,
    ENERGY_PER_VOLUME,
    PLATEAU,
)
from taichi_foam.errors import UserError
from taichi_foam.shim2000.impacts import case_names

ORDER = (DURATION, DISPLACEMENT, PLATEAU, ENERGY_PER_VOLUME)


def median_and_range(values: Sequence[float | None]) -> Band:
    """Least, median and largest; a run that has no answer counts as inf."""
    return band(values, ends=(0.0, 1.0))


def percent(error: float | None) -> str:
    """A relative error, in per cent; a dash for no answer."""
    return "–" if error is None or error == float("inf") else f"{100 * error:+.0f}"


def short(name: str) -> str:
    """ "paper/rectangular-2.46" as the tables have it: flat 2.46."""
    shape, velocity = name.removeprefix("paper/").split("-")
    return f"{'flat' if shape == 'rectangular' else shape} {velocity}"


COARSE = ("block.columns=20", "block.rows=10")
"""Settings with which an impact takes a second: for `--smoke`, whose figures nobody reads."""


def full_names(cases: str | None) -> list[str]:
    """Tests given as "wedge-2.86,cylinder-3.32", or all nine."""
    try:
        return case_names(cases.split(",") if cases else None)
    except UserError as error:
        raise SystemExit(str(error)) from None
