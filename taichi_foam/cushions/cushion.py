"""Cushion curves: peak deceleration over static stress, computed, beside the energy balance.

    import taichi_foam as tf
    found = tf.cushion_curve("scenes/own_foam.csv", thickness=[0.03, 0.05], drop_height=0.76)
    found.report("own.html")

A curve belongs to a shape, a thickness, a height of fall and a number of the drop on the same pad.
It starts with a few static stresses; more are added where straight lines between its points, in the
logarithms of both axes, would miss it. The drops are sweeps, wave after wave: what a killed or
interrupted command has computed is used by the same command.
"""

from __future__ import annotations

import hashlib
import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_foam.analysis.bands import band
from taichi_foam.cushions import own_tests
from taichi_foam.cushions.own_tests import OwnTests
from taichi_foam.cushions.refine import next_points
from taichi_foam.cushions.scenes import (
    FLAT,
    SIDE,
    called,
    cushion_scene,
    stress_curve,
)
from taichi_foam.cushions.shown import Units, units_named
from taichi_foam.cushions.sizing import passed
from taichi_foam.errors import UserError
from taichi_foam.formulas import energy
from taichi_foam.formulas.traces import channel, check_channel_class, filtered
from taichi_foam.interrupts import held_interrupts
from taichi_foam.picture import style
from taichi_foam.results.files import file_name, plain, write_rows
from taichi_foam.results.folders import claimed
from taichi_foam.scene import Scene
from taichi_foam.scene.paths import NOTHING, at
from taichi_foam.simulation.progress import Bars
from taichi_foam.sweeps import table as columns
from taichi_foam.sweeps.run import sweep
from taichi_foam.units import STANDARD_GRAVITY, rounded

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from taichi_foam.sweeps.store import Sweep

Array = NDArray[np.float64]

MOST_DROPS, MOST_RUNS, MOST_POINTS = 5, 100, 100
MOST_CURVES = 60

_LIMITS = {"thickness": (1e-3, 1.0), "drop_height": (1e-3, 20.0)}
"""Limits [m]: beyond them a unit is probably mistaken."""

_ENDLESS = 1e6
"""A peak [g] in place of none, where lines between points need a number."""

_LIGHT = 1.0
"""A static stress [Pa] that any foam carries, for scenes that are not computed."""

POINTS = 16
"""Usual number of static stresses of a curve."""

FIRST, LATER = 7, 3
"""Static stresses of a curve in the first wave, and in each later one."""

TOLERANCE = 0.01
"""Part of the peak by which lines between points may miss the curve."""

REFINED = 2.0
"""A curve is refined up to its least peak times this."""

WITHIN = 0.1
"""The range around the minimum is where the peak is larger by at most this part."""

_PEAKS = {None: "peak_deceleration_g", 180: "peak_deceleration_cfc180_g"}
"""Measures that are peaks, by the channel class of their filter."""

# Keys of a scene in which the points of one shape may differ.
_KEYS = (
    "block.width", "block.height", "block.outline", "block.cell", "block.columns", "block.rows",
    "impactor.width", "impactor.height", "impactor.x", "impactor.mass", "impactor.drop_height",
)  # fmt: skip


@dataclass(frozen=True)
class Pad:
    """What a curve is of, apart from the number of the drop.

    shape        "flat", "edge", "rib", or the name of an outline
    thickness    m
    drop_height  m
    """

    shape: str
    thickness: float
    drop_height: float

    @property
    def row(self) -> dict[str, Any]:
        """Its columns of tables."""
        return {
            "shape": self.shape,
            "thickness_m": self.thickness,
            "drop_height_m": self.drop_height,
        }


