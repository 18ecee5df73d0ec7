"""A plate taps the end of a bar of foam, and a sound wave runs down it.

Physics: a plate of 0.5 kg meets the whole end of a bar, 50 mm wide and 1 m high, at 1 m/s. The
stress rho c v = 8.4 kPa is far below yield (139 kPa), so a front runs down at
c = sqrt(K/rho) = 330 m/s and the foam behind it moves with the plate. (The model's normal stresses
are uncoupled, so the sides stay straight and the bar is one-dimensional.) The bar is to the plate
a pure dashpot, rho c A = 24 kg/s, until the front has been to the base and back.

Exact answer: for times below `reflection_time` = 2L/c = 6.0 ms, force rho c A v,
velocity v0 exp(-rho c A t / M). The lattice rounds the front over a few cells.

Run time: some seconds on one core.
"""

import math

from taichi_foam.scene import Base, Block, FlatBlock, Numerics, Output, Scene

block = Block(width=0.05, height=1.0, cell=0.005)
plate = FlatBlock(width=0.06, height=0.02, mass=0.5, velocity=1.0, friction=0.0)
scene = Scene(
    name="Wave in a bar",
    block=block,
    impactor=plate,
    base=Base(kind="held"),
    numerics=Numerics(end=6e-3),
    output=Output(history_interval=2e-5, snapshot_interval=1e-4, mode="speed"),
)

wave_speed = math.sqrt(scene.foam.youngs_modulus / block.density)
impedance = block.density * wave_speed * block.width * block.depth
reflection_time = 2 * block.height / wave_speed


def exact_velocity(time: float) -> float:
    """Velocity of the plate [m/s], downwards, before the reflection."""
    return plate.velocity * math.exp(-impedance * time / plate.mass)


def exact_force(time: float) -> float:
    """Force between plate and bar [N] before the reflection."""
    return impedance * exact_velocity(time)


if __name__ == "__main__":
    from taichi_foam.cli import run_script

    run_script(scene)
