"""A flat block crushes a rectangle of foam below itself (Shim, Tu & Lim 2000, Fig. 22).

Physics: a rigid block, 6 kg and 50 mm wide, drops at 3.03 m/s on foam of 200 x 100 mm. Only the
foam below the face crushes, in a region with a sharp edge and as wide as the face; the force is
the plateau stress times the face, so the deceleration stays flat.

Measured (Table 2): duration 42 ms, displacement 65 mm, plateau 74 m/s2, first peak 97 m/s2 at
2.0 ms. The paper's own simulation stops after 40.2 ms and lacks that peak; here whole foam
overshoots its plateau, with 94 m/s2 after 1.8 ms.

Run time: some seconds on one core.
"""

from taichi_foam.choices import PAPERS_FOAM
from taichi_foam.scene import FlatBlock, Foam, Scene

# as calibrated on the nine tests: plateau and overshoot, what cracks cost (docs/fidelity.md)
FOAM = Foam(**PAPERS_FOAM)

scene = Scene(
    name="Flat block at 3.03 m/s",
    foam=FOAM,
    impactor=FlatBlock(width=0.05, velocity=3.03, friction=0.13),
)

if __name__ == "__main__":
    from taichi_foam.cli import run_script

    run_script(scene)
