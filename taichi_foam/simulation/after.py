"""A run on a block that an earlier run has left: checks, and the initial state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_foam.analysis.impact import contact_height
from taichi_foam.errors import UserError
from taichi_foam.records.cushion import Cushion
from taichi_foam.results.folders import differences
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene
from taichi_foam.scene.filling import filling
from taichi_foam.scene.layers import foams_of_bonds
from taichi_foam.scene.messages import shown
from taichi_foam.scene.paths import by_key

SAME = ("block", "foam", "across", "model", "base", "support", "start")
"""Parts of a scene that must be the same in a run and in the one that left its block.

The pulse of the base and `start.wait` may differ.
"""


HOLDS_APART, STAYS, LOOSE = 1e-3, 1e9, 1e-12
"""Weights, in least squares over whole bonds: of broken ones, of points that do not move, and of
the present place of others, which matters for pieces that hang on nothing."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class After:
    """The earlier run on the block of a run.

    told     `run["after"]` of its result: the initial state, in a few figures
    cushion  the block; None for a run that has begun already and continues from its checkpoint
    """

    told: Mapping[str, Any]
    cushion: Cushion | None = None

    @classmethod
    def of(cls, scene: Scene, before: Result | str | Path) -> After:
        """A run of `scene` on the block left by `before`, a result or its folder.

        Raises UserError: there is no such result, its run did not reach its end, its block differs
        from the scene's, or the impactor would miss the block.
        """
        result = before if isinstance(before, Result) else Result.load(before)
        name = result.scene.name if before is result else str(before)
        if result.cushion is None:
            raise UserError(
                f"after = {shown(name)}: left no block to continue with (it ended by: "
                f"{result.ending or 'unknown'}). Fix: run it to its end with this version"
            )
        problems = _differences(result.scene, scene)
        if problems:
            raise UserError(
                f"after = {shown(name)}: its block differs from that of this scene: "
                f"{'; '.join(problems)}. Fix: give both runs the same {', '.join(SAME)}; only "
                "impactor, numerics, output, the pulse of the base and start.wait may differ"
            )
        cushion, height = rested(scene, result.cushion), None
        if scene.impactor is not None:
            try:
                height = contact_height(scene.block, scene.impactor, cushion)
            except ValueError as error:
                raise UserError(
                    f"impactor.x = {scene.impactor.x:g}: {error}, given the state in which {name} "
                    "left the block. Fix: move the impactor, or use a wider one"
                ) from None
        told = {
            "scene": result.scene.name,
            "state_sha256": cushion.sha256,
            "drop": result.drop + (result.scene.impactor is not None),
            "contact_height_m": height,
        }
        return cls(told, cushion)


def rested(scene: Scene, cushion: Cushion) -> Cushion:
    """The block after `start.wait`; unchanged where that is 0, or where no foam recovers.

    What its bonds remember recovers as their law says, and the block lies still. Each bond then
    wants to be as long as its set leaves it, in its direction: positions are the least squares of
    that over all bonds, on a base that stays where it is. A level cushion meets it exactly, so that
    its bonds store no energy.
    """
    foams, along, upright = foams_of_bonds(scene)
    if scene.start.wait == 0.0 or not any(foam.recovers for foam in foams):
        return cushion
    found = {"a": cushion.worst_a.copy(), "b": cushion.worst_b.copy()}
    own = {name: each.copy() for name, each in cushion.own.items()}
    left = {end: np.zeros_like(worst) for end, worst in found.items()}
    for end, rows in (("a", along), ("b", upright)):
        names = [name for name in own if name.endswith(f"_{end}")]
        for n, foam in enumerate(foams):
            here = rows == n
            remembered = {name[:-2]: own[name][:, here] for name in names}
            after = foam.rested(found[end][:, here], remembered, scene.start.wait)
            found[end][:, here] = after.pop("worst")
            left[end][:, here] = foam.permanent_strain(found[end][:, here])
            for name, values in after.items():
                own[f"{name}_{end}"][:, here] = values
    return replace(
        cushion,
        position=_settled(scene, cushion, left),
        velocity=np.zeros_like(cushion.velocity),
        increment=np.zeros_like(cushion.increment),
        worst_a=found["a"],
        worst_b=found["b"],
        own=own,
        stiffest=-1.0,  # to be found
        crush=max(0.0, *(-worst.min(initial=0.0) for worst in found.values())),
        speed=0.0,
    )


def _settled(scene: Scene, cushion: Cushion, left: Mapping[str, Array]) -> Array:
    """Positions at which bonds have the strains `left`, by least squares (I, J, 2).

    A broken bond keeps its length, and counts little: it only keeps pieces where they are.
    """
    from scipy.sparse import csr_matrix, diags  # slow to import
    from scipy.sparse.linalg import splu

    block, filled = scene.block, filling(scene.block)
    number = np.arange(block.columns * block.rows).reshape(block.columns, block.rows)
    first, second, wanted, counts = [], [], [], []
    ends = (
        (number[:-1], number[1:], block.dx, left["a"], cushion.broken_a, filled.face_a),
        (number[:, :-1], number[:, 1:], block.dy, left["b"], cushion.broken_b, filled.face_b),
    )
    position = cushion.position.reshape(-1, 2)
    for near, far, length, strain, broken, face in ends:
        reach = position[far] - position[near]
        now = np.hypot(reach[..., 0], reach[..., 1])
        whole = (broken == 0.0) & (face > 0.0)
        times = np.where(whole, length * (1.0 + strain) / np.maximum(now, 1e-12), 1.0)
        first.append(near.ravel())
        second.append(far.ravel())
        wanted.append((times[..., None] * reach).reshape(-1, 2))
        counts.append(np.where(whole, 1.0, np.where(face > 0.0, HOLDS_APART, 0.0)).ravel())
    near, far, count = (np.concatenate(each) for each in (first, second, counts))
    bonds = np.arange(near.size)
    signs = np.append(-np.ones(near.size), np.ones(near.size))
    shape = near.size, position.shape[0]
    differences = csr_matrix((signs, (np.append(bonds, bonds), np.append(near, far))), shape)
    # mass points on the base, and those without a bond, stay where they are
    stays = filled.on_base.ravel() | (np.bincount(near, count, shape[1]) == 0.0) & (
        np.bincount(far, count, shape[1]) == 0.0
    )
    weighted = differences.T.multiply(count).tocsr()
    held = np.where(stays, STAYS, LOOSE)
    system = (weighted @ differences + diags(held)).tocsc()
    right = weighted @ np.concatenate(wanted) + held[:, None] * position
    return np.asarray(splu(system).solve(right)).reshape(cushion.position.shape)


def _differences(before: Scene, scene: Scene) -> list[str]:
    """The differences of two scenes in the parts that must be the same."""
    there, here = (
        {
            key: value
            for key, value in by_key(each.model_dump(include={*SAME})).items()
            if not key.startswith(("base.acceleration", "base.pulse", "start.wait"))
        }
        for each in (before, scene)
    )
    found = differences(there, here)
    return found if len(found) < 4 else [*found[:3], f"and {len(found) - 3} more"]
