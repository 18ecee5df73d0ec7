"""Where an impactor comes to rest on foam as it lies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taichi_foam.laws.shape import Impactor
from taichi_foam.laws.shape import outline as geometry

LIFTED = 1e-3
"""An impactor that starts further than this above a fresh block, in cells, is over thrown foam."""


def height_beneath(
    position: NDArray[np.float64], impactor: Impactor, there: NDArray[np.bool_]
) -> float:
    """Height [m] of the impactor's lowest point when it comes down on mass points, and touches one.

    Args:
        position: (I, J, 2) of the mass points [m].
        impactor: of which the part that faces down counts, as it starts.
        there: (I, J) which mass points count.

    Raises ValueError: there is no mass point beneath it.
    """
    chain = geometry.lower_chain(impactor.outline())
    x = position[there, 0] - impactor.x
    beneath = (chain[0, 0] < x) & (x < chain[-1, 0])
    if not beneath.any():
        raise ValueError("no mass point is beneath the impactor")
    y = position[there, 1][beneath]
    return float(np.max(y - np.interp(x[beneath], chain[:, 0], chain[:, 1])))
