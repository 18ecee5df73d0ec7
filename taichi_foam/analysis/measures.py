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
_ALL, _G = "run page cell", STANDARD_GRAVITY
# fmt: off
measure("scene", lambda record: record.scene.name)
CREST = measure(
    "peak_deceleration_cfc180_m_s2", loads.filtered_peak_deceleration,
    "peak deceleration (CFC 180)", "peak", "m/s²", 1, _ALL, 4, "deceleration")
CREST_G = measure(
    "peak_deceleration_cfc180_g", loads.filtered_peak_deceleration,
    "peak deceleration (CFC 180)", "peak", "g", 1, _ALL, 5, "deceleration", _G)
CREST_TIME = measure(
    "peak_deceleration_cfc180_time_s", loads.filtered_peak_deceleration,
    "time of peak deceleration (CFC 180)", "time of the peak", "ms", 2, "run page", 6, "time")
RAW_CREST = measure(
    "peak_deceleration_m_s2", loads.peak_deceleration,
    "peak deceleration, raw", "raw peak", "m/s²", 1, _ALL, 7, "deceleration")
RAW_CREST_G = measure(
    "peak_deceleration_g", loads.peak_deceleration,
    "peak deceleration, raw", "raw peak", "g", 1, _ALL, 8, "deceleration", _G)
measure(
    "peak_deceleration_time_s", loads.peak_deceleration,
    "time of peak deceleration, raw", "time of the raw peak", "ms", 2, part="time")
measure("peak_resultant_m_s2", loads.peak_resultant, part="deceleration")
measure(
    "peak_resultant_g", loads.peak_resultant,
    "peak of the resultant, raw", "resultant", "g", 1, "run page", 18, "deceleration", _G)
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
    "initial peak (CFC 180)", "initial peak", "m/s²", 0, _ALL, 16, "deceleration")
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
measure("base_peak_m_s2", loads.shaking, part="base_peak")
measure(
    "base_peak_g", loads.shaking,
    "peak of the base, in g", "base", "g", 1, _ALL, 10, "base_peak", _G)
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
measure("balance_strain", balance.of_run, part="strain")
measure("balance_peak_m_s2", balance.of_run, part="peak")
measure("balance_peak_g", balance.of_run, part="peak", per=_G)
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
    scene, no_plateau = record.scene, loads.why_no_plateau(record)
    by_hand = figures.of(balance.of_run)
    raw, strain = figures["peak_deceleration_m_s2"], figures["max_strain"]
    depth = f"{100 * figures['max_displacement_m']:.2f} cm"
    parts = [balance.words(scene, by_hand, raw, strain)] if by_hand else []
    if figures["bottomed_out"]:
        parts.append(f"the foam bottomed out{_peak(figures)}")
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


def _of_crosshead(figures: Mapping[str, Any]) -> list[str]:
    stress, strain = 1e-3 * figures["peak_stress_Pa"], 100 * figures["peak_stress_strain"]
    pressed = figures["max_strain"]
    to = "" if pressed is None else f" to {100 * pressed:.1f} % strain"
    return [
        f"the crosshead pressed the foam{to}",
        f"the largest stress was {stress:.4g} kPa, at {strain:.1f} % strain",
        *_end_of_foam(figures),
    ]


def _of_shaken_base(figures: Mapping[str, Any]) -> list[str]:
    raw, filtered = figures["peak_deceleration_g"], figures["peak_deceleration_cfc180_g"]
    base, strain = figures["base_peak_g"], figures["max_strain"]
    parts = [
        f"the base was shaken with a peak of {base:.1f} g and a velocity change of "
        f"{figures['base_velocity_change_m_s']:.2f} m/s"
    ]
    if raw is not None and filtered is not None:
        parts.append(
            f"the impactor experienced {filtered:.1f} g (CFC 180; raw {raw:.1f} g) and a velocity "
            f"change of {figures['velocity_change_m_s']:.2f} m/s"
        )
    if strain is not None:
        parts.append(f"the foam was compressed by {100 * strain:.1f} % at most")
    return [*parts, *_end_of_foam(figures)]


def _end_of_foam(figures: Mapping[str, Any]) -> list[str]:
    words = {True: ["the foam bottomed out"], False: ["the foam did not bottom out"]}
    return words.get(figures["bottomed_out"], [])


def _peak(figures: Mapping[str, Any]) -> str:
    raw, filtered = figures["peak_deceleration_g"], figures["peak_deceleration_cfc180_g"]
    if raw is None or filtered is None:
        return ""
    return f": its deceleration peaked at {filtered:.0f} g (CFC 180; raw {raw:.0f} g)"


IN_WORDS: Mapping[str, Callable[[Figures, Record], Any]] = {
    "statement": _statement,
    "warnings": lambda _, record: soundness.warnings_of(record),
    "assumed": lambda _, record: assumed_of(record.scene),
}
"""What a summary has after its measures."""
