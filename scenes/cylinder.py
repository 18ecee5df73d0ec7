"""A cylinder sinks into foam and tears it (Shim, Tu & Lim 2000, Fig. 24).

Physics: a rigid cylinder, 6 kg and 50 mm in diameter, drops at 3.32 m/s. The contact grows with
depth, so the deceleration rises smoothly until half the cylinder is in. The foam crushes in the
cylinder's path, most of all right below it, and tears along its flanks. In the test a vertical
crack ran down from below the cylinder and split the block; here cracks start at the flanks, and
only some of the runs with slightly different velocities split.

Measured (Table 3): duration 53 ms, displacement 90 mm, plateau 65 m/s2.

Run time: some seconds on one core.
"""

from taichi_foam.scene import Cylinder, Scene

scene = Scene(name="Cylinder at 3.32 m/s", impactor=Cylinder(radius=0.025, velocity=3.32))

if __name__ == "__main__":
    from taichi_foam.cli import run_script

    run_script(scene)
