"""The table of a series of drops on one block, as CSV."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

DROP_COLUMNS = (
    "drop",
    "peak_deceleration_cfc180_g",
    "peak_deceleration_g",
    "max_strain",
    "max_displacement_m",
    "impact_duration_s",
    "restitution",
    "contact_height_m",
    "rest_height_m",
    "bottomed_out",
    "broken_bonds",
    "energy_residual",
    "interrupted",
)
"""Keys of summary.json that a row has; one without an answer is empty."""


def write_drops(path: Path, summaries: Sequence[Mapping[str, Any]]) -> None:
    """Write a row for each drop, in order. Raises OSError."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(DROP_COLUMNS)
        writer.writerows([_text(summary[key]) for key in DROP_COLUMNS] for summary in summaries)


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return "" if value is None else repr(value)
