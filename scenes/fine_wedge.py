"""The wedge's impact with twenty-five times as many cells: 200 x 100 of 1 mm.

Physics: the block, the impactor and the foam of `wedge.py`, cut into cells of a fifth the length.
What a crack costs, in J/m2, and what a row of cells has as dashpot are properties of the foam, so
that nothing is scaled: bonds of finer cells soften over a longer way.

Measured (Table 4): duration 49 ms, displacement 75 mm, plateau 66 m/s2. Computed: foam crushes in
a thin layer along both faces, and a crack runs ahead of the tip. The wedge is met with some per
cent more resistance than in cells of 5 mm (docs/fidelity.md has how answers move with the cell).

Run time: 20,000 cells, some minutes on two cores.
"""

from taichi_foam.choices import PAPERS_FOAM
from taichi_foam.scene import Block, Foam, Output, Scene, Wedge

scene = Scene(
    name="Wedge at 2.86 m/s, 20,000 cells",
    block=Block(cell=0.001),
    foam=Foam(**PAPERS_FOAM),
    impactor=Wedge(angle_deg=90, velocity=2.86, friction=0.13),
    output=Output(snapshot_interval=2e-3),
)

if __name__ == "__main__":
    from taichi_foam.cli import run_script

    run_script(scene)
