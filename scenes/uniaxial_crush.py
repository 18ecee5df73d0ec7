"""A column of foam between plates gives back its own stress-strain curve (Eq. 26, Fig. 19).

Physics: a plate wider than the column presses it down at 1 m/s, which is slow against the sound in
the foam (330 m/s). The plate is so heavy that crushing hardly slows it. In equilibrium every
bond carries the same nominal stress, so the force over the column's section traces Eq. 26:
elastic to 5 %, a plateau to 80 %, then densification. Strains are of the distance between the
first and the last row of mass points, one cell less than the column's height. Contact of pieces is
left out: beyond a strain of 0.75 discs at the free sides would meet those next but one.

Exact answer: `exact_stress(strain)`, up to the sound waves that the plate's arrival sets off and,
on the plateau, rows that crush one after the other.

Run time: some seconds on one core.
"""

import math

from taichi_foam.scene import Base, Block, FlatBlock, Foam, Model, Numerics, Output, Scene

SPEED = 1.0  # m/s
FINAL_STRAIN = 0.87

block = Block(width=0.05, height=0.10, columns=10, rows=20, mass_points="cells")
gauge_length = block.height - block.dy
section = block.width * block.depth

scene = Scene(
    name="Uniaxial crush",
    block=block,
    impactor=FlatBlock(width=0.06, height=0.02, mass=1e4, velocity=SPEED, friction=0.0),
    base=Base(kind="held"),
    model=Model(self_contact=False),
    numerics=Numerics(end=FINAL_STRAIN * gauge_length / SPEED),
    output=Output(history_interval=5e-5),
)


def exact_stress(strain: float) -> float:
    """Nominal stress [Pa] of virgin foam at a nominal strain, both positive in tension (Eq. 26)."""
    foam = scene.foam
    assert isinstance(foam, Foam)
    if strain >= foam.yield_strain:
        return foam.youngs_modulus * strain
    plateau = foam.youngs_modulus * foam.yield_strain
    past = foam.densification_strain - strain
    if past <= 0:
        return plateau
    left = strain - foam.locking_strain
    return plateau * math.exp(foam.densification_a * past / left**foam.densification_b)


def nominal_strain(displacement: float) -> float:
    """Nominal strain of the column when the plate has come down by a displacement [m]."""
    return -displacement / gauge_length


if __name__ == "__main__":
    from taichi_foam.cli import run_script

    run_script(scene)