@dataclass(frozen=True)
class Balance:
    """The energy balance of a flat pad's first drop.

    strain, stress  (n,) of its foam, Pa
    ends            the range of static stresses that is of interest [Pa]
    """

    pad: Pad
    strain: Array
    stress: Array
    ends: tuple[float, float]

    def g(self, static_stress: ArrayLike) -> Array:
        """Peaks (n,) [g] at static stresses [Pa]; NaN where the foam cannot absorb the energy."""
        height, thickness = self.pad.drop_height, self.pad.thickness
        return energy.cushion_curve(self.strain, self.stress, height, thickness, static_stress)

    @property
    def fine(self) -> Array:
        """Static stresses (n,) [Pa] at which it is drawn."""
        return np.geomspace(*self.ends, 400)

    @cached_property
    def least(self) -> tuple[float, float]:
        """Static stress [Pa] and peak [g] of its optimum."""
        height, thickness = self.pad.drop_height, self.pad.thickness
        static, stop = energy.optimum(self.strain, self.stress, height, thickness)
        return static, stop.g


@dataclass(frozen=True)
class Drop:
    """The figures of one computed drop.

    static_stress  Pa, of the product
    number         of the drop on the pad, from 1
    velocity       of the impact [m/s]
    peak           deceleration through the chart's filter [g]; None: no answer
    strain         the largest of the pad; None: no answer
    bottomed       whether the foam was used up; None: no answer
    failure        why there is no answer, or what makes it doubtful
    """

    pad: Pad
    static_stress: float
    number: int
    run: int
    velocity: float
    peak: float | None
    strain: float | None
    bottomed: bool | None
    failure: str | None


@dataclass(frozen=True)
class Curve:
    """Peaks over static stress of one pad, in the drop of one number.

    Arrays are (n,), at rising static stresses.

    static_stress      Pa
    low, median, high  peak [g]: 5, 50 and 95 % of the runs; inf where they have no answer
    strain             median of the largest strain; inf: no answer
    bottomed           the part of the runs in which the foam was used up
    balance            of the energy; None: it does not apply
    """

    pad: Pad
    number: int
    static_stress: Array
    low: Array
    median: Array
    high: Array
    strain: Array
    bottomed: Array
    balance: Balance | None

    @property
    def least(self) -> int:
        """Index of the point of the least median."""
        return int(np.argmin(self.median))

    @property
    def is_bracketed(self) -> bool:
        """Whether the minimum is between points, and not at an end of the range."""
        return 0 < self.least < len(self.median) - 1

    @cached_property
    def good_range(self) -> tuple[float, float]:
        """Static stresses [Pa] around the minimum in which the peak is larger by 10 % at most.

        Lines between points in logarithms; the range ends where the points do.
        """
        x, y = np.log(self.static_stress), np.log(np.minimum(self.median, _ENDLESS))
        limit = y[self.least] + math.log(1.0 + WITHIN)

        def end(way: int) -> float:
            inside, beyond, share = passed(y, self.least, way, limit)
            if share == 0.0:
                return float(self.static_stress[inside])
            return float(np.exp(x[inside] + share * (x[beyond] - x[inside])))

        return end(-1), end(1)

    @property
    def bottoms_from(self) -> float | None:
        """The static stress [Pa] from which half of the runs use the foam up; None: nowhere."""
        below = np.flatnonzero(self.bottomed < 0.5)
        first = int(below[-1]) + 1 if below.size else 0
        return float(self.static_stress[first]) if first < self.bottomed.size else None


