"""Where the next points of a curve go: where straight lines between the points miss it most.

Between two points a distance w apart, a line misses a curve of the second derivative y'' by up to
|y''| w^2 / 8. The package `adaptive` offers the same and more, but its present versions need
Python 3.11, and it takes longer to load than a drop to compute.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def next_points(
    x: Array, y: Array, most: int, tolerance: float, counts: NDArray[np.bool_] | None = None
) -> list[float]:
    """Up to `most` new places between the points of a curve, in rising order.

    The interval that a line misses by most is halved, then the next, as long as it is missed by
    more than `tolerance`. A half is taken to be missed by a quarter of what the whole was.

    Args:
        x: (n,) places, rising, three or more.
        y: (n, k) values of k curves there.
        counts: (n - 1,) which of the intervals between places matter; None: all.
    """
    width = np.diff(x)
    slopes = np.diff(y, axis=0) / width[:, None]
    bend = np.abs(2.0 * np.diff(slopes, axis=0) / (width[1:] + width[:-1])[:, None]).max(axis=1)
    larger = np.maximum(np.append(bend[0], bend), np.append(bend, bend[-1]))
    missed = larger * width**2 / 8.0
    if counts is not None:
        missed = np.where(counts, missed, 0.0)
    intervals = list(zip(missed.tolist(), x[:-1].tolist(), x[1:].tolist(), strict=True))
    found: list[float] = []
    while len(found) < most:
        worst, left, right = max(intervals)
        if worst <= tolerance:
            break
        middle = 0.5 * (left + right)
        intervals.remove((worst, left, right))
        intervals += [(worst / 4.0, left, middle), (worst / 4.0, middle, right)]
        found.append(middle)
    return sorted(found)
