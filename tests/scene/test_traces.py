"""Measured pulses from CSV files: units, columns, and what is no trace."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from taichi_foam.errors import UserError
from taichi_foam.scene.traces import read_trace
from taichi_foam.units import STANDARD_GRAVITY

PULSE = [0.0, 0.1, 2.0, 8.0, 20.0, 30.0, 21.0, 9.0, 2.0, -0.5, 0.0]


def written(folder: Path, head: str, rows: list) -> Path:
    path = folder / "trace.csv"
    path.write_text("\n".join([head, *(",".join(map(str, row)) for row in rows)]), encoding="utf-8")
    return path


def rows() -> list[list]:
    return [[n, value, 2 * value] for n, value in enumerate(PULSE)]


def test_units_come_from_the_header(tmp_path: Path) -> None:
    found = read_trace(written(tmp_path, "time [ms],deceleration [g]", rows()))
    assert found.time == pytest.approx(1e-3 * np.arange(11))
    assert found.values == pytest.approx(STANDARD_GRAVITY * np.array(PULSE))
    assert (found.kind, found.head) == ("acceleration", "deceleration [g]")
    # a line of units below the names, and text above
    force = read_trace(written(tmp_path, "Drop 7\nF,t\n(kN),(ms)", [row[1::-1] for row in rows()]))
    assert force.values == pytest.approx(1e3 * np.array(PULSE))
    assert force.time[-1] == pytest.approx(0.01)
    assert force.kind == "force"


def test_one_of_several_channels(tmp_path: Path) -> None:
    path = written(tmp_path, "time [ms],top [g],base [g]", rows())
    with pytest.raises(UserError, match="2 columns with a unit of acceleration or force"):
        read_trace(path)
    assert read_trace(path, "base").values.max() == pytest.approx(60 * STANDARD_GRAVITY)
    with pytest.raises(UserError, match=r"no column .* and 'side' in its header"):
        read_trace(path, "side")


@pytest.mark.parametrize(
    ("head", "changed", "said"),
    [
        ("time,acceleration", rows(), "no column with a unit of time"),
        ("time [ms],acceleration", rows(), "no column with a unit of acceleration or force"),
        ("time [ms],a [g]", rows()[:1], "1 samples; a pulse needs at least 10"),
        ("time [ms],a [g]", [*rows(), [5, 0.0, 0]], "line 13: the time 0.005 s is not above"),
        ("time [ms],a [g]", [*rows(), ["x", 0.0, 0]], "line 13: 'x' in column 1"),
        ("time [ms],a [g]", [*rows(), [11, "nan", 0]], "line 13: nan in column 2"),
        ("time [ms],a [g]", [[n, 1.0, 0] for n in range(20)], "no peak: all values are the same"),
        ("time [ms],a [g]", [*rows()[:6], *([n, 40 + n, 0] for n in range(6, 20))], "the last"),
    ],
)
def test_what_is_no_trace(tmp_path: Path, head: str, changed: list, said: str) -> None:
    with pytest.raises(UserError, match=said):
        read_trace(written(tmp_path, head, changed))


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="cannot be read"):
        read_trace(tmp_path / "none.csv")