@dataclass(frozen=True)
class CushionCurve:
    """Cushion curves of a foam.

    foam     what foam it is
    filter   the filter of all peaks, "raw" or "CFC 180"
    runs     drops that a point is the median of
    drops    all computed drops
    scene    that of the first drop: foam, and what is assumed of it
    tests    own cushion tests, to compare; None: none
    folder   where the drops and all files are; None: nothing was written
    """

    foam: str
    filter: str
    runs: int
    drops: tuple[Drop, ...] = field(repr=False)
    scene: Scene = field(repr=False)
    tests: OwnTests | None = field(default=None, repr=False)
    folder: Path | None = None

    def tests_of(self, curve: Curve) -> NDArray[np.bool_] | None:
        """Which own tests (n,) are of a curve, the first drop on a flat pad; None: none is."""
        pad = curve.pad
        if self.tests is None or curve.number > 1 or pad.shape != FLAT:
            return None
        alike = self.tests.alike(pad.drop_height, pad.thickness)
        return alike if alike.any() else None

    @cached_property
    def curves(self) -> list[Curve]:
        """A curve for each pad and number of the drop."""
        groups: dict[tuple[Pad, int], dict[float, list[Drop]]] = {}
        for drop in self.drops:
            points = groups.setdefault((drop.pad, drop.number), {})
            points.setdefault(drop.static_stress, []).append(drop)
        return [self._curve(pad, number, points) for (pad, number), points in groups.items()]

    def _curve(self, pad: Pad, number: int, points: Mapping[float, list[Drop]]) -> Curve:
        rising = sorted(points)
        runs = [points[each] for each in rising]
        peaks = [band([drop.peak for drop in each]) for each in runs]
        low, median, high = np.array(peaks, dtype=np.float64).T
        balance = None
        if number == 1 and pad.shape == FLAT:
            balance = Balance(pad, *stress_curve(self.scene), (rising[0], rising[-1]))
        return Curve(
            pad,
            number,
            np.array(rising),
            low,
            median,
            high,
            np.array([band([drop.strain for drop in each]).median for each in runs]),
            np.mean([[drop.bottomed is not False for drop in each] for each in runs], axis=1),
            balance,
        )

    @property
    def table(self) -> list[dict[str, Any]]:
        """A row for each point of each curve: SI units, unit in the name, None for no answer."""
        found = []
        for curve in self.curves:
            by_hand = curve.balance and curve.balance.g(curve.static_stress)
            found += [
                {
                    **curve.pad.row,
                    "drop": curve.number,
                    "static_stress_Pa": static,
                    "runs": self.runs,
                    "filter": self.filter,
                    "peak_g": curve.median[k],
                    "peak_low_g": curve.low[k],
                    "peak_high_g": curve.high[k],
                    "strain": curve.strain[k],
                    "bottomed_share": curve.bottomed[k],
                    "balance_g": None if by_hand is None else by_hand[k],
                }
                for k, static in enumerate(curve.static_stress)
            ]
        return plain(found)

    @property
    def minima(self) -> list[dict[str, Any]]:
        """A row for each curve: its minimum, the range within 10 % of it, where it bottoms."""
        return plain(
            [
                {
                    **curve.pad.row,
                    "drop": curve.number,
                    "least_peak_g": curve.median[curve.least],
                    "at_static_stress_Pa": curve.static_stress[curve.least],
                    "is_bracketed": curve.is_bracketed,
                    "within_10_percent_from_Pa": curve.good_range[0],
                    "within_10_percent_to_Pa": curve.good_range[1],
                    "bottoms_from_Pa": curve.bottoms_from,
                    "balance_least_peak_g": curve.balance and curve.balance.least[1],
                    "balance_at_static_stress_Pa": curve.balance and curve.balance.least[0],
                }
                for curve in self.curves
            ]
        )

    @property
    def conditions(self) -> list[str]:
        """What the drops have in common, a sentence each."""
        shapes = {drop.pad.shape for drop in self.drops}
        count = max(drop.number for drop in self.drops)
        found = [
            "A rigid product falls straight down on rails and meets the pad with a level face; "
            "nothing but the pad carries it. G is its deceleration; force over weight is G + 1.",
            "Peaks are raw: means over 0.1 ms, through no filter."
            if self.filter == channel(None)
            else f"Peaks are through the filter {self.filter} (SAE J211).",
        ]
        if self.runs > 1:
            found.append(
                f"Each point is the median of {self.runs} runs with velocities of impact within "
                "0.5 %; the band is from 5 to 95 % of them. It holds what the drop itself scatters "
                "by, not the scatter of the foam."
            )
        if count > 1:
            found.append(
                f"Drops 1 to {count} are on the same pad, each from the full height above the foam "
                "as the drop before has left it."
            )
        if FLAT in shapes:
            found.append(
                "Flat pads are crushed evenly, and are computed as a strip of their width. The "
                "energy balance leaves out waves, the mass of the foam and its dashpots; it is for "
                "the first drop."
            )
        if shapes != {FLAT}:
            found.append(
                "Other pads are computed in the plane, with cracks. Their static stress is the "
                "weight over the area that the product rests on; the energy balance, which is for "
                "even crushing, does not apply to them."
            )
        found.append("Bottoming is shaded: there half of the runs or more use the foam up.")
        if self.tests is not None:
            drawn = [each for each in map(self.tests_of, self.curves) if each is not None]
            count = int(np.any(drawn, axis=0).sum()) if drawn else 0
            found.append(
                f"Diamonds are the tests in {self.tests.name}, through their own filter: {count} "
                f"of {len(self.tests.g)} have the drop height and the thickness of a flat pad here."
            )
        return found

    def plot(self, units: str = "si") -> Figure:
        """The chart. Raises UserError: `units` is not "si" or "us"."""
        from taichi_foam.cushions.cushion_chart import chart

        return chart(self, units_named(units))

    def report(self, path: str | Path, units: str = "si") -> Path:
        """Write a report as one HTML file, and return its path. Raises UserError."""
        from taichi_foam.cushions.cushion_chart import report

        return report(self, path, units_named(units))


