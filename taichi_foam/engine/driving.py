"""What moves by command: the pulse that shakes the base.

All is told in the base's frame, in which everything that moves feels the pulse as so much more
gravity. The pulse of a stage is looked up once, when the stage before it ends.
"""

from taichi_foam.backend import ti


@ti.func
def pulse_at(lattice: ti.template(), b, time: ti.f64, p: ti.template()) -> ti.f64:
    """Upward acceleration of the base [m/s2]: straight lines between points, 0 beyond them."""
    pulse = ti.static(lattice.model.pulse)
    found = 0.0
    first, last = 0, ti.cast(p.pulse_points, ti.i32) - 1
    if pulse[b, first].x <= time and time <= pulse[b, last].x:
        while last - first > 1:
            middle = ti.raw_div(first + last, 2)
            if pulse[b, middle].x <= time:
                first = middle
            else:
                last = middle
        before, after = pulse[b, first], pulse[b, last]
        share = (time - before.x) / (after.x - before.x)
        found = before.y + share * (after.y - before.y)
    return found


@ti.func
def shake(lattice: ti.template(), b) -> ti.f64:
    """That of the stage which is computed now."""
    found = 0.0
    if ti.static(lattice.features.shaken):
        found = lattice.scratch.shake[b]
    return found


@ti.func
def look_ahead(lattice: ti.template(), b, stage, step, p: ti.template()):
    """At the end of a stage: the pulse of the next. Two stages are at half of the step."""
    if ti.static(lattice.features.shaken):
        ahead = ti.select(stage < 2, 0.5 * step, step)
        lattice.scratch.shake[b] = pulse_at(lattice, b, lattice.state.clock[b].time + ahead, p)
