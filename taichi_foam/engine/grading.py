"""The makeup of each bond: its foam, the effect of its length on limits, its strength, and cuts."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.laws.bond import BondFoam, Limit
from taichi_foam.scene import Block, Scene
from taichi_foam.scene.layers import foams_of, foams_of_bonds, loose_rows

# A bond runs along its own axis (A along x, B along y); the other axis lies across it.
A = 0
B = 1


@dataclass(frozen=True)
class Grading:
    """The foams of a block, and where they are.

    foams   the distinct foams
    places  (2, J) index of the foam of bonds A in row j, and of bonds B from row j to row j + 1
    """

    foams: tuple[BondFoam, ...]
    places: NDArray[np.int32]


def grading(scene: Scene) -> Grading:
    """The foams of a scene's bonds; the absent bonds B above the top row get that row's foam."""
    foams, along, upright = foams_of_bonds(scene)
    places = np.array([along, [*upright, foams_of(scene)[1][-1]]])
    used = np.unique(places)
    return Grading(tuple(foams[n] for n in used), np.searchsorted(used, places).astype(np.int32))


def strengths(scene: Scene) -> NDArray[np.float64]:
    """Strength of every bond over the mean strength, (columns, rows, 2).

    [i, j, 0] is that of bond A(i, j), [i, j, 1] that of B(i, j). Weibull's distribution with a mean
    of 1 and the foam's scatter (Weibull 1951).
    """
    block, foam = scene.block, scene.foam
    shape = (block.columns, block.rows, 2)
    if foam.strength_scatter == 0:
        return np.ones(shape)
    modulus = weibull_modulus(foam.strength_scatter)
    drawn = np.random.default_rng(foam.strength_seed).weibull(modulus, shape)
    return drawn / math.gamma(1 + 1 / modulus)


def limits(foam: BondFoam, block: Block) -> tuple[tuple[Limit, Limit], tuple[Limit, Limit]]:
    """Limits of bonds A and B in tension, then in shear, see `BondFoam.limits`."""
    a, b = (foam.limits(length) for length in (block.dx, block.dy))
    return (a[0], b[0]), (a[1], b[1])


def rate_shares(foam: BondFoam, block: Block) -> tuple[float, float]:
    """Factors on the strain rates of bonds A and B that refer them to the foam's crush band.

    Foam crushes one row of cells at a time, between the impactor and foam at rest: in cells half as
    large the strain rate would be twice as high, and so would everything that depends on it.
    """
    band = foam.crush_band
    a, b = (1.0 if band is None else length / band for length in (block.dx, block.dy))
    return _snapped(a), _snapped(b)


def _snapped(share: float) -> float:
    """1 if the share differs from it by rounding only, so that results are bitwise identical."""
    return 1.0 if abs(share - 1.0) < 1e-9 else share


def cuts(scene: Scene) -> NDArray[np.bool_]:
    """Whether each bond is cut through at the start, (columns, rows, 2) as in `strengths`.

    Saw cuts, and the interfaces of loose layers.
    """
    found = np.zeros((scene.block.columns, scene.block.rows, 2), dtype=bool)
    for cut in scene.start.cuts:
        found |= _crossed(scene.block, *cut)
    found[:, loose_rows(scene.block), 1] = True
    return found


def weibull_modulus(scatter: float) -> float:
    """The modulus of the Weibull distribution with this standard deviation over its mean."""
    # takes half a second to import, and few foams scatter
    from scipy.optimize import root_scalar

    if scatter < 1e-4:
        # rounding would dominate below; in this limit modulus * log(strength) is Gumbel-distributed
        return math.pi / math.sqrt(6.0) / scatter

    def excess(modulus: float) -> float:
        log_ratio = math.lgamma(1 + 2 / modulus) - 2 * math.lgamma(1 + 1 / modulus)
        return math.expm1(log_ratio) - scatter**2

    # the scatter is about 1.2 over the modulus
    found = root_scalar(excess, bracket=(0.5 / scatter, 2.0 / scatter), method="brentq")
    return float(found.root)


def _crossed(block: Block, x0: float, y0: float, x1: float, y1: float) -> NDArray[np.bool_]:
    """Which bonds a straight cut crosses, each taken as the line between its nodes.

    A node on the cut counts as left of it, seen from the cut's start.
    """
    node = block.positions
    start, end = np.array([x0, y0]), np.array([x1, y1])
    left = _cross(end - start, node - start) >= 0
    crossed = np.zeros((*left.shape, 2), dtype=bool)
    for axis in range(2):
        near = node[:-1] if axis == 0 else node[:, :-1]
        far = node[1:] if axis == 0 else node[:, 1:]
        sides = left[:-1] != left[1:] if axis == 0 else left[:, :-1] != left[:, 1:]
        # the cut's ends are on different sides of the bond
        across = (_cross(far - near, start - near) >= 0) != (_cross(far - near, end - near) >= 0)
        crossed[: sides.shape[0], : sides.shape[1], axis] = sides & across
    return crossed


def _cross(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any]:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