def cushion_curve(
    foam: Any,
    thickness: float | Sequence[float],
    drop_height: float | Sequence[float],
    static_stress: float | Sequence[float] | None = None,
    *,
    static_range: tuple[float, float] | None = None,
    drops: int = 1,
    shape: Any = FLAT,
    runs: int = 1,
    channel_class: int | None = None,
    points: int = POINTS,
    width: float = SIDE,
    depth: float = SIDE,
    density: float | None = None,
    tests: str | Path | None = None,
    out: str | Path | None = None,
    overwrite: bool = False,
    units: str = "si",
    arch: str | None = None,
    threads: int | None = None,
    bars: Bars | None = None,
) -> CushionCurve:
    """Compute cushion curves: one for each shape, thickness, height of fall and number of the drop.

    Args:
        foam: as for `cushion_scene`: a name in the foam library, a foam file, a test (.csv), ...
        thickness, drop_height: m; one or several.
        static_stress: Pa; the curves have points there, and no others.
        static_range: Pa; both ends of the curves, between which points are chosen. Without it and
            without `static_stress`, the range follows from the energy balance: from a sixth of its
            optimum, or less for shapes and later drops, to three times its least peak.
        drops: number of drops on each pad, 1 to 5, one after the other.
        shape: as for `cushion_scene`, or several names and files.
        runs: number of runs of each point, 1 to 100, with velocities within 0.5 %.
        channel_class: filter of the peaks, CFC 60, 180, 600 or 1000 (SAE J211); None: raw.
        points: most static stresses of a curve, if they are chosen.
        width, depth, density: as for `cushion_scene`.
        tests: CSV file of own cushion tests, to draw and compare.
        out: folder for tables, figure and report; what is computed survives there if the process
            is killed, and the same call goes on. None: nothing is kept.
        overwrite: replace a folder that has content.
        units: "si" or "us", of the figure and the report in that folder.
        arch, threads: device and number of threads, as for `init`.
        bars: progress display; None: none.

    Raises:
        UserError: the request cannot be met; nothing was computed or written.
        RunError: drops could not be computed.
        KeyboardInterrupt: Ctrl-C; what is computed is kept in `out`.
    """
    shapes = _shapes(shape)
    lengths = _numbers("thickness", thickness), _numbers("drop_height", drop_height)
    asked = _Asked(
        foam, shapes, [Pad(*each) for each in product(shapes, *lengths)],
        static_stress, static_range, drops, runs, channel_class, points,
        {"width": width, "depth": depth, "density": density},
        None if tests is None else own_tests.read(Path(tests)),
    )  # fmt: skip
    asked.check()
    system = units_named(units)
    how = {"arch": arch, "threads": threads, "bars": bars or Bars()}
    if out is None:
        with tempfile.TemporaryDirectory() as folder:
            return _found(asked, Path(folder), how, None)
    with claimed(out, {**asked.request, "units": units}, overwrite) as claim:
        try:
            found = _found(asked, claim.work / "points", how, claim.folder)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(
                f"what is computed is in {out}; the same command continues from there"
            ) from None
        with held_interrupts(), claim.publishing() as staging:
            _write(found, staging, system)
        claim.finish()
    return found


