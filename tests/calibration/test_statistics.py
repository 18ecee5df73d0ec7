"""The emulator and the posterior, against closed forms and against scikit-learn itself."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np
import pulses
import pytest
from numpy.typing import NDArray
from sklearn.gaussian_process import GaussianProcessRegressor

from taichi_foam.calibration.emulator import Emulator, emulator_of
from taichi_foam.calibration.outcome import parameters_of
from taichi_foam.calibration.posterior import (
    FAR,
    RULED_OUT,
    Posterior,
    Target,
    next_points,
    sample,
)
from taichi_foam.calibration.reading import Measured, Reader, reading_of
from taichi_foam.calibration.space import Range, Space
from taichi_foam.catalogue import load_scene
from taichi_foam.errors import UserError
from taichi_foam.sweeps.sampling import unit_points

Array = NDArray[np.float64]


@dataclass
class Linear:
    """An emulator whose figures are linear in the parameters, with known deviations."""

    slopes: Array  # (k, d)
    deviation: Array  # (k,)
    doubt: float = 1.0

    @property
    def correlation(self) -> Array:
        return np.eye(len(self.deviation))

    def predict(self, unit: Array) -> tuple[Array, Array]:
        mean = unit @ self.slopes.T
        return mean, np.broadcast_to(self.deviation, mean.shape)

    def success(self, unit: Array) -> Array:
        return np.ones(len(unit))


def target_at(truth: Array, slopes: Array, deviation: float, error: float) -> Target:
    """Figures measured without luck, good or bad: the posterior is centred on the truth."""
    size = len(slopes)
    emulator = cast(Emulator, Linear(slopes, np.full(size, deviation)))
    return Target(emulator, slopes @ truth, error**2 * np.eye(size), np.ones(size), tolerated=0.0)


def test_the_posterior_of_linear_figures_is_normal_with_the_covariance_of_least_squares() -> None:
    slopes, truth = np.array([[1.0, 0.5], [0.0, 1.0], [1.0, -1.0]]), np.array([0.45, 0.55])
    found = sample([target_at(truth, slopes, 0.03, 0.04)], 2, 0.0)
    expected = np.linalg.inv(slopes.T @ slopes / 0.05**2)
    # sampling errors: of a mean sd/sqrt(n), of a variance its sqrt(2/n) part
    error = 4.0 / np.sqrt(found.independent)
    assert found.independent > 500
    assert found.unit.mean(axis=0) == pytest.approx(truth, abs=error * np.sqrt(expected.max()))
    assert np.cov(found.unit.T) == pytest.approx(expected, abs=error * np.sqrt(2) * expected.max())


def test_a_discrepancy_is_found_where_figures_contradict_each_other() -> None:
    """Two figures that depend on the same parameter, 0.2 apart, with errors of 0.01."""
    slopes = np.array([[1.0], [1.0]])
    torn = Target(
        cast(Emulator, Linear(slopes, np.full(2, 0.01))),
        np.array([0.4, 0.6]), 1e-4 * np.eye(2), np.ones(2),
    )  # fmt: skip
    at_one = target_at(np.array([0.5]), slopes, 0.01, 0.01)
    apart, together = sample([torn], 1, most=400), sample([at_one], 1, most=400)
    assert np.quantile(apart.discrepancy, 0.05) > np.median(together.discrepancy)
    assert apart.unit.std() > 2 * together.unit.std()


def test_another_wave_goes_where_nothing_is_ruled_out() -> None:
    target = target_at(np.array([0.3, 0.7]), np.eye(2), 0.02, 0.02)
    points, part = next_points(target, 2, 64, 0)
    # two figures: the larger deviation counts, so that a square is left
    reach = RULED_OUT * np.hypot(0.02, 0.02)
    assert np.abs(points - [0.3, 0.7]).max() <= reach
    assert part == pytest.approx((2 * reach) ** 2, rel=0.1)


def test_what_an_earlier_wave_has_ruled_out_stays_out() -> None:
    """The next emulator knows nothing beyond its runs: by itself it would allow any point."""
    first = target_at(np.array([0.3, 0.7]), np.eye(2), 0.02, 0.0)
    ignorant = target_at(np.array([0.3, 0.7]), np.zeros((2, 2)), 1.0, 0.0)
    found = sample([replace(ignorant, before=first)], 2, 0.0)
    away = np.abs(found.unit - [0.3, 0.7]).max(axis=1) / 0.02
    # even in a square of 2 FAR, and beyond it as a normal distribution falls: the perimeter is 8 r
    beyond = 8.0 * (FAR * np.sqrt(np.pi / 2.0) + 1.0)
    part = beyond / (beyond + 4.0 * FAR**2)
    error = np.sqrt(part * (1.0 - part) / found.independent)
    assert np.mean(away > FAR) == pytest.approx(part, abs=4.0 * error)
    assert away.max() < FAR + 6.0
    points, _ = next_points(replace(ignorant, before=first), 2, 64, 0)
    assert np.abs(points - [0.3, 0.7]).max() <= 0.02 * RULED_OUT


def test_the_emulator_predicts_what_scikit_learn_predicts(monkeypatch) -> None:
    fitted: list[GaussianProcessRegressor] = []
    fit = GaussianProcessRegressor.fit

    def recorded(process, *data):
        fitted.append(process)
        return fit(process, *data)

    monkeypatch.setattr(GaussianProcessRegressor, "fit", recorded)
    unit = unit_points("sobol", 2, 32, 0)
    noise = 0.05 * np.random.default_rng(0).normal(size=32)
    x, y = unit.T
    figures = np.stack([np.sin(3 * x) + y + noise, 50.0 + x + y**2 + noise, y + noise], axis=1)
    emulator = emulator_of(unit, figures)
    at = unit_points("sobol", 2, 16, 1)
    mean, deviation = emulator.predict(at)
    # of each figure that of both parameters, then those without one; of the last that without x
    own = [(fitted[0], at), (fitted[3], at), (fitted[9], at[:, 1:])]
    for k, (process, points) in enumerate(own):
        expected = process.predict(points, return_std=True)
        assert mean[:, k] == pytest.approx(expected[0], abs=1e-6)
        assert deviation[:, k] == pytest.approx(expected[1] * emulator.widening[k], rel=1e-3)
        # the noise is in the deviation once: no prediction is surer than the scatter allows
        assert (deviation[:, k] > 0.5 * 0.05).all()


def test_figures_err_as_much_as_they_are_said_to() -> None:
    """Those of 24 noisy traces: few samples before the impact, so that the offset errs most.

    Standard deviations of 24 values have an error of 14 %, so that four of them are 0.57.
    """
    scene = load_scene(pulses.SCENE)
    off = []
    for seed in range(24):
        time, clean = pulses.measured(scene, 0.0)
        late = time > -0.01
        _, values = pulses.measured(scene, 0.05, seed)
        trace = Measured(time[late], values[late] + 3.0)
        found = reading_of(trace, 180, 0.05, seed=seed, length=0.05)
        true = found.reader.figures(found.reader.series(time, clean))
        off.append((found.figures - true) / np.sqrt(np.diag(found.covariance)))
    assert np.std(off, axis=0) == pytest.approx(np.ones(len(off[0])), abs=0.57)


def test_an_array_of_zeros_has_no_peak() -> None:
    time = np.arange(0.0, 0.05, 1e-4)
    with pytest.raises(UserError, match="no peak"):
        reading_of(Measured(time, np.zeros_like(time)), 180)


def test_a_run_is_read_as_a_recorder_reads_it() -> None:
    """Means over the intervals of a pulse that is highest at its begin, as a flat impactor's is.

    A recorder at ten times the rate sees the same pulse, and the velocity change is that of it.
    """
    reader = Reader(180, 0.1, 0.03)
    length, height, step = 0.02, 1000.0, 2e-4
    change = height * length * 2.0 / np.pi

    def speed(time: Array) -> Array:
        return change * np.sin(0.5 * np.pi * np.clip(time / length, 0.0, 1.0))

    rows = np.arange(0.0, 0.04, step)
    means = np.concatenate([[np.nan], np.diff(speed(rows)) / step])
    edges = np.arange(-0.02, 0.04, 0.1 * step)
    samples, middles = np.diff(speed(edges)) / (0.1 * step), 0.5 * (edges[1:] + edges[:-1])
    run, recorded = reader.series(rows, means, means=True), reader.series(middles, samples)
    assert reader.figures(run) == pytest.approx(reader.figures(recorded), abs=1e-3 * height)
    assert reader.checks(run)["velocity change [m/s]"] == pytest.approx(change, rel=1e-3)


def test_what_has_no_influence_counts_by_chance_only() -> None:
    """Six figures of one parameter and scatter, and two parameters that do nothing."""
    unit, counted = unit_points("sobol", 3, 48, 0), 0
    for seed in range(20):
        random = np.random.default_rng(seed)
        figures = unit[:, :1] + 0.3 * random.normal(size=(48, 6))
        emulator = emulator_of(unit, figures)
        for number in (1, 2):
            ends = np.full((2, 3), 0.5)
            ends[:, number] = 0.0, 1.0
            mean, _ = emulator.predict(ends)
            counted += not np.array_equal(mean[0], mean[1])
        ends = np.array([[0.0, 0.5, 0.5], [1.0, 0.5, 0.5]])
        mean, _ = emulator.predict(ends)
        assert (mean[1] - mean[0] > 0.25).all()  # 1, five deviations of a fitted slope less
    # one in twenty: of 40, six or more have a probability of 1 %
    assert counted <= 5


def test_failed_runs_are_outside() -> None:
    unit = unit_points("sobol", 2, 64, 0)
    figures = unit.sum(axis=1, keepdims=True)
    figures[unit[:, 0] > 0.7] = np.nan
    success = emulator_of(unit, figures).success(np.array([[0.2, 0.5], [0.95, 0.5]]))
    assert success[0] > 0.9
    assert success[1] < 0.2


@pytest.mark.parametrize(
    ("covariance", "verdicts"),
    [
        ([[1e-4, 0.0], [0.0, 10.0]], ["determined", "not determined"]),
        ([[0.03, -0.0298], [-0.0298, 0.03]], ["only together with b", "only together with a"]),
    ],
)
def test_what_the_data_do_not_determine_is_flagged(
    covariance: list[list[float]], verdicts: list[str]
) -> None:
    """A parameter without influence, and two of which only the sum is known."""
    drawn = np.random.default_rng(0).multivariate_normal([0.5, 0.5], covariance, 200_000)
    inside = drawn[((drawn > 0) & (drawn < 1)).all(axis=1)]
    space = Space((Range("a", 0.0, 1.0), Range("b", 1.0, 3.0)))
    found = parameters_of(space, Posterior(inside, np.zeros(len(inside)), 1e3, 0.3))
    assert [each.verdict for each in found] == verdicts
