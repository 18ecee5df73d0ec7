"""A tap on a long bar: where its front is, and how wide, in a lattice and with dashpots.

tests/conservation/test_waves.py has the lattice's exact dispersion, w = (2 c / dx) sin(k dx / 2),
for longitudinal and shear waves. Here is what it does to a step: to leading order

    v / v0 = integral of Ai from z on,   z = (x - c t) / (c t dx^2 / 8)^(1/3)

so that the front is where v = v0 / 3, and as wide as dx^(2/3) t^(1/3). Dashpots (Kelvin and Voigt)
make it v / v0 = erfc((x - c t) / sqrt(2 nu t)) / 2 instead, nu = eta / rho, whatever the cells.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import erfcinv, itairy

from taichi_foam.scene import Foam, Numerics, Output, Scene
from verification.runs import DENSITY, bar, whole

CELLS = (0.010, 0.005, 0.0025, 0.00125)  # m
LENGTH = 1.0  # m
TIME = 2e-3  # s: the front has come 0.66 m
DAMPING_TIME = 1e-6 / 0.057  # s, Table 6
TAP = 0.1  # m/s: strains of 3e-4
FOAM = Foam()
SOUND = math.sqrt(FOAM.youngs_modulus / DENSITY)
HIGH, LOW = 0.9, 0.1  # levels of v / v0 between which the front is as wide as it is


def scene(cell: float, damping_time: float) -> Scene:
    """A bar that is tapped."""
    numerics = Numerics(damping_time=damping_time, end=TIME)
    output = Output(history_interval=TIME / 10, snapshot_interval=TIME)
    return bar("Tap", LENGTH, cell, FOAM, TAP, numerics, output)


def compute(bar: tuple[float, float]) -> dict[str, float]:
    """Where the front is, against c t, and its width: measured and in theory [m].

    Of a bar given by its cell and damping time.
    """
    cell, damping_time = bar
    last = whole(scene(cell, damping_time)).snapshots[-1]
    share = -last.velocity[0, ::-1, 1] / TAP
    depth = np.arange(len(share)) * cell
    at = 1 / 2 if damping_time else 1 / 3
    return {
        "cell": cell,
        "late": _reached(depth, share, at) - SOUND * last.time,
        "width": _reached(depth, share, LOW) - _reached(depth, share, HIGH),
        "theory": damped_width(last.time) if damping_time else lattice_width(cell, last.time),
    }


def lattice_width(cell: float, time: float) -> float:
    """Width of the undamped front [m]."""
    scale = (SOUND * time * cell**2 / 8) ** (1 / 3)

    def excess(z: float, level: float) -> float:
        # itairy integrates from 0; beyond z = 0 there is a third
        inside = itairy(z)[0] if z > 0 else -itairy(-z)[2]
        return 1 / 3 - inside - level

    ahead: Any = brentq(excess, 0.0, 6.0, args=(LOW,))
    behind: Any = brentq(excess, -1.5, 0.0, args=(HIGH,))
    return scale * (ahead - behind)


def damped_width(time: float) -> float:
    """Width of the front in a continuum with Table 6's dashpots [m]."""
    spread = math.sqrt(2 * DAMPING_TIME * SOUND**2 * time)
    return spread * float(erfcinv(2 * LOW) - erfcinv(2 * HIGH))


def plan() -> dict[str, tuple[float, float]]:
    """All bars by name: cell and damping time."""
    return {
        f"cells of {1e3 * cell:g} mm, {'damped' if time else 'undamped'}": (cell, time)
        for time in (0.0, DAMPING_TIME)
        for cell in CELLS
    }


def _reached(depth: np.ndarray, share: np.ndarray, level: float) -> float:
    """Depth at which the front first has a level, seen from ahead [m]."""
    n = int(np.flatnonzero(share > level)[-1])
    part = (share[n] - level) / (share[n] - share[n + 1])
    return float(depth[n] + part * (depth[n + 1] - depth[n]))