def _write(found: CushionCurve, folder: Path, system: Units) -> None:
    """Write tables, the figure in three formats, and the report. Raises UserError, OSError."""
    from taichi_foam.cushions import cushion_chart

    write_rows(folder / "cushion.csv", found.table)
    write_rows(folder / "minima.csv", found.minima)
    drops = [
        {
            **drop.pad.row,
            "drop": drop.number,
            "static_stress_Pa": drop.static_stress,
            "run": drop.run,
            "velocity_m_s": drop.velocity,
            "peak_g": drop.peak,
            "strain": drop.strain,
            "bottomed": drop.bottomed,
            "failure": drop.failure,
        }
        for drop in found.drops
    ]
    write_rows(folder / "drops.csv", drops)
    drawn = cushion_chart.chart(found, system)
    style.save_all(drawn, folder / "cushion")
    cushion_chart.report(found, folder / "report.html", system, drawn)


@dataclass(frozen=True)
class _Asked:
    """A request: the pads, and how each is computed. `tests` are own ones; the rest is as given."""

    foam: Any
    shapes: Mapping[str, Any]
    pads: Sequence[Pad]
    static_stress: Any
    static_range: Any
    drops: Any
    runs: Any
    channel_class: Any
    points: Any
    sizes: Mapping[str, Any]
    tests: OwnTests | None

    def check(self) -> None:
        """Raises UserError: it cannot be met."""
        _check_count("drops", self.drops, 1, MOST_DROPS)
        _check_count("runs", self.runs, 1, MOST_RUNS)
        _check_count("points", self.points, 3, MOST_POINTS)
        if self.channel_class is not None:
            check_channel_class(self.channel_class)
        curves = len(self.pads) * self.drops
        if curves > MOST_CURVES:
            raise UserError(
                f"{curves} curves: at most {MOST_CURVES} in one chart; leave out some "
                "thicknesses, heights, shapes or drops"
            )
        if self.static_stress is not None and self.static_range is not None:
            raise UserError("static_stress, static_range: give one of them")
        for pad, statics in self.first.items():
            plateau = self.scene(pad, _LIGHT).foam.landmarks.plateau_stress
            if statics[-1] > plateau:
                raise UserError(
                    f"static_stress = {statics[-1]:g} Pa: above the foam's plateau of "
                    f"{plateau:.4g} Pa: the product would crush a pad that it only stands on. Fix: "
                    "lower static stresses; 4 kPa is 4000 Pa"
                )
            self.scene(pad, statics[-1])  # what else is wrong is told by its scene

    @cached_property
    def first(self) -> dict[Pad, list[float]]:
        """The static stresses [Pa] of the first wave. Raises UserError."""
        if self.static_stress is not None:
            given = sorted(_numbers("static_stress", self.static_stress))
            return dict.fromkeys(self.pads, given)
        ends = None if self.static_range is None else _range(self.static_range)
        count = min(FIRST, self.points)
        return {
            pad: [
                rounded(each, 4) for each in np.geomspace(*(ends or self._usual_range(pad)), count)
            ]
            for pad in self.pads
        }

    def scene(self, pad: Pad, static_stress: float) -> Scene:
        """The scene of a point."""
        return cushion_scene(
            self.foam, pad.thickness, pad.drop_height, static_stress,
            shape=self.shapes[pad.shape], **self.sizes,
        )  # fmt: skip

    def _usual_range(self, pad: Pad) -> tuple[float, float]:
        """Static stresses [Pa] between which the curve of a pad is of interest.

        Ribs and later drops have their optimum at a lower static stress than a flat pad's first.
        """
        scene = cushion_scene(self.foam, pad.thickness, pad.drop_height, _LIGHT, **self.sizes)
        e, s = stress_curve(scene)
        plateau = scene.foam.landmarks.plateau_stress
        low, high = energy.usual_range(e, s, pad.drop_height, pad.thickness, plateau)
        if pad.shape != FLAT or self.drops > 1:
            low /= 2.0
        return low, high

    @property
    def peak(self) -> str | None:
        """The measure that is the peak through the filter; None: it is taken from histories."""
        return _PEAKS.get(self.channel_class)

    @property
    def measures(self) -> list[str]:
        """The measures that a chart needs of each drop."""
        return [*([self.peak] if self.peak else []), "max_strain", "bottomed_out"]

    @property
    def request(self) -> dict[str, Any]:
        """Everything that determines the result, for the claim on its folder."""
        scenes = [self.scene(pad, self.first[pad][0]) for pad in self.pads]
        text = "".join(scene.model_dump_json() for scene in scenes)
        return {
            "command": "cushion",
            "foam": called(self.foam),
            "shape": [*self.shapes],
            "thickness": sorted({pad.thickness for pad in self.pads}),
            "drop": sorted({pad.drop_height for pad in self.pads}),
            "static_stress": {
                f"{pad.shape}, {pad.thickness:g} m, {pad.drop_height:g} m": statics
                for pad, statics in self.first.items()
            },
            "is_refined": self.static_stress is None,
            "drops": self.drops,
            "runs": self.runs,
            "filter": channel(self.channel_class),
            "points": self.points,
            "tests": self.tests and self.tests.rows,
            "scenes_sha256": hashlib.sha256(text.encode()).hexdigest(),
        }


