"""The figures that sum up a run: the registry of measures, and a sentence that states the outcome.

A measure is one entry here: its key in summary.json, the function that computes it and, if it is
displayed, its label and unit. summary.json, the tables of the terminal, the page, a notebook and
the report, and the columns of sweeps are built from the registry. Functions take a finished
`Record` and return SI units, or None where the measure is undefined.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from math import inf
from typing import Any

from taichi_foam.analysis import balance, fragments, impact, loads, room, soundness
from taichi_foam.analysis.pattern import crushed_region
from taichi_foam.records.ending import Ending
from taichi_foam.records.history import FILTER
from taichi_foam.records.record import Record
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Scene
from taichi_foam.scene.keys import written
from taichi_foam.scene.paths import at
from taichi_foam.units import SHOWN_UNITS, STANDARD_GRAVITY


@dataclass(frozen=True)
class Quantity:
    """One figure of a run: how it is computed and how it is displayed.

    key     key in summary.json
    of      function that returns the figure, or an object with the figure in its attribute `part`
    part    name of that attribute; empty: `of` returns the figure itself
    per     reference value that the figure is divided by [SI]
    label   label for display; empty: not displayed
    name    short label, a word or two, shown beside the unit
    unit    unit for display
    digits  decimals shown in that unit
    tables  tables that show it: "run" in the terminal, "page", and "cell" of a notebook
    row     its position in them from the top; fractions lie in between
    """

    key: str
    of: Callable[[Record], Any]
    label: str = ""
    name: str = ""
    unit: str = ""
    digits: int = 0
    tables: str = ""
    row: float = inf
    part: str = ""
    per: float | None = None

    @property
    def factor(self) -> float:
        """Conversion factor from SI units to `unit`."""
        return SHOWN_UNITS.get(self.unit, 1.0)

    def found_in(self, found: Any) -> Any:
        """The figure [SI], taken from what `of` returned; None if undefined."""
        value = found if not self.part or found is None else getattr(found, self.part)
        return value if value is None or self.per is None else value / self.per

    def text(self, value: float | None) -> str:
        """The value in `unit`, formatted without the unit; a dash if undefined."""
        return "–" if value is None else f"{self.factor * value:.{self.digits}f}"

    def words(self, value: float | None) -> str:
        """As `text`, with the unit."""
        return self.text(value) if value is None else f"{self.text(value)} {self.unit}".rstrip()

    def span(self, low: float | None, high: float | None) -> str:
        """A band, formatted; ∞ as upper end if it includes runs where the figure is undefined."""
        if low is None:
            return "–"
        return f"{self.text(low)} to {'∞' if high is None else self.text(high)}"


MEASURES: dict[str, Quantity] = {}
"""All figures by key, in the order of summary.json."""


def measure(key: str, of: Callable[[Record], Any], *words: Any, **more: Any) -> Quantity:
    """Register a measure; arguments as for `Quantity`."""
    MEASURES[key] = Quantity(key, of, *words, **more)
    return MEASURES[key]


def in_g(acceleration: Quantity, **more: Any) -> Quantity:
    """Register an acceleration in g, too, in the row below it; `more` as for `Quantity`."""
    told = {"unit": "g", "row": acceleration.row + 1, "per": STANDARD_GRAVITY, **more}
    key = acceleration.key.replace("_m_s2", "_g")
    return measure(**{**vars(acceleration), **told, "key": key})


def shown_in(table: str) -> tuple[Quantity, ...]:
    """The measures that a table shows, from the top; see `Quantity.tables`."""
    shown = [each for each in MEASURES.values() if table in each.tables.split()]
    return tuple(sorted(shown, key=lambda each: each.row))


def _of_run(key: str) -> Callable[[Record], Any]:
    """A figure about the computation itself, from `Record.run`."""
    return lambda record: record.run.get(key)


def _at_end(of: Callable[[Snapshot, Scene], Any]) -> Callable[[Record], Any]:
    """A figure of the last snapshot."""
    return lambda record: of(record.snapshots[-1], record.scene) if record.snapshots else None


def _crack(record: Record) -> fragments.Crack | None:
    return fragments.crack_over_time(record.snapshots, record.scene)


def _broken_bonds(record: Record) -> int | None:
    broken = record.history["broken_bonds"]
    return int(broken[-1]) if broken.size else None


def _final(column: str) -> Callable[[Record], float | None]:
    """The last value of a history column; None unless the impactor can rotate."""

    def of(record: Record) -> float | None:
        if not record.scene.turns or not record.history["time_s"].size:
            return None
        return float(record.history[column][-1])

    return of


def _with_impactor(of: Callable[[Record], Any]) -> Callable[[Record], Any]:
    return lambda record: None if record.scene.impactor is None else of(record)


_region = _at_end(crushed_region)
_ALL = "run page cell"
# fmt: off
measure("scene", lambda record: record.scene.name)
CREST = measure(
    "peak_deceleration_cfc180_m_s2", loads.filtered_peak_deceleration,
    f"peak deceleration ({FILTER})", "peak", "m/s²", 1, _ALL, 4, "deceleration")
CREST_G = in_g(CREST)
CREST_TIME = measure(
    "peak_deceleration_cfc180_time_s", loads.filtered_peak_deceleration,
    f"time of peak deceleration ({FILTER})", "time of the peak", "ms", 2, "run page", 6, "time")
RAW_CREST = measure(
    "peak_deceleration_m_s2", loads.peak_deceleration,
    "peak deceleration, raw", "raw peak", "m/s²", 1, _ALL, 7, "deceleration")
RAW_CREST_G = in_g(RAW_CREST)
measure(
    "peak_deceleration_time_s", loads.peak_deceleration,
    "time of peak deceleration, raw", "time of the raw peak", "ms", 2, part="time")
in_g(
    measure("peak_resultant_m_s2", loads.peak_resultant, part="deceleration"),
    label="peak of the resultant, raw", name="resultant", digits=1, tables="run page", row=18)
measure("peak_resultant_time_s", loads.peak_resultant, part="time")
measure("came_to_rest", loads.came_to_rest)
measure("bottomed_out", impact.bottomed_out)
measure("passed_through", impact.passed_through)
DURATION = measure(
    "impact_duration_s", impact.impact,
    "impact duration", "duration", "ms", 1, _ALL, 12, "duration")
DISPLACEMENT = measure(
    "max_displacement_m", loads.max_displacement,
    "maximum displacement", "displacement", "cm", 2, _ALL, 11)
PLATEAU = measure(
    "plateau_deceleration_m_s2", loads.plateau,
    "plateau deceleration", "plateau", "m/s²", 1, _ALL, 13)
PEAK = measure(
    "initial_peak_m_s2", loads.initial_peak,
    f"initial peak ({FILTER})", "initial peak", "m/s²", 0, _ALL, 16, "deceleration")
PEAK_TIME = measure(
    "initial_peak_time_s", loads.initial_peak,
    "time of the initial peak", "peak time", "ms", 1, "run cell", 17, "time")
measure(
    "energy_absorbed_J", loads.energy_absorbed,
    "energy absorbed", "energy absorbed", "J", 2, "run page", 22)
measure(
    "crushed_volume_m3", loads.crushed_volume,
    "volume crushed", "volume crushed", "cm³", 1, "run", 23)
ENERGY_PER_VOLUME = measure(
    "energy_per_volume_J_m3", loads.energy_per_volume,
    "energy per volume", "energy/volume", "10⁵ J/m³", 2, _ALL, 14)
SLOPE = measure(
    "energy_volume_slope_J_m3", loads.energy_volume_slope,
    "slope of energy over volume", "slope", "10⁵ J/m³", 2, "run cell", 15)
REBOUND = measure(
    "rebound_velocity_m_s", loads.rebound_velocity,
    "rebound velocity", "rebound", "m/s", 2, "run page", 24)
measure(
    "velocity_change_m_s", loads.velocity_change,
    "velocity change", "velocity change", "m/s", 2, "run page", 25)
RESTITUTION = measure(
    "restitution", loads.restitution,
    "coefficient of restitution", "restitution", "", 3, "run page", 27)
in_g(
    measure("base_peak_m_s2", loads.shaking, part="base_peak"),
    label="peak of the base, in g", name="base", digits=1, tables=_ALL, row=10)
measure(
    "base_velocity_change_m_s", loads.shaking,
    "velocity change of the base", "base velocity change", "m/s", 2, "run page", 26, "base_change")
measure(
    "peak_stress_Pa", loads.largest_stress,
    "largest stress", "stress", "kPa", 1, _ALL, 1, "stress")
measure(
    "peak_stress_force_N", loads.largest_stress,
    "force at the largest stress", "force", "N", 1, "run", 2, "force")
measure(
    "peak_stress_strain", loads.largest_stress,
    "strain at the largest stress", "at strain", "%", 1, _ALL, 3, "strain")
measure(
    "equivalent_drop_height_m", loads.equivalent_drop_height,
    "equivalent drop height", "drop height", "cm", 1, "run page", 28)
measure("drop", _with_impactor(lambda record: record.drop))
measure("contact_height_m", _with_impactor(lambda record: record.contact_height))
REST = measure(
    "rest_height_m", loads.rest_height, "height of the block at the end", "rest height", "cm", 2)
STRAIN = measure(
    "max_strain", loads.max_strain, "largest strain of the block", "strain", "%", 1, _ALL, 9)
measure("static_stress_Pa", balance.of_run, part="static_stress")
measure("balance_strain", balance.of_run, unit="%", digits=1, part="strain")
in_g(measure("balance_peak_m_s2", balance.of_run, part="peak"), digits=1)
measure(
    "final_angle_rad", _final("angle_rad"),
    "rotation at the end", "angle", "°", 1, "run page", 19)
measure(
    "final_spin_rad_s", _final("spin_rad_s"),
    "spin at the end", "spin", "rad/s", 2, "run page", 20)
measure(
    "final_velocity_x_m_s", _final("velocity_x_m_s"),
    "sideways velocity at the end", "sideways", "m/s", 2, "run page", 21)
WIDTH = measure(
    "crushed_width_m", _region,
    "width of the crushed region", "crushed width", "cm", 1, "page", 29, "width")
HEIGHT = measure(
    "crushed_height_m", _region,
    "height of the crushed region", "crushed height", "cm", 1, "page", 30, "height")
measure(
    "crushed_layer_m", _at_end(room.crushed_layer),
    "crushed layer left under the face", "layer", "cm", 2, "run", 31)
NO_ROOM = measure(
    "crushed_without_room", _at_end(room.without_room),
    "overlapping crushed foam", "overlap", "%", 1, "run", 32)
measure(
    "pieces", _at_end(lambda last, scene: fragments.pieces(last, scene.block)),
    "pieces", "pieces", "", 0, "run page", 33)
CRACK = measure(
    "crack_lowest_height_m", _crack,
    "crack below impactor, down to", "crack", "cm", 1, "run", 35, "lowest_height")
measure("crack_start_x_m", _crack, part="start_x")
CRACK_START = measure(
    "crack_start_height_m", _crack,
    "height of the crack's start", "crack start", "cm", 1, part="start_height")
CRACK_TIME = measure(
    "crack_start_time_s", _crack,
    "time of the crack's start", "crack time", "ms", 1, part="start_time")
BROKEN = measure(
    "broken_bonds", _broken_bonds, "broken bonds", "broken bonds", "", 0, "run page", 34)
RESIDUAL = measure(
    "energy_residual", soundness.energy_residual,
    "energy unaccounted for", "unaccounted for", "%", 4, "run page", 36)
# fmt: on
for _key in ("steps", "dt_min_s", "dt_max_s", "dt_stable_min_s", "wall_s", "node_stages_per_s"):
    measure(_key, _of_run(_key))
measure("max_overlap_cells", soundness.overlap_cells)
measure("interrupted", lambda record: record.ending is Ending.INTERRUPTED)


class Figures(Mapping[str, Any]):
    """The content of summary.json, see `summary`; each entry is worked out when it is asked for."""

    def __init__(self, record: Record) -> None:
        self._record = record
        self._found: dict[Any, Any] = {}

    def __getitem__(self, key: str) -> Any:
        if key not in IN_WORDS:
            measure = MEASURES[key]
            return measure.found_in(self.of(measure.of))
        if key not in self._found:
            self._found[key] = IN_WORDS[key](self, self._record)
        return self._found[key]

    def of(self, function: Callable[[Record], Any]) -> Any:
        """What a measure's function returns for the record; worked out once."""
        if function not in self._found:
            self._found[function] = function(self._record)
        return self._found[function]

    def words(self, key: str) -> str:
        """A measure as it is shown, with its unit."""
        return MEASURES[key].words(self[key])

    def __iter__(self) -> Iterator[str]:
        return iter((*MEASURES, *IN_WORDS))

    def __len__(self) -> int:
        return len(MEASURES) + len(IN_WORDS)


