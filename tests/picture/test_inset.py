"""The deceleration inside a frame: where its line lies, and how its axes are chosen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from picture_states import intact, scene_of

from taichi_foam.picture import annotate, inset, raster
from taichi_foam.picture.inset import Curve
from taichi_foam.picture.look import THEMES
from taichi_foam.picture.view import Box

BOX = Box(10, 20, 335, 170)


def ramp(last: float = 0.05, top: float = 100.0) -> Curve:
    """A straight line from nothing to `top` at `last`."""
    time = np.linspace(0, last, 501)
    return Curve(time, top * time / last, last, top)


def drawn(curve: Curve, theme: str = "light") -> np.ndarray:
    """Which pixels of the box have the curve's own colour."""
    image = annotate.blank(400, 200, (1, 2, 3))
    inset.draw(image, BOX, [curve], theme, 0.75)
    outside = image.copy()
    outside[BOX.top : BOX.bottom, BOX.left : BOX.right] = (1, 2, 3)
    assert np.all(outside == (1, 2, 3))
    inside = image[BOX.top : BOX.bottom, BOX.left : BOX.right]
    return np.all(inside == THEMES[theme].curves[0], axis=-1)


@pytest.mark.parametrize("theme", THEMES)
def test_a_straight_line_is_drawn_straight_between_the_axes_ends(theme: str) -> None:
    rows, columns = np.nonzero(drawn(ramp(), theme))
    assert np.corrcoef(rows, columns)[0, 1] < -0.999
    slope = np.polyfit(columns, rows, 1)[0]
    assert slope == pytest.approx(-np.ptp(rows) / np.ptp(columns), rel=0.03)


def test_the_curve_grows_to_the_time_shown_and_keeps_its_axes() -> None:
    whole = drawn(ramp())
    half = drawn(ramp().until(0.025))
    reach = [np.flatnonzero(seen.any(axis=0)) for seen in (whole, half)]
    share = np.ptp(reach[1]) / np.ptp(reach[0])
    assert share == pytest.approx(0.5, abs=0.04)  # the dot at its end is 5 px wide
    assert np.mean(whole[half]) > 0.85  # all but that dot


def test_the_right_axis_is_in_g(written: list) -> None:
    """Its figures are those of the left one over 9.80665 m/s2: what changes them changes pixels."""
    inset.draw(annotate.blank(400, 200), BOX, [ramp(top=1961.33)], "light", 0.74)
    words = {text for _, text, _ in written}
    assert {"980.665", "1961.33", "100", "200"} <= words
    assert any("right g" in text for text in words)


def test_nothing_yet_is_an_empty_diagram() -> None:
    assert not drawn(ramp().until(-1.0)).any()
    unknown = Curve(np.array([0.0]), np.array([np.nan]), 0.05, 100.0)
    assert not drawn(unknown).any()


@pytest.mark.parametrize(
    ("top", "last", "axes"), [(75.0, 0.0544, (80.0, 0.06)), (0.0, 0.001, (1.0, 0.001))]
)
def test_axes_end_at_round_figures_that_hold_the_curve(top, last, axes) -> None:
    history = {
        "time_s": np.linspace(0, last, 50),
        "deceleration_smoothed_m_s2": np.linspace(0, top, 50),
    }
    curve = Curve.of(history)
    assert (curve.top, curve.last) == pytest.approx(axes)


def test_a_frame_has_the_curve_in_its_upper_left_corner_and_a_small_one_none() -> None:
    scene = scene_of()
    state = intact(scene)
    without, with_curve = (raster.frame(state, scene, curve=c) for c in (None, ramp()))
    rows, columns = np.nonzero(np.any(without != with_curve, axis=-1))
    field = raster.Layout((1280, 720)).field
    assert rows.min() > field.top
    assert columns.min() > field.left
    assert rows.max() < field.top + 0.35 * field.height
    assert columns.max() < field.left + 0.4 * field.width
    small = [raster.frame(state, scene, (160, 120), curve=c) for c in (None, ramp())]
    np.testing.assert_array_equal(*small)


@pytest.mark.parametrize(
    ("names", "width", "lines"),
    [
        (["a", "b"], 300, 1),
        (["a name that is too long", "another that is too long"], 300, 1),
        (["a", "b", "c"], 300, 1),
        (["wedge, 2.86", "cylinder, 3.32", "flat, 3.03"], 300, 2),
        (["wedge, 2.86", "cylinder, 3.32", "flat, 3.03", "wedge, 3.60"], 300, 2),
        (["wedge, 2.86", "cylinder, 3.32", "flat, 3.03", "wedge, 3.60"], 200, 0),
    ],
)
def test_names_stand_in_lines_above_the_diagram_where_they_have_room(
    names, width, lines, monkeypatch
) -> None:
    written = {}
    write = annotate.write

    def record(image, xy, string, face, **options) -> None:
        written[string] = xy
        write(image, xy, string, face, **options)

    monkeypatch.setattr(annotate, "write", record)
    inset._panel.cache_clear()
    image = annotate.blank(400, 200)
    curves = [
        replace(ramp(), deceleration=ramp().deceleration / (k + 1), name=name, place=k)
        for k, name in enumerate(names)
    ]
    inset.draw(image, Box(10, 10, 10 + width, 190), curves, "light", 0.75)
    inset._panel.cache_clear()
    found = [xy for text, xy in written.items() if any(text[:4] == name[:4] for name in names)]
    assert len({y for _, y in found}) == lines
    assert len(found) == (len(names) if lines else 0)
    for tone in THEMES["light"].curves[: len(names)]:
        assert np.all(image == tone, axis=-1).any()


def test_names_that_would_be_cut_to_the_same_stand_below_one_another_or_not_at_all(
    written: list,
) -> None:
    history = {"time_s": np.linspace(0, 0.02, 9), "deceleration_smoothed_m_s2": np.ones(9)}
    for words, shown in (("a name of one kind ", 2), ("long " * 30, 0)):
        names = [words + end for end in "ab"]
        curves = [Curve.of(history, None, name, k) for k, name in enumerate(names)]
        written.clear()
        inset.draw(annotate.blank(400, 300), Box(0, 0, 330, 200), curves, "light", 1.0)
        assert len([text for _, text, _ in written if text.startswith(words[:4])]) == shown
