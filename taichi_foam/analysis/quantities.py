"""The figures of a run as people read them: their words, units and digits, for every table."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Quantity:
    """One figure of a run: its key in summary.json and how people read it.

    name    in a word or two, where room is short
    unit    for people; value in `unit` = `factor` times the value in SI units
    digits  decimals shown in that unit
    """

    key: str
    label: str
    name: str
    unit: str = ""
    factor: float = 1.0
    digits: int = 0

    def text(self, value: float | None) -> str:
        """The value as people read it, without its unit; a dash for no answer."""
        return "–" if value is None else f"{self.factor * value:.{self.digits}f}"

    def span(self, low: float | None, high: float | None) -> str:
        """A band as people read it; one that reaches to runs without an answer is open above."""
        if low is None:
            return "–"
        return f"{self.text(low)} to {'∞' if high is None else self.text(high)}"


CREST = Quantity(
    "peak_deceleration_cfc180_m_s2", "peak deceleration (CFC 180)", "peak", "m/s²", 1.0, 1
)
CREST_G = Quantity("peak_deceleration_cfc180_g", "the same in g", "peak in g", "g", 1.0, 1)
CREST_TIME = Quantity(
    "peak_deceleration_cfc180_time_s", "its time after contact", "time of the peak", "ms", 1e3, 2
)
RAW_CREST = Quantity("peak_deceleration_m_s2", "peak deceleration, raw", "raw peak", "m/s²", 1.0, 1)
RAW_CREST_G = Quantity("peak_deceleration_g", "the raw one in g", "raw peak in g", "g", 1.0, 1)
RAW_CREST_TIME = Quantity(
    "peak_deceleration_time_s", "its time after contact, raw", "time of the raw peak", "ms", 1e3, 2
)
RESULTANT_G = Quantity(
    "peak_resultant_g", "peak of the resultant, raw, in g", "resultant", "g", 1.0, 1
)
ANGLE = Quantity("final_angle_rad", "turned at the end by", "angle", "°", 57.29577951308232, 1)
SPIN = Quantity("final_spin_rad_s", "spin at the end", "spin", "rad/s", 1.0, 2)
SIDEWAYS = Quantity(
    "final_velocity_x_m_s", "sideways velocity at the end", "sideways", "m/s", 1.0, 2
)
DURATION = Quantity("impact_duration_s", "impact duration", "duration", "ms", 1e3, 1)
DISPLACEMENT = Quantity("max_displacement_m", "maximum displacement", "displacement", "cm", 1e2, 2)
PLATEAU = Quantity("plateau_deceleration_m_s2", "plateau deceleration", "plateau", "m/s²", 1.0, 1)
ENERGY_PER_VOLUME = Quantity(
    "energy_per_volume_J_m3", "energy per volume", "energy/volume", "10⁵ J/m³", 1e-5, 2
)
SLOPE = Quantity(
    "energy_volume_slope_J_m3", "slope of energy over volume", "slope", "10⁵ J/m³", 1e-5, 2
)
PEAK = Quantity("initial_peak_m_s2", "initial peak", "initial peak", "m/s²")
PEAK_TIME = Quantity("initial_peak_time_s", "time of the initial peak", "peak time", "ms", 1e3, 1)
ENERGY_ABSORBED = Quantity("energy_absorbed_J", "energy absorbed", "energy absorbed", "J", 1.0, 2)
VOLUME = Quantity("crushed_volume_m3", "volume crushed", "volume crushed", "cm³", 1e6, 1)
REBOUND = Quantity("rebound_velocity_m_s", "rebound velocity", "rebound", "m/s", 1.0, 2)
CHANGE = Quantity("velocity_change_m_s", "velocity change", "velocity change", "m/s", 1.0, 2)
RESTITUTION = Quantity("restitution", "coefficient of restitution", "restitution", "", 1.0, 3)
FALL = Quantity("equivalent_drop_height_m", "equivalent drop height", "drop height", "cm", 1e2, 1)
STRAIN = Quantity("max_strain", "largest strain of the block", "strain", "%", 1e2, 1)
REST = Quantity("rest_height_m", "height of the block at the end", "rest height", "cm", 1e2, 2)
WIDTH = Quantity("crushed_width_m", "width of the crushed region", "crushed width", "cm", 1e2, 1)
HEIGHT = Quantity(
    "crushed_height_m", "height of the crushed region", "crushed height", "cm", 1e2, 1
)
LAYER = Quantity("crushed_layer_m", "crushed layer left under the face", "layer", "cm", 1e2, 2)
NO_ROOM = Quantity("crushed_without_room", "overlapping crushed foam", "overlap", "%", 1e2, 1)
PIECES = Quantity("pieces", "pieces", "pieces")
BROKEN = Quantity("broken_bonds", "broken bonds", "broken bonds")
CRACK = Quantity("crack_lowest_height_m", "crack below impactor, down to", "crack", "cm", 1e2, 1)
CRACK_START = Quantity(
    "crack_start_height_m", "start of that crack, height", "crack start", "cm", 1e2, 1
)
CRACK_TIME = Quantity("crack_start_time_s", "start of that crack, time", "crack time", "ms", 1e3, 1)
RESIDUAL = Quantity("energy_residual", "energy unaccounted for", "unaccounted for", "%", 1e2, 4)
