"""What handling expects of a package: drop heights by mass, and thicknesses that are in stock.

ISTA: Procedure 1A, Packaged-Products 150 lb (68 kg) or Less. International Safe Transit
    Association. Ten drops: a corner, the three edges that meet there, six faces.
"""

from __future__ import annotations

from taichi_foam.errors import UserError
from taichi_foam.units import LENGTH_UNITS

ISTA_1A = ((10.0, 0.76), (19.0, 0.61), (28.0, 0.46), (45.0, 0.31), (68.0, 0.20))
"""Masses [kg] up to which a packaged product is dropped from a height [m], by ISTA 1A."""

SEQUENCE = (
    "ISTA 1A drops a package ten times: on a corner, on the three edges that meet there, on its "
    "six faces. Computed here is a drop on a face, in a plane; corners are three-dimensional, and "
    "their pads need a test"
)

STOCK = {
    "si": tuple(
        each * LENGTH_UNITS["mm"]
        for each in (5, 8, 10, 12, 15, 20, 25, 30, 35, 40, 50, 60, 70, 80, 100, 120, 150, 200)
    ),
    "us": tuple(
        each * LENGTH_UNITS["in"]
        for each in (0.25, 0.375, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
    ),
}
"""Thicknesses of sheets [m] that are commonly in stock where units are metric, or US customary.

Assumed: suppliers differ.
"""


def drop_height(mass: float) -> float:
    """Drop height [m] by ISTA 1A for a packaged product of a mass [kg].

    Raises UserError: it is heavier than the procedure's products.
    """
    for most, height in ISTA_1A:
        if not mass > most:  # NaN is no mass of a wish
            return height
    raise UserError(
        f"mass = {mass:g} kg: ISTA 1A is for products of up to {ISTA_1A[-1][0]:g} kg, so that no "
        "drop height follows from the mass; give drop= in metres"
    )
