"""A run on a block that an earlier run has left: checks, and the initial state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taichi_foam.analysis.impact import height_beneath
from taichi_foam.errors import UserError
from taichi_foam.records.cushion import Cushion
from taichi_foam.results.result import Result
from taichi_foam.scene import Scene
from taichi_foam.scene.filling import filling
from taichi_foam.scene.messages import shown
from taichi_foam.scene.values import by_key

SAME = ("block", "foam", "across", "model", "base", "support", "start")
"""Parts of a scene that must be the same in a run and in the one that left its block.

The pulse of the base may differ.
"""


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
                "impactor, numerics, output and the pulse of the base may differ"
            )
        height = None
        if scene.impactor is not None:
            try:
                height = height_beneath(
                    result.cushion.position, scene.impactor, filling(scene.block).there
                )
            except ValueError as error:
                raise UserError(
                    f"impactor.x = {scene.impactor.x:g}: {error}, given the state in which {name} "
                    "left the block. Fix: move the impactor, or use a wider one"
                ) from None
        told = {
            "scene": result.scene.name,
            "state_sha256": result.cushion.sha256,
            "drop": result.drop + (result.scene.impactor is not None),
            "contact_height_m": height,
        }
        return cls(told, result.cushion)


def _differences(before: Scene, scene: Scene) -> list[str]:
    """The differences of two scenes in the parts that must be the same."""
    there, here = (by_key(each.model_dump(include={*SAME})) for each in (before, scene))
    keys = [
        key
        for key in {**there, **here}
        if there.get(key) != here.get(key)
        and not key.startswith(("base.acceleration", "base.pulse"))
    ]
    found = [f"{key} = {_word(there.get(key))} instead of {_word(here.get(key))}" for key in keys]
    return found if len(found) < 4 else [*found[:3], f"and {len(found) - 3} more"]


def _word(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