def summary(record: Record) -> dict[str, Any]:
    """The content of summary.json: one entry per measure, units in the names, None if undefined.

    Pieces and the crushed region are those of the last snapshot. `statement` says in words how the
    impact ended, `warnings` lists what makes the run's figures doubtful, and `assumed` lists the
    values of a user's foam that the program assumed.
    """
    return dict(Figures(record))


def assumed_of(scene: Scene) -> list[str]:
    """Values of a user's foam that the program assumed: key, value, and its source."""
    return [
        f"{each.key} = {written(at(scene, each.key))}: {each.why}" for each in scene.assumed or ()
    ]


def _statement(figures: Figures, record: Record) -> str | None:
    """The outcome of a run as a sentence; None if the impactor never touched the foam."""
    if figures["peak_stress_Pa"] is not None:
        return "; ".join(_of_crosshead(figures))
    if figures["max_displacement_m"] is None:
        return None
    if figures["base_peak_g"] is not None:
        return "; ".join(_of_shaken_base(figures))
    no_plateau, depth = loads.why_no_plateau(record), figures.words("max_displacement_m")
    parts = _of_balance(figures, record.scene)
    if figures["bottomed_out"]:
        peak = _peak(figures)
        told = f": its deceleration peaked at {peak}" if peak else ""
        parts.append(f"the foam bottomed out{told}")
    if figures["passed_through"]:
        parts.append("the impactor left the foam and was not stopped by it")
    elif figures["came_to_rest"]:
        parts.append(f"the impactor came to rest {depth} deep")
    else:
        parts.append(
            f"the impactor was still moving when the run ended, {depth} deep at its deepest"
        )
    if figures["bottomed_out"] is False:
        parts.append("the foam did not bottom out")
    if no_plateau:
        parts.append(f"no plateau: {no_plateau}")
    return "; ".join(parts)


