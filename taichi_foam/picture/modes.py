"""Quantities that a picture can show: a value for each cell, and the colour key.

A key depends on the scene alone, so that all frames of a run, and similar runs, have one scale.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taichi_foam.analysis.cell_state import apart, bonded, by_foam, over_bonds, worst_strain
from taichi_foam.laws.bond import Landmarks
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Scene
from taichi_foam.scene.filling import filling
from taichi_foam.scene.layers import foams_of_bonds
from taichi_foam.units import si_scale

Array = NDArray[np.float64]

#: Strain at the dark end of the key: the locking strain of the paper's foam (Table 6), or that of a
#: foam with a larger one.
KEY_STRAIN = 0.95
#: Stress at the dark end in plateau stresses; shear strain in multiples of that at fracture.
KEY_STRESS, KEY_SHEAR = 2.0, 2.0


@dataclass(frozen=True)
class Key:
    """A colour key.

    words     title in one or two lines, with the unit if the ticks have none
    shades    name of the colour map
    top       value at the dark end [SI]
    ticks     marked values [SI], with their text
    bottom    value at the other end [SI]: 0, which is light, or -`top`
    """

    words: tuple[str, ...]
    shades: str
    top: float
    ticks: tuple[tuple[float, str], ...]
    bottom: float = 0.0

    def share(self, value: float) -> float:
        """Relative position of a value on the key, 0 to 1."""
        return (value - self.bottom) / (self.top - self.bottom)


@dataclass(frozen=True)
class Mode:
    """A quantity to colour cells by.

    about   description for help texts
    key     the colour key for a scene
    values  its values in a snapshot: (columns, rows) [SI]
    """

    about: str
    key: Callable[[Scene], Key]
    values: Callable[[Snapshot, Scene], Array]


def _strain_key(*words: str) -> Callable[[Scene], Key]:
    def key(scene: Scene) -> Key:
        top = max(KEY_STRAIN, *(-marks.limit for marks in _landmarks(scene)))
        shown = (0.0, 0.2, 0.4, 0.6, 0.8, top)
        return Key(words, "heat", top, tuple((s, f"{_figure(100 * s)} %") for s in shown))

    return key


def _landmarks(scene: Scene) -> list[Landmarks]:
    return [foam.landmarks for foam in foams_of_bonds(scene)[0]]


def _worst(snapshot: Snapshot, scene: Scene) -> Array:
    return -worst_strain(snapshot.e_min_a, snapshot.e_min_b)


def _strain(snapshot: Snapshot, scene: Scene) -> Array:
    """Strain of the most compressed bond of each node, > 0; broken bonds count as unloaded."""
    e_a, e_b = _lengthwise(snapshot, scene)
    left_a, left_b = by_foam(snapshot, scene, lambda foam, worst: foam.permanent_strain(worst))
    a = np.where(snapshot.broken_a, left_a, e_a)
    b = np.where(snapshot.broken_b, left_b, e_b)
    return -worst_strain(a, b)


def _stress_key(scene: Scene) -> Key:
    top = KEY_STRESS * max(marks.plateau_stress for marks in _landmarks(scene))
    scale, prefix = si_scale(top, least=0, digits=3)
    ticks = _ticks(top, 1 / scale)
    # both sides share the space that a single side has elsewhere
    above = [*(tick for tick in ticks[:-1] if tick[0] < 0.6 * top), ticks[-1]]
    below = tuple((-value, f"−{text}".replace("−≥ ", "≤ −")) for value, text in above[:0:-1])
    words = ("stress, tension +", f"({prefix}Pa)")
    return Key(words, "both", top, (*below, *above), bottom=-top)


def _stress(snapshot: Snapshot, scene: Scene) -> Array:
    """The principal stress of larger magnitude of each node, tension positive."""
    # imported here, since it loads the engine: a live view's first picture must not wait for that
    from taichi_foam.engine.stresses import cell_stresses

    found = cell_stresses(scene, snapshot).astype(np.float64)
    xx, yy, xy = np.moveaxis(found, -1, 0)
    mean = 0.5 * (xx + yy)
    radius = np.hypot(0.5 * (xx - yy), xy)
    return np.where(mean > 0.0, mean + radius, mean - radius)


def _speed_key(scene: Scene) -> Key:
    top = _fastest(scene)
    words = ("speed", "(m/s)") if top >= 0.1 else ("speed", "(mm/s)")
    return Key(words, "cool", top, _ticks(top, 1.0 if top >= 0.1 else 1e3))


def _speed(snapshot: Snapshot, scene: Scene) -> Array:
    return np.hypot(snapshot.velocity[..., 0], snapshot.velocity[..., 1])


def _fastest(scene: Scene) -> float:
    """The initial speed of a scene [m/s]: its impactor's, or one from its block's initial state."""
    impactor, block, start = scene.impactor, scene.block, scene.start
    fastest = math.hypot(block.width, block.height) * float(np.abs(start.velocity_gradient).max())
    # releasing a strain moves foam at that fraction of the speed of sound
    strain = float(np.abs(np.array(start.deformation_gradient) - np.eye(2)).max())
    stiffest = max(foam.youngs_modulus for foam in foams_of_bonds(scene)[0])
    lightest = min(layer.density or block.density for layer in (block, *block.layers))
    fastest = max(fastest, strain * math.sqrt(stiffest / lightest))
    if impactor is not None:
        fall = 2 * scene.numerics.gravity * impactor.gap
        sideways = impactor.velocity_x**2
        fastest = max(fastest, math.sqrt(impactor.velocity**2 + sideways + fall))
    return fastest or 1.0


def _shear_key(scene: Scene) -> Key:
    top = KEY_SHEAR * max(marks.shear for marks in _landmarks(scene))
    return Key(("shear", "strain"), "cool", top, _ticks(top, 1e2, " %"))


def _shear(snapshot: Snapshot, scene: Scene) -> Array:
    """Shear strain of each node, from the mean directions of its whole bonds: F1.F2, twice E12."""
    x = snapshot.position
    apart_a, apart_b = apart(snapshot, scene.block)
    a = _mean_over_whole(np.diff(x, axis=0) / scene.block.dx, ~apart_a, 0)
    b = _mean_over_whole(np.diff(x, axis=1) / scene.block.dy, ~apart_b, 1)
    return np.abs(a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1])


def _mean_over_whole(difference: Array, whole: NDArray[np.bool_], axis: int) -> Array:
    """Mean (columns, rows, 2) over the one or two whole bonds of each node along `axis`."""
    kept = np.where(whole[..., None], difference, 0.0)
    rim = [(0, 0)] * 3
    first, second = rim.copy(), rim.copy()
    first[axis], second[axis] = (1, 0), (0, 1)
    total = np.pad(kept, first) + np.pad(kept, second)
    count = np.pad(whole, first[:2]).astype(np.intp) + np.pad(whole, second[:2])
    return total / np.maximum(count, 1)[..., None]


def _broken_key(scene: Scene) -> Key:
    ticks = tuple((float(n), str(n)) for n in range(5))
    return Key(("broken", "bonds"), "heat", 4.0, ticks)


def _broken(snapshot: Snapshot, scene: Scene) -> Array:
    return over_bonds(np.add, snapshot.broken_a, snapshot.broken_b)


def _energy_key(scene: Scene) -> Key:
    top = max(
        marks.plateau_stress * (marks.crush_start - marks.crush_end) for marks in _landmarks(scene)
    )
    scale, prefix = si_scale(top, least=0, digits=3)
    words = ("crush energy", f"({prefix}J/m³)")
    return Key(words, "heat", top, _ticks(top, 1 / scale))


def _energy(snapshot: Snapshot, scene: Scene) -> Array:
    """Energy absorbed by crushing [J/m3]: plateau stress times permanent strain.

    The contribution of strain rate is left out. A node's foam contains half of each of its bonds.
    """
    a, b = by_foam(
        snapshot,
        scene,
        lambda foam, worst: foam.landmarks.plateau_stress * foam.permanent_strain(worst),
    )
    filled = filling(scene.block)
    total = -0.5 * over_bonds(np.add, filled.face_a * a, filled.face_b * b)
    return total / np.where(filled.there, filled.area, 1.0)


MODES: dict[str, Mode] = {
    "worst-strain": Mode(
        "worst compressive strain so far", _strain_key("worst compressive", "strain"), _worst
    ),
    "strain": Mode("compressive strain now", _strain_key("compressive", "strain"), _strain),
    "stress": Mode(
        "principal stresses now, compression and tension separately", _stress_key, _stress
    ),
    "speed": Mode("speed of the foam", _speed_key, _speed),
    "shear": Mode("shear strain now", _shear_key, _shear),
    "broken": Mode("broken bonds of each cell", _broken_key, _broken),
    "energy": Mode("energy absorbed by crushing", _energy_key, _energy),
}
"""Modes by their names in `output.mode`."""


def _lengthwise(snapshot: Snapshot, scene: Scene) -> tuple[Array, Array]:
    """Current engineering strains of the bonds A and B; 0 where there is no bond."""
    x, (a, b) = snapshot.position, bonded(scene.block)
    along, upright = np.diff(x, axis=0), np.diff(x, axis=1)
    return (
        np.where(a, np.hypot(along[..., 0], along[..., 1]) / scene.block.dx - 1, 0.0),
        np.where(b, np.hypot(upright[..., 0], upright[..., 1]) / scene.block.dy - 1, 0.0),
    )


def _ticks(top: float, factor: float, unit: str = "") -> tuple[tuple[float, str], ...]:
    """Ticks at round numbers up to `top` [SI], shown multiplied by `factor`, and one at `top`.

    The last means "or more". Round numbers near it are left out.
    """
    from matplotlib.ticker import MaxNLocator

    shown = MaxNLocator(nbins=5, steps=[1, 2, 5, 10]).tick_values(0.0, factor * top)
    inner = [value for value in shown if -1e-9 <= value < 0.9 * factor * top]
    last = f"≥ {_figure(factor * top)}{unit}"
    return (*((value / factor, f"{_figure(value)}{unit}") for value in inner), (top, last))


def _figure(value: float) -> str:
    """A number with three digits, never with an exponent."""
    return np.format_float_positional(float(f"{value:.3g}"), trim="-")
