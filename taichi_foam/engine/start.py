"""The instant that a scene starts with, without a lattice: for pictures of what is yet to run."""

import numpy as np

from taichi_foam.engine.strengths import strengths
from taichi_foam.records.snapshot import Snapshot
from taichi_foam.scene import Scene


def start_of(scene: Scene) -> Snapshot:
    """The first snapshot of a run of `scene`; mass points that the base holds stand still."""
    block, start = scene.block, scene.start
    x = (np.arange(block.columns) - 0.5 * (block.columns - 1)) * block.dx
    y = (np.arange(block.rows) + 0.5) * block.dy
    X = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    arm = X - np.array([0.0, 0.5 * block.dy])
    position = X + arm @ (np.array(start.deformation_gradient) - np.eye(2)).T
    velocity: np.ndarray = arm @ np.array(start.velocity_gradient).T
    velocity[:, 0, 0] *= scene.base.kind != "gripped"
    velocity[:, 0, 1] *= scene.base.kind == "floor"
    strength = strengths(scene)
    worst_a, worst_b = (min(0.0, strain) for strain in start.strains)
    if scene.foam.rate is not None:
        worst_a = worst_b = 0.0  # foam that heeds the rate has had no time to flow
    cut = np.where(strength == 0.0, 0.0, np.nan)
    impactor = scene.impactor
    return Snapshot(
        time=0.0,
        impactor_y=np.nan if impactor is None else scene.contact_height + impactor.gap,
        position=position,
        velocity=velocity,
        e_min_a=np.full(cut[:-1, :, 0].shape, worst_a),
        e_min_b=np.full(cut[:, :-1, 1].shape, worst_b),
        break_time_a=cut[:-1, :, 0],
        break_time_b=cut[:, :-1, 1],
    )
