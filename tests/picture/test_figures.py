"""Figures: what they show is what they were given, and nothing written overlaps."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest
from figure_checks import check_motion, check_texts
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from PIL import Image

from taichi_foam.errors import UserError
from taichi_foam.picture import figures, style
from taichi_foam.picture.style import spread
from taichi_foam.shim2000.figures import Deceleration, Whisker, decelerations, errors
from taichi_foam.shim2000.impacts import TESTS

VELOCITIES = (2.46, 3.03, 3.60)


def history_of(velocity: float, plateau: float = 70.0) -> dict[str, np.ndarray]:
    """An impact at constant deceleration: its velocity and displacement are known."""
    time = np.arange(0, 1.2 * velocity / plateau, 1e-4)
    stop = velocity / plateau
    during = np.minimum(time, stop)
    kinetic = 3.0 * (velocity - plateau * during) ** 2
    lost = 3.0 * velocity**2 - kinetic
    return {
        "time_s": time,
        "deceleration_m_s2": np.where(time < stop, plateau, 0.0),
        "deceleration_smoothed_m_s2": np.where(time < stop, plateau, 0.0),
        "velocity_m_s": velocity - plateau * during,
        "displacement_m": velocity * during - plateau * during**2 / 2,
        "impactor_kinetic_J": kinetic,
        "foam_kinetic_J": 0.01 * lost,
        "strain_J": 0.04 * lost,
        "crushing_J": 0.70 * lost,
        "shearing_J": 0.10 * lost,
        "damping_J": 0.06 * lost,
        "friction_J": 0.05 * lost,
        "fracture_J": 0.02 * lost,
        "contact_J": 0.02 * lost,
    }


def deceleration_of(velocity: float) -> Deceleration:
    history = history_of(velocity)
    return Deceleration(
        velocity,
        history["time_s"],
        history["deceleration_m_s2"],
        TESTS[f"paper/rectangular-{velocity:.2f}"].measured,
    )


def ensemble_of(velocity: float) -> Deceleration:
    """A band that spreads by up to 20 m/s2, and a blow at 3.60 m/s that leaves the scale."""
    one = deceleration_of(velocity)
    width = 20 * one.time / one.time[-1]
    blow = np.where((velocity > 3.5) & (one.time > 0.04), 900.0, one.deceleration)
    return replace(one, deceleration=blow, band=(blow - width, blow + width))


def panels() -> dict[str, list[Whisker]]:
    """Hits, misses both ways, a band beyond the scale, and a median without an answer."""
    tests = [
        Whisker("Flat block 2.46", -0.03, 0.01, 0.09),
        Whisker("Flat block 3.03", 0.10, 0.14, 0.16, held_out=True),
        Whisker("Cylinder 2.94", -0.02, 0.0, inf, held_out=True),
        Whisker("Wedge 2.10", 0.1, inf, inf),
        Whisker("Wedge 3.60", -0.32, -0.29, -0.28),
    ]
    return dict.fromkeys(("impact duration", "maximum displacement", "plateau"), tests)


def absorption_of(velocity: float, per_volume: float) -> figures.Absorption:
    energy = np.linspace(0, 3 * velocity**2, 20)
    return figures.Absorption(velocity, energy / per_volume, energy)


GROUPS = {
    "flat block": [absorption_of(v, 1.5e5) for v in VELOCITIES],
    "cylinder": [absorption_of(v, 1.4e5) for v in (2.32, 2.94, 3.32)],
}
SLOPES = {"flat block": (1.5e5, 1.56e5, 1.6e5), "cylinder": (1.32e5, 1.43e5, 1.46e5)}
BRANCHES = {
    "loading": (
        np.array([0.05, -0.05, -0.8, -0.9]),
        np.array([0.139e6, -0.139e6, -0.139e6, -4e5]),
    ),
    "unloading from 40 %": (np.array([-0.4, -0.35]), np.array([-0.139e6, 0.0])),
    "re-tension": (np.array([-0.35, 0.025]), np.array([0.0, 0.0695e6])),
}
FIGURES: dict[str, Callable[[], Figure]] = {
    "histories": lambda: figures.impact_histories({v: history_of(v) for v in VELOCITIES}),
    "decelerations": lambda: decelerations([deceleration_of(v) for v in VELOCITIES], "Flat"),
    "one deceleration": lambda: decelerations([deceleration_of(3.03)], "Flat block"),
    "bands": lambda: decelerations([ensemble_of(v) for v in VELOCITIES], "Flat block"),
    "errors": lambda: errors(panels(), 0.10),
    "energy": lambda: figures.energy_against_volume(GROUPS, SLOPES),
    "law": lambda: figures.stress_strain(BRANCHES),
    "ledger": lambda: figures.energy_ledger(history_of(3.03)),
}


@pytest.mark.parametrize("name", FIGURES)
def test_no_text_overlaps_or_is_cut(name: str) -> None:
    check_texts(FIGURES[name](), least=4)


def test_histories_are_drawn_in_the_units_of_their_axes() -> None:
    figure = figures.impact_histories({3.03: history_of(3.03)})
    assert len(figure.axes) == 3
    check_motion(figure, history_of(3.03))


def test_measured_marks_stand_at_the_tables_figures() -> None:
    figure = decelerations([deceleration_of(3.03)])
    lines = {line.get_label(): line for line in figure.axes[0].lines}
    plateau = lines["measured plateau ± 5 %"]
    np.testing.assert_allclose(plateau.get_ydata(), 74)
    np.testing.assert_allclose(plateau.get_xdata(), [3.0, 0.85 * 42])
    np.testing.assert_allclose(lines["measured duration"].get_xdata(), 42)
    ring = lines["measured initial peak"]
    np.testing.assert_array_equal(ring.get_xydata(), [[2.0, 97]])


def test_a_band_encloses_its_median() -> None:
    one = ensemble_of(3.03)
    (axis,) = decelerations([one]).axes
    band = axis.collections[0].get_paths()[0].vertices
    assert one.band is not None
    for bound in one.band:
        edge = np.column_stack([1e3 * one.time, bound])
        assert all(np.any(np.all(np.isclose(band, point), axis=1)) for point in edge[::40])
    median = next(line for line in axis.lines if line.get_label() == "median")
    np.testing.assert_allclose(median.get_ydata(), one.deceleration)


def test_misses_have_diamonds_and_their_errors_and_held_out_tests_open_marks() -> None:
    axis = errors(panels(), 0.10).axes[0]
    marks = [line for line in axis.lines if str(line.get_marker()) in "oD"]
    order = np.argsort([np.ravel(line.get_ydata())[0] for line in marks])
    drawn = [marks[k] for k in order]
    assert [mark.get_marker() for mark in drawn] == ["o", "D", "o", "D", "D"]
    opened = [mark.get_markerfacecolor() == "white" for mark in drawn]
    assert opened == [False, True, True, False, False]
    np.testing.assert_allclose(drawn[1].get_xdata(), [14])
    assert {text.get_text() for text in axis.texts} == {"+14 %", "−29 %", "no stop"}
    edges = [mark for line in axis.lines if (mark := str(line.get_marker())) in "<>"]
    assert set(edges) == {">"}  # nothing goes on beyond the left end


def test_the_ledger_stacks_up_to_the_impact_energy() -> None:
    figure = figures.energy_ledger(history_of(3.03))
    tops = [np.max(c.get_paths()[0].vertices, axis=0)[1] for c in figure.axes[0].collections]
    assert max(tops) == pytest.approx(3 * 3.03**2)
    assert len(tops) == 5  # no base


def test_energy_that_a_start_gives_back_is_counted_from_its_lowest() -> None:
    """A sheared block that is let go: what its shear loses moves the foam, and the sum stays."""
    time = np.linspace(0, 1, 50)
    history = {"time_s": time, "shearing_J": -3 * time, "foam_kinetic_J": 3 * time,
               "friction_J": np.full(50, -1e-9)}  # fmt: skip
    names, layers, _ = figures.ledger_layers(history)
    assert names == [
        "foam, elastic and in motion",
        "crushing, above its minimum",
        "friction and damping",
    ]
    np.testing.assert_allclose(layers[1], 3 - 3 * time)
    np.testing.assert_allclose(np.sum(layers, axis=0), 3.0)
    assert np.all(layers[2] == 0)


def test_what_drives_a_test_is_no_part_of_where_its_energy_went() -> None:
    """A crosshead gives 2 J, negative in base_J: the stack grows to 2 J, all crushing."""
    time = np.linspace(0, 1, 50)
    history = {"time_s": time, "base_J": -2 * time, "crushing_J": 2 * time}
    names, layers, _ = figures.ledger_layers(history)
    assert names == ["crushing"]
    np.testing.assert_allclose(layers[0], 2 * time)


def test_a_ledger_without_energy_is_refused() -> None:
    with pytest.raises(UserError, match="no energy"):
        figures.energy_ledger({"time_s": np.arange(3.0), "crushing_J": np.zeros(3)})


def test_figures_are_saved_as_png_and_svg_and_are_the_same_each_time(tmp_path: Path) -> None:
    digests = []
    for k in range(2):
        figure = figures.stress_strain({"elastic": ([0.0, -0.05], [0.0, -0.139e6])})
        png, svg = style.save(figure, tmp_path / f"law{k}.png", svg=True)
        with Image.open(png) as image:
            assert image.size == (960, 648)
        digests.append(svg.read_bytes())
    assert digests[0] == digests[1]
    assert b"<svg" in digests[0]


def test_a_figure_that_cannot_be_saved_is_reported(tmp_path: Path) -> None:
    figure = figures.stress_strain({"elastic": ([0.0, -0.05], [0.0, -0.139e6])})
    with pytest.raises(UserError, match=r"end in \.png, \.svg or \.pdf"):
        style.save(figure, tmp_path / "law.jpg")
    with pytest.raises(UserError, match="could not be written"):
        style.save(figure, tmp_path / "absent" / "law.png")


def test_figures_leave_pyplot_and_the_global_style_alone() -> None:
    code = (
        # Asking for the backend would make Matplotlib choose one, and load pyplot for it.
        "import sys, matplotlib as mpl\n"
        "before = {k: mpl.rcParams[k] for k in mpl.rcParams if k != 'backend'}\n"
        "from taichi_foam.picture import figures\n"
        "figures.stress_strain({'a': ([0.0, -0.05], [0.0, -1e5])})\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
        "assert all(mpl.rcParams[k] == v for k, v in before.items())\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@given(
    st.lists(st.floats(-100, 100), min_size=1, max_size=12),
    st.floats(0.01, 20),
)
def test_labels_are_spread_apart_and_keep_their_order(wanted: list[float], apart: float) -> None:
    placed = spread(wanted, apart)
    order = np.argsort(wanted, kind="stable")
    gaps = np.diff(np.array(placed)[order])
    assert np.all(gaps >= apart * (1 - 1e-9) - 1e-9)
    # Shifting a stack as a whole keeps the mean of the wanted places.
    assert np.mean(placed) == pytest.approx(np.mean(wanted), abs=1e-6)


def test_labels_that_fit_stay_where_they_are() -> None:
    assert spread([5.0, 0.0, 9.0], 2.0) == pytest.approx([5.0, 0.0, 9.0])
    assert spread([1.0, 1.0], 2.0) == pytest.approx([0.0, 2.0])
