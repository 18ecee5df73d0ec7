"""How a test ended, in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def statement(
    figures: Mapping[str, Any], why_no_plateau: str | None = None, cushion: str | None = None
) -> str | None:
    """What the measures of a run come to, as a sentence; None if the impactor never touched.

    Args:
        figures: of `analysis.measures.summary`.
        why_no_plateau: a reason, if a deceleration that came to rest has none.
        cushion: what the block is as a cushion, where it is one.
    """
    if figures["peak_stress_Pa"] is not None:
        return "; ".join(_of_crosshead(figures))
    if figures["max_displacement_m"] is None:
        return None
    if figures["base_peak_g"] is not None:
        return "; ".join(_of_shaken_base(figures))
    depth = f"{100 * figures['max_displacement_m']:.2f} cm"
    parts = [cushion] if cushion else []
    if figures["bottomed_out"]:
        parts.append(f"the foam bottomed out{_peak(figures)}")
    if figures["passed_through"]:
        parts.append("the impactor left the foam and was not stopped by it")
    elif figures["came_to_rest"]:
        parts.append(f"the impactor came to rest {depth} deep")
    else:
        parts.append(f"the impactor was still moving when the run ended, {depth} deep at most")
    if figures["bottomed_out"] is False:
        parts.append("the foam did not bottom out")
    if why_no_plateau:
        parts.append(f"no plateau: {why_no_plateau}")
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
        f"the base was shaken with {base:.1f} g, its velocity changed by "
        f"{figures['base_velocity_change_m_s']:.2f} m/s"
    ]
    if raw is not None and filtered is not None:
        parts.append(
            f"the impactor met {filtered:.1f} g (CFC 180; raw {raw:.1f} g), its velocity changed "
            f"by {figures['velocity_change_m_s']:.2f} m/s"
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
