"""A square box lands on its corner (not in the paper).

Physics: a rigid square of 50 mm and 6 kg, tilted by 30 degrees, drops at 3 m/s without turning.
Its lowest corner goes in first, off its middle, and its two lower faces slope differently: the
flat one presses the foam down, the steep one shears it and pushes it aside. It is the packaging
designer's case: a box rarely lands flat.

Measured: nothing to compare with. While the corner goes in, the contact's width grows linearly
with depth; the whole width, 68 mm, is in after 43 mm.

Run time: some seconds on one core.
"""

from taichi_foam.scene import Polygon, Scene

SIDE = 0.05  # m

scene = Scene(
    name="Corner drop",
    impactor=Polygon(
        vertices=((0.0, 0.0), (SIDE, 0.0), (SIDE, SIDE), (0.0, SIDE)),
        rotation_deg=30.0,
        velocity=3.0,
    ),
)

if __name__ == "__main__":
    from taichi_foam.cli import run_script

    run_script(scene)
