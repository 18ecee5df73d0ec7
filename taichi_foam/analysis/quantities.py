"""The figures of a run as people read them: their words, units and digits, for every table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Quantity:
    """One figure of a run: its key in summary.json and how people read it.

    name    in a word or two, where room is short
    unit    for people; value in `unit` = `factor` times the value in SI units
    digits  decimals shown in that unit
    tables  that show it, in the order in which quantities stand here: "run" in the
            terminal, "page", and "cell" of a notebook
    """

    key: str
    label: str
    name: str
    unit: str = ""
    factor: float = 1.0
    digits: int = 0
    tables: str = ""

    def text(self, value: float | None) -> str:
        """The value as people read it, without its unit; a dash for no answer."""
        return "–" if value is None else f"{self.factor * value:.{self.digits}f}"

    def span(self, low: float | None, high: float | None) -> str:
        """A band as people read it; one that reaches to runs without an answer is open above."""
        if low is None:
            return "–"
        return f"{self.text(low)} to {'∞' if high is None else self.text(high)}"


# fmt: off
STRESS = Quantity("peak_stress_Pa", "largest stress", "stress", "kPa", 1e-3, 1, "run page cell")
STRESS_FORCE = Quantity("peak_stress_force_N", "its force", "force", "N", 1.0, 1, "run")
STRESS_STRAIN = Quantity(
    "peak_stress_strain", "its strain", "at strain",
    "%", 1e2, 1, "run page cell",
)
CREST = Quantity(
    "peak_deceleration_cfc180_m_s2", "peak deceleration (CFC 180)", "peak",
    "m/s²", 1.0, 1, "run page cell",
)
CREST_G = Quantity(
    "peak_deceleration_cfc180_g", "peak deceleration (CFC 180)", "peak in g",
    "g", 1.0, 1, "run page cell",
)
CREST_TIME = Quantity(
    "peak_deceleration_cfc180_time_s", "time of peak deceleration (CFC 180)", "time of the peak",
    "ms", 1e3, 2, "run page",
)
RAW_CREST = Quantity(
    "peak_deceleration_m_s2", "peak deceleration, raw", "raw peak",
    "m/s²", 1.0, 1, "run page cell",
)
RAW_CREST_G = Quantity(
    "peak_deceleration_g", "peak deceleration, raw", "raw peak in g",
    "g", 1.0, 1, "run page cell",
)
RAW_CREST_TIME = Quantity(
    "peak_deceleration_time_s", "time of peak deceleration, raw", "time of the raw peak",
    "ms", 1e3, 2,
)
STRAIN = Quantity(
    "max_strain", "largest strain of the block", "strain",
    "%", 1e2, 1, "run page cell",
)
BASE_G = Quantity("base_peak_g", "peak of the base, in g", "base", "g", 1.0, 1, "run page cell")
DISPLACEMENT = Quantity(
    "max_displacement_m", "maximum displacement", "displacement",
    "cm", 1e2, 2, "run page cell",
)
DURATION = Quantity(
    "impact_duration_s", "impact duration", "duration",
    "ms", 1e3, 1, "run page cell",
)
PLATEAU = Quantity(
    "plateau_deceleration_m_s2", "plateau deceleration", "plateau",
    "m/s²", 1.0, 1, "run page cell",
)
ENERGY_PER_VOLUME = Quantity(
    "energy_per_volume_J_m3", "energy per volume", "energy/volume",
    "10⁵ J/m³", 1e-5, 2, "run page cell",
)
SLOPE = Quantity(
    "energy_volume_slope_J_m3", "slope of energy over volume", "slope",
    "10⁵ J/m³", 1e-5, 2, "run cell",
)
PEAK = Quantity(
    "initial_peak_m_s2", "initial peak", "initial peak",
    "m/s²", 1.0, 0, "run page cell",
)
PEAK_TIME = Quantity(
    "initial_peak_time_s", "time of the initial peak", "peak time",
    "ms", 1e3, 1, "run cell",
)
RESULTANT_G = Quantity(
    "peak_resultant_g", "peak of the resultant, raw", "resultant",
    "g", 1.0, 1, "run page",
)
ANGLE = Quantity(
    "final_angle_rad", "turned at the end by", "angle",
    "°", 57.29577951308232, 1, "run page",
)
SPIN = Quantity("final_spin_rad_s", "spin at the end", "spin", "rad/s", 1.0, 2, "run page")
SIDEWAYS = Quantity(
    "final_velocity_x_m_s", "sideways velocity at the end", "sideways",
    "m/s", 1.0, 2, "run page",
)
ENERGY_ABSORBED = Quantity(
    "energy_absorbed_J", "energy absorbed", "energy absorbed",
    "J", 1.0, 2, "run page",
)
VOLUME = Quantity("crushed_volume_m3", "volume crushed", "volume crushed", "cm³", 1e6, 1, "run")
REBOUND = Quantity("rebound_velocity_m_s", "rebound velocity", "rebound", "m/s", 1.0, 2, "run page")
CHANGE = Quantity(
    "velocity_change_m_s", "velocity change", "velocity change",
    "m/s", 1.0, 2, "run page",
)
BASE_CHANGE = Quantity(
    "base_velocity_change_m_s", "velocity change of the base", "base's change",
    "m/s", 1.0, 2, "run page",
)
RESTITUTION = Quantity(
    "restitution", "coefficient of restitution", "restitution",
    "", 1.0, 3, "run page",
)
FALL = Quantity(
    "equivalent_drop_height_m", "equivalent drop height", "drop height",
    "cm", 1e2, 1, "run page",
)
REST = Quantity(
    "rest_height_m", "height of the block at the end", "rest height",
    "cm", 1e2, 2,
)
WIDTH = Quantity(
    "crushed_width_m", "width of the crushed region", "crushed width",
    "cm", 1e2, 1, "page",
)
HEIGHT = Quantity(
    "crushed_height_m", "height of the crushed region", "crushed height",
    "cm", 1e2, 1, "page",
)
LAYER = Quantity(
    "crushed_layer_m", "crushed layer left under the face", "layer",
    "cm", 1e2, 2, "run",
)
NO_ROOM = Quantity(
    "crushed_without_room", "overlapping crushed foam", "overlap",
    "%", 1e2, 1, "run",
)
PIECES = Quantity("pieces", "pieces", "pieces", "", 1.0, 0, "run page")
BROKEN = Quantity("broken_bonds", "broken bonds", "broken bonds", "", 1.0, 0, "run page")
CRACK = Quantity(
    "crack_lowest_height_m", "crack below impactor, down to", "crack",
    "cm", 1e2, 1, "run",
)
CRACK_START = Quantity(
    "crack_start_height_m", "height of the crack's start", "crack start",
    "cm", 1e2, 1,
)
CRACK_TIME = Quantity("crack_start_time_s", "time of the crack's start", "crack time", "ms", 1e3, 1)
RESIDUAL = Quantity(
    "energy_residual", "energy unaccounted for", "unaccounted for",
    "%", 1e2, 4, "run page",
)
# fmt: on

QUANTITIES: Mapping[str, Quantity] = {
    each.key: each for each in tuple(globals().values()) if isinstance(each, Quantity)
}
"""All of them by key."""


def shown_in(table: str) -> tuple[Quantity, ...]:
    """What a table shows, see `Quantity.tables`."""
    return tuple(each for each in QUANTITIES.values() if table in each.tables.split())