def _of_balance(figures: Figures, scene: Scene) -> list[str]:
    """A cushion, its load, and its peak by energy balance beside the computed one."""
    by_hand: balance.Balance | None = figures.of(balance.of_run)
    if by_hand is None:
        return []
    block = scene.block
    size = " x ".join(f"{1e3 * each:.4g}" for each in (block.height, block.width, block.depth))
    raw, strain = figures["peak_deceleration_m_s2"], figures["max_strain"]
    stops = "by energy balance the foam cannot stop the impactor"
    if by_hand.peak is not None:
        at = f" at {figures.words('balance_strain')} strain"
        stops = f"by energy balance {figures.words('balance_peak_g')}{at}"
    at = "" if raw is None or strain is None else f" at {figures.words('max_strain')} strain"
    peak = "no peak" if raw is None else f"raw {figures.words('peak_deceleration_g')}"
    return [
        f"cushion {size} mm (height, width, depth), static stress "
        f"{1e-3 * by_hand.static_stress:.3g} kPa",
        f"{stops}, computed {peak}{at}",
    ]


def _of_crosshead(figures: Figures) -> list[str]:
    pressed = figures["max_strain"]
    to = "" if pressed is None else f" to {figures.words('max_strain')} strain"
    return [
        f"the crosshead pressed the foam{to}",
        f"the largest stress was {figures.words('peak_stress_Pa')}, at "
        f"{figures.words('peak_stress_strain')} strain",
        *_end_of_foam(figures),
    ]