def _found(
    asked: _Asked, folder: Path, how: Mapping[str, Any], target: Path | None
) -> CushionCurve:
    """All curves, computed wave after wave; the sweeps are in `folder`."""
    wave: Mapping[Pad, list[float]] = asked.first
    drops: list[Drop] = []
    for number in range(1, MOST_POINTS):
        for shape in asked.shapes:
            points = [
                (pad, each)
                for pad in asked.pads
                if pad.shape == shape
                for each in wave.get(pad, ())
            ]
            if points:
                done = _swept(asked, points, folder / f"{file_name(shape)}-{number}", how)
                drops += _drops(asked, points, done)
        drops.sort(key=lambda d: (asked.pads.index(d.pad), d.number, d.static_stress, d.run))
        found = CushionCurve(
            called(asked.foam), channel(asked.channel_class), asked.runs, tuple(drops),
            asked.scene(asked.pads[0], asked.first[asked.pads[0]][0]), asked.tests, target,
        )  # fmt: skip
        wave = _next(asked, found) if asked.static_stress is None else {}
        if not any(wave.values()):
            break
    return found


def _next(asked: _Asked, found: CushionCurve) -> dict[Pad, list[float]]:
    """The static stresses of the next wave: where the curves of a pad bend, up to REFINED."""
    wave = {}
    for pad in asked.pads:
        curves = [curve for curve in found.curves if curve.pad == pad]
        x = np.log(curves[0].static_stress)
        medians = np.array([each.median for each in curves if np.isfinite(each.median).any()])
        if not medians.size:
            continue
        y = np.log(np.minimum(medians, _ENDLESS)).T
        low = y <= y.min(axis=0) + math.log(REFINED)
        counts = (low[1:] | low[:-1]).any(axis=1)
        most = min(LATER, asked.points - len(x))
        places = next_points(x, y, most, TOLERANCE, counts)
        wave[pad] = [rounded(math.exp(place), 4) for place in places]
    return wave


