"""Running one scene to its end, and a bar of foam that a heavy plate hits."""

from __future__ import annotations

from taichi_foam.results.result import Result
from taichi_foam.scene import Base, Block, FlatBlock, Foam, Model, Numerics, Output, Scene
from taichi_foam.simulation.simulate import run

DENSITY = 25.6  # kg/m3
PLATE = 1e3  # kg: a bar of 10 mm x 57 mm slows it by less than 5 mm/s


def bar(
    name: str, length: float, cell: float, foam: Foam, velocity: float, numerics: Numerics,
    output: Output,
) -> Scene:  # fmt: skip
    """A bar, two columns wide, that stands on a support, and a plate; SI units."""
    return Scene(
        name=name,
        block=Block(
            width=2 * cell,
            height=length,
            columns=2,
            rows=round(length / cell),
            mass_points="cells",
            density=DENSITY,
        ),
        foam=foam,
        impactor=FlatBlock(
            width=4 * cell, height=0.02, mass=PLATE, velocity=velocity, friction=0.0
        ),
        base=Base(kind="held"),
        model=Model(self_contact=False),
        numerics=numerics,
        output=output,
    )


def whole(scene: Scene) -> Result:
    """Its result. Ctrl-C is raised: figures of half a run must not be kept."""
    result = run(scene)
    if result.run["interrupted"]:
        raise KeyboardInterrupt
    return result