def _of_shaken_base(figures: Figures) -> list[str]:
    parts = [
        f"the base was shaken with a peak of {figures.words('base_peak_g')} and a velocity change "
        f"of {figures.words('base_velocity_change_m_s')}"
    ]
    if peak := _peak(figures):
        parts.append(
            f"the impactor experienced {peak} and a velocity change of "
            f"{figures.words('velocity_change_m_s')}"
        )
    if figures["max_strain"] is not None:
        parts.append(f"the foam was compressed by {figures.words('max_strain')} at most")
    return [*parts, *_end_of_foam(figures)]


def _end_of_foam(figures: Figures) -> list[str]:
    words = {True: ["the foam bottomed out"], False: ["the foam did not bottom out"]}
    return words.get(figures["bottomed_out"], [])


def _peak(figures: Figures) -> str:
    """The largest deceleration, filtered and raw; empty if there is none."""
    raw = figures["peak_deceleration_g"]
    if raw is None or figures["peak_deceleration_cfc180_g"] is None:
        return ""
    filtered = figures.words("peak_deceleration_cfc180_g")
    return f"{filtered} ({FILTER}; raw {figures.words('peak_deceleration_g')})"


IN_WORDS: Mapping[str, Callable[[Figures, Record], Any]] = {
    "statement": _statement,
    "warnings": lambda _, record: soundness.warnings_of(record),
    "assumed": lambda _, record: assumed_of(record.scene),
}
"""What a summary has after its measures."""
