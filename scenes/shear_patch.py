"""A sheared layer, let go: an unloading wave runs down from its free top (Eq. 25).

Physics: a wide layer, gripped at its base, starts in simple shear gamma = 0.05, at rest and with
nothing holding its top. Below the top the shear stress is G gamma everywhere, so nothing moves
until the news of the free top arrives: a front that runs down at c = sqrt(G/rho) = 181 m/s and
leaves the foam behind it free of stress and moving back at gamma c. Gripped base and free top make
it swing to and fro, over a period of four transits. The free sides send waves inwards too, the
fastest at sqrt(K/rho) = 330 m/s, so mid-width is undisturbed for 0.9 ms; the run ends before one
transit of the layer is over. At the base's left corner they tear the foam off its grip for ten
cells, 50 mm.

Exact answer: `exact_displacement(height, time)`, and `exact_top_displacement(time)` =
gamma (H - c t) for the first transit. Finite strain adds terms of the order of gamma^2: less than
one per cent.

Run time: a few seconds on one core.
"""

import math

from taichi_foam.scene import Base, Block, Numerics, Output, Scene, Start

GAMMA = 0.05

scene = Scene(
    name="Released shear patch",
    block=Block(width=0.6, height=0.1, columns=120, rows=20, mass_points="cells"),
    base=Base(kind="gripped"),
    start=Start(deformation_gradient=((1.0, GAMMA), (0.0, 1.0))),
    numerics=Numerics(damping_time=0.0, end=5e-4),
    output=Output(history_interval=1e-5, snapshot_interval=2.5e-5, mode="speed"),
)

block, foam = scene.block, scene.foam
wave_speed = math.sqrt(foam.shear_modulus / block.density)
side_wave_arrival = block.width / 2 / math.sqrt(foam.youngs_modulus / block.density)

# The bottom row of mass points is gripped; the foam that can shear reaches from it to the top.
layer = block.height - block.foot


def exact_displacement(height: float, time: float) -> float:
    """Displacement to the right [m] at mid-width of a material point at a reference height [m].

    D'Alembert's sum of two halves of the starting shape, continued past the gripped base as an
    odd and past the free top as an even function. Valid until `side_wave_arrival`.
    """
    s = height - block.foot
    return (_continued(s - wave_speed * time) + _continued(s + wave_speed * time)) / 2


def exact_top_displacement(time: float) -> float:
    """Displacement to the right [m] of the free top at mid-width; gamma (H - c t) at first."""
    return exact_displacement(block.height, time)


def _continued(s: float) -> float:
    """Starting displacement [m] a distance above the base, continued past base and top."""
    swing = (s + layer) % (4 * layer)
    return GAMMA * (swing - layer if swing < 2 * layer else 3 * layer - swing)


if __name__ == "__main__":
    from taichi_foam.cli import run_script

    run_script(scene)
