"""How an impact ended, in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def statement(
    figures: Mapping[str, Any], why_no_plateau: str | None = None, cushion: str | None = None
) -> str | None:
    """What the measures of an impact come to, as a sentence; None if the impactor never touched.

    Args:
        figures: of `analysis.measures.summary`.
        why_no_plateau: a reason, if a deceleration that came to rest has none.
        cushion: what the block is as a cushion, where it is one.
    """
    if figures["came_to_rest"] is None:
        return None
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


def _peak(figures: Mapping[str, Any]) -> str:
    raw, filtered = figures["peak_deceleration_g"], figures["peak_deceleration_cfc180_g"]
    if raw is None or filtered is None:
        return ""
    return f": its deceleration peaked at {filtered:.0f} g (CFC 180; raw {raw:.0f} g)"
