"""What a peak does not show of a pad: creep, buckling, temperature. Each with its limit and source.

D. Negussey, M. Jahanandish: Comparison of some engineering properties of expanded polystyrene with
    those of soils. Transp. Res. Rec. 1418 (1993)
ETHAFOAM package design guide (Dow; Sealed Air), step four: recognizing design constraints
ASTM C578, rigid cellular polystyrene thermal insulation: for temperatures of -54 to 74 C
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from taichi_foam.cushions.shown import Units
from taichi_foam.cushions.sizing import CREEP, SLENDER, Pad

TESTED_AT = 23.0
"""Temperature at which foams are tested, if nothing else is said [C] (ISO 291)."""

NEAR = 10.0
"""Difference from it within which the curve is taken to hold [C]; assumed."""

_SERVICE = (
    (re.compile(r"eps\b|polystyrene", re.IGNORECASE), (-54.0, 74.0), "ASTM C578"),
    (
        re.compile(r"ldpe|\bld\d|polyethylene|\bpe\b|epe", re.IGNORECASE),
        (-40.0, 49.0),
        "above 120 F lower loads: ETHAFOAM package design guide; the lower end is assumed",
    ),
)


@dataclass(frozen=True)
class Check:
    """A check of a pad.

    name    what is checked
    found   the pad's own value, and the limit, in words
    holds   whether it holds; None: nothing known says so
    source  where the limit is from
    """

    name: str
    found: str
    holds: bool | None
    source: str


def checks(pad: Pad, units: Units) -> list[Check]:
    """The checks of a pad."""
    return [_creep(pad, units), _buckling(pad, units), _temperature(pad)]


def _creep(pad: Pad, units: Units) -> Check:
    limit = CREEP * pad.foam.plateau
    return Check(
        "creep",
        f"static stress {units.text('stress', pad.static_stress)}, limit "
        f"{units.text('stress', limit)}: {CREEP:g} of the plateau's stress",
        pad.static_stress <= limit,
        "assumed for all foams; EPS under 26 % of its stress at 5 % of strain crept by 0.3 % in "
        "eight weeks, under 44 % by 1.6 % (Negussey & Jahanandish 1993)",
    )


def _buckling(pad: Pad, units: Units) -> Check:
    side, least = pad.area**0.5, SLENDER * pad.thickness
    if pad.wish.braced:
        return Check("buckling", "the pad is held at its sides", None, "as said with the wish")
    return Check(
        "buckling",
        f"side of a square pad {units.text('length', side)}, limit {units.text('length', least)}: "
        f"{SLENDER:g} times the thickness; of several pads each its own side",
        side >= 0.995 * least,  # the area is rounded to three digits
        "ETHAFOAM package design guide, step four",
    )


def _temperature(pad: Pad) -> Check:
    temperature = pad.wish.temperature
    found = f"the curve is of about {TESTED_AT:g} C"
    source = "curve: assumed to hold within 10 C of its test at 23 C"
    name = f"{pad.foam.name} {pad.foam.title}"
    known = next((each for each in _SERVICE if each[0].search(name)), None)
    if known is not None:
        found += f", service {known[1][0]:g} to {known[1][1]:g} C"
        source += f"; service: {known[2]}"
    if temperature is None:
        return Check("temperature", f"not given; {found}", None, source)
    found = f"{temperature:g} C; {found}"
    holds: bool | None = abs(temperature - TESTED_AT) <= NEAR or None
    if known is not None and not known[1][0] <= temperature <= known[1][1]:
        holds = False
    if holds is None:
        found += "; beyond the curve's: test the foam there, `taichi-foam foam import`"
    return Check("temperature", found, holds, source)
