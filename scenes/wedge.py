"""A wedge opens foam like an axe opens wood (Shim, Tu & Lim 2000, Fig. 26).

Physics: a rigid 90 degree wedge on a 50 mm shank, 6 kg, drops at 2.86 m/s. The foam crushes along
the two inclined faces and hardly at all ahead of the tip; a crack starts at the tip and splits the
block. The deceleration rises linearly until the tip is in, at 25 mm, and then stays at about
66 m/s2 (measured: it falls slightly as the halves give way).

Measured (Table 4): duration 49 ms, displacement 75 mm, plateau 66 m/s2. The paper's own simulation
gives 48.3 ms.

Run time: some seconds on one core.
"""

from taichi_foam.choices import PAPERS_FOAM
from taichi_foam.scene import Foam, Scene, Wedge

# as calibrated on the nine tests: plateau and overshoot, what cracks cost (docs/fidelity.md)
FOAM = Foam(**PAPERS_FOAM)

scene = Scene(
    name="Wedge at 2.86 m/s",
    foam=FOAM,
    impactor=Wedge(angle_deg=90, velocity=2.86, friction=0.13),
)

if __name__ == "__main__":
    from taichi_foam.cli import run_script

    run_script(scene)