def _swept(
    asked: _Asked, points: Sequence[tuple[Pad, float]], folder: Path, how: Mapping[str, Any]
) -> Sweep:
    """The drops of points of one shape, as a sweep in a folder, continued if it is there."""
    scenes = [asked.scene(pad, static).given_data() for pad, static in points]
    values = {key: [at(scene, key) for scene in scenes] for key in _KEYS}
    axes = [
        {"key": key, "values": each}
        for key, each in values.items()
        if NOTHING not in each and (key == "impactor.mass" or each.count(each[0]) < len(each))
    ]
    kept = {} if asked.peak else {"histories": "float64"}
    plan = {
        "name": f"{points[0][0].shape} pads of {called(asked.foam)}"[:100],
        "scene": scenes[0],
        "axes": axes,
        "paired": True,
        "repeats": {"count": asked.runs},
        "drops": asked.drops,
        "keep": {"measures": asked.measures, **kept},
    }
    return sweep(plan, folder, **how)


def _drops(asked: _Asked, points: Sequence[tuple[Pad, float]], done: Sweep) -> list[Drop]:
    """The figures of all drops of a sweep."""
    filtered_peaks = {} if asked.peak else _filtered_peaks(done, asked.channel_class)
    numbers = range(1, asked.drops + 1)
    wanted = [columns.drop_column(key, number) for number in numbers for key in asked.measures]
    rows = columns.read(done.shards(), [columns.MEMBER, "varied", "failure", *wanted]).to_pylist()
    found = []
    for row in rows:
        place, run = divmod(row[columns.MEMBER], asked.runs)
        pad, static = points[place]
        velocity = row["varied"] or math.sqrt(2.0 * STANDARD_GRAVITY * pad.drop_height)
        for number in numbers:
            *peak, strain, bottomed = (
                row.get(columns.drop_column(key, number)) for key in asked.measures
            )
            g = peak[0] if peak else filtered_peaks.get((row[columns.MEMBER], number))
            found.append(
                Drop(pad, static, number, run, velocity, g, strain, bottomed, row["failure"])
            )
    return found


def _filtered_peaks(done: Sweep, channel_class: int | None) -> dict[tuple[int, int], float]:
    """Peaks [g] through a filter, of the histories of a sweep, by member and number of the drop."""
    assert channel_class is not None
    found = {}
    for member, drop, (time, values) in done.traces(["time_s", "deceleration_m_s2"]):
        smooth = filtered(time, values, channel_class, means=True)
        if np.isfinite(smooth).all():
            found[member, drop] = float(smooth.max()) / STANDARD_GRAVITY
    return found


def _shapes(shape: Any) -> dict[str, Any]:
    """Shapes by name."""
    if isinstance(shape, str | Path):
        shape = [shape]
    elif not isinstance(shape, list | tuple) or not shape or not isinstance(shape[0], str | Path):
        return {"outline": shape}
    found = {str(each): each for each in shape}
    if len(found) < len(shape):
        raise UserError(f"shape = {', '.join(map(str, shape))}: one is there twice; leave it out")
    return found


def _numbers(name: str, values: Any) -> list[float]:
    """One or several numbers above 0, each once, and within `_LIMITS`."""
    listed: list[Any] = [values] if isinstance(values, int | float | str) else list(values)
    if not listed:
        raise UserError(f"{name}: none given. Fix: give at least one in {energy.EXAMPLES[name]}")
    for each in listed:
        energy.check_above_0(**{name: each})
        low, high = _LIMITS.get(name, (0.0, math.inf))
        if not low <= each <= high:
            raise UserError(
                f"{name} = {each:g} m: must be {low:g} to {high:g} {energy.EXAMPLES[name]}"
            )
    if len(set(listed)) < len(listed):
        raise UserError(f"{name}: {max(listed, key=listed.count):g} is there twice; leave it out")
    return [float(each) for each in listed]


def _range(ends: Any) -> tuple[float, float]:
    found = _numbers("static_stress", ends)
    if len(found) != 2 or found[0] >= found[1]:
        shown = " to ".join(f"{each:g}" for each in found)
        raise UserError(
            f"static stress from {shown} Pa: a range has two ends, the lower one first. Fix: such "
            "as 2 kPa to 10 kPa"
        )
    return found[0], found[1]


def _check_count(name: str, value: Any, least: int, most: int) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
        raise UserError(f"{name} = {value!r}: must be a whole number from {least} to {most}")
