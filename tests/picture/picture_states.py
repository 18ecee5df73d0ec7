"""Made-up states of a lattice, whose pictures are known without a simulation."""

from __future__ import annotations

import numpy as np

from taichi_foam.picture.view import View
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Block, FlatBlock, Numerics, Scene


def scene_of(columns: int = 40, rows: int = 20, **parts: object) -> Scene:
    """The paper's block under the flat impactor, at any number of cells, with rows in them."""
    parts.setdefault("impactor", FlatBlock())
    block = Block(columns=columns, rows=rows, mass_points="cells")
    return Scene(name="made-up state", block=block, **parts)


def alone(columns: int = 40, rows: int = 20, **parts: object) -> Scene:
    """The same block without an impactor."""
    return scene_of(columns, rows, impactor=None, numerics=Numerics(end=0.01), **parts)


def colour_at(image: np.ndarray, view: View, x: float, y: float) -> tuple[int, ...]:
    """The colour of a place in the world [m]."""
    return tuple(image[int(view.y_zero - view.scale * y), int(view.x_zero + view.scale * x)])


def reference(scene: Scene) -> np.ndarray:
    """Undeformed node positions (columns, rows, 2) [m]."""
    return scene.block.positions


def snapshot_of(
    scene: Scene,
    position: np.ndarray,
    *,
    time: float = 0.0,
    impactor_y: float = np.nan,
    broken_a: np.ndarray | None = None,
    broken_b: np.ndarray | None = None,
    e_min_a: np.ndarray | None = None,
    e_min_b: np.ndarray | None = None,
) -> Snapshot:
    """A snapshot of given positions; strains follow from them where they are not given."""
    block = scene.block
    if e_min_a is None:
        length = np.linalg.norm(np.diff(position, axis=0), axis=-1)
        e_min_a = np.clip(length / block.dx - 1, -0.94, 0)
    if e_min_b is None:
        length = np.linalg.norm(np.diff(position, axis=1), axis=-1)
        e_min_b = np.clip(length / block.dy - 1, -0.94, 0)
    none_a = np.zeros_like(e_min_a, dtype=bool) if broken_a is None else broken_a
    none_b = np.zeros_like(e_min_b, dtype=bool) if broken_b is None else broken_b
    return Snapshot(
        time=time,
        impactor_y=impactor_y,
        position=position,
        velocity=np.zeros_like(position),
        e_min_a=e_min_a,
        e_min_b=e_min_b,
        break_time_a=np.where(none_a, time, np.nan),
        break_time_b=np.where(none_b, time, np.nan),
        shear_set=np.zeros((position.shape[0] - 1, position.shape[1] - 1)),
    )


def intact(scene: Scene) -> Snapshot:
    """The block as it starts, the impactor just touching."""
    return snapshot_of(scene, reference(scene), impactor_y=scene.contact_height)


def dented(scene: Scene, depth: float = 0.04, time: float = 0.015) -> Snapshot:
    """A dent of `depth` [m] under the flat impactor, crushed from the top, mirror symmetric."""
    position = reference(scene)
    X = position.copy()
    top = scene.contact_height
    # Crushed rows keep 15 % of their height, so the crushed front lies depth/0.85 deep.
    front = top - depth / 0.85
    crushed = np.where(X[..., 1] > front, front + 0.15 * (X[..., 1] - front), X[..., 1])
    edge = 0.5 * (1 - np.tanh((np.abs(X[..., 0]) - 0.027) / 0.003))
    position[..., 1] = X[..., 1] + edge * (crushed - X[..., 1])
    return snapshot_of(scene, position, time=time, impactor_y=top - depth)


def split(scene: Scene, opening: float = 0.12, time: float = 0.03) -> Snapshot:
    """Cut along the middle, the halves leaning outwards by `opening` [rad]."""
    block = scene.block
    position = reference(scene)
    for half, sign in ((slice(0, block.columns // 2), 1), (slice(block.columns // 2, None), -1)):
        pivot = np.array([-sign * block.width / 4, block.dy / 2])
        c, s = np.cos(sign * opening), np.sin(sign * opening)
        turn = np.array([[c, -s], [s, c]])
        position[half] = pivot + (position[half] - pivot) @ turn.T
    broken_a = np.zeros((block.columns - 1, block.rows), dtype=bool)
    broken_a[block.columns // 2 - 1] = True
    none_a = np.zeros((block.columns - 1, block.rows))
    return snapshot_of(
        scene, position, time=time, impactor_y=0.07, broken_a=broken_a, e_min_a=none_a
    )


def shattered(scene: Scene, time: float = 0.04, seed: int = 3) -> Snapshot:
    """Every bond broken, every node thrown a little: powder."""
    block = scene.block
    random = np.random.default_rng(seed)
    position = reference(scene) + random.normal(0, 0.4 * block.dx, (block.columns, block.rows, 2))
    e_min_a = -random.uniform(0, 0.8, (block.columns - 1, block.rows))
    e_min_b = -random.uniform(0, 0.8, (block.columns, block.rows - 1))
    return snapshot_of(
        scene,
        position,
        time=time,
        impactor_y=0.08,
        broken_a=np.ones_like(e_min_a, dtype=bool),
        broken_b=np.ones_like(e_min_b, dtype=bool),
        e_min_a=e_min_a,
        e_min_b=e_min_b,
    )
