"""Units of pulses and outlines in CSV files: none is lost, wherever a machine writes it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from taichi_foam.errors import UserError
from taichi_foam.scene.library import read_corners, read_pulse
from taichi_foam.scene.measured import read_test
from taichi_foam.units import STANDARD_GRAVITY

SQUARE = "0,0\n40,0\n40,30\n0,30\n"


@pytest.mark.parametrize(
    "header", ["time [ms],acceleration [g]", "time,acceleration\nms,g", "t,a\n[ms],[g]"]
)
def test_a_pulse_has_the_units_of_its_header_or_of_the_line_below(
    header: str, tmp_path: Path
) -> None:
    (tmp_path / "pulse.csv").write_text(f"{header}\n0,0\n5,50\n10,0\n")
    pulse = read_pulse(tmp_path / "pulse.csv")
    assert pulse.time == pytest.approx((0.0, 0.005, 0.01))
    assert pulse.peak == pytest.approx(50 * STANDARD_GRAVITY)


@pytest.mark.parametrize("header", ["x [mm],y [mm]", "x,y\nmm,mm"])
def test_an_outline_too(header: str, tmp_path: Path) -> None:
    (tmp_path / "outline.csv").write_text(f"{header}\n{SQUARE}")
    assert read_corners(tmp_path / "outline.csv")[2] == pytest.approx((0.04, 0.03))


@pytest.mark.parametrize(
    ("read", "text"),
    [
        (read_pulse, "time [ms],acceleration [g]\nrun 5, channel 2\n0,0\n5,50\n10,0\n"),
        (read_corners, f"x [mm],y [mm]\nleft,upper\n{SQUARE}"),
    ],
)
def test_units_that_text_parts_from_the_numbers_are_not_passed_over(
    read: Callable[[Path], object], text: str, tmp_path: Path
) -> None:
    (tmp_path / "some.csv").write_text(text)
    with pytest.raises(UserError, match=r"line 1: this header has units, but text stands between"):
        read(tmp_path / "some.csv")


def test_a_file_that_is_cut_off_within_a_character(tmp_path: Path) -> None:
    whole = "strain,stress [kPa]\n0,0\n0.1,100\n0.5,120\n".encode("utf-16")
    (tmp_path / "test.csv").write_bytes(whole[:-1])
    with pytest.raises(UserError, match="not complete UTF-16 text"):
        read_test(tmp_path / "test.csv")
