"""Prescribed motion: the pulse that shakes the base.

Everything is computed in the base's frame, in which the pulse acts on all moving masses like
additional gravity. The pulse at a stage is looked up once, at the end of the stage before it.
"""

from taichi_foam.backend import ti


@ti.func
def pulse_at(lattice: ti.template(), b, time: ti.f64, p: ti.template()) -> ti.f64:
    """Upward acceleration of the base [m/s2]: linear between points, 0 outside them."""
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
    """Upward acceleration of the base at the current stage [m/s2]."""
    found = 0.0
    if ti.static(lattice.features.shaken):
        found = lattice.scratch.shake[b]
    return found


@ti.func
def look_ahead(lattice: ti.template(), b, stage, step, p: ti.template()):
    """Look up the pulse of the next stage at the end of a stage."""
    if ti.static(lattice.features.shaken):
        ahead = ti.select(stage < 2, 0.5 * step, step)
        lattice.scratch.shake[b] = pulse_at(lattice, b, lattice.state.clock[b].time + ahead, p)
