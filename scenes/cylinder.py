"""A cylinder sinks into foam and splits it (Shim, Tu & Lim 2000, Fig. 24).

Physics: a rigid cylinder, 6 kg and 50 mm in diameter, drops at 3.32 m/s. The contact grows with
depth, so the deceleration rises smoothly until half the cylinder is in. The foam crushes in the
cylinder's path, most of all below it. Crushed foam holds together no more: a vertical crack runs
down from below the cylinder and splits the block.

Measured (Table 3): duration 53 ms, displacement 90 mm, plateau 65 m/s2.

Run time: some seconds on one core.
"""

from taichi_foam.choices import PAPERS_FOAM
from taichi_foam.scene import Cylinder, Foam, Scene

# as calibrated on the nine tests: plateau and overshoot, what cracks cost (docs/fidelity.md)
FOAM = Foam(**PAPERS_FOAM)

scene = Scene(
    name="Cylinder at 3.32 m/s",
    foam=FOAM,
    impactor=Cylinder(radius=0.025, velocity=3.32, friction=0.13),
)

if __name__ == "__main__":
    from taichi_foam.cli import run_script

    run_script(scene)
