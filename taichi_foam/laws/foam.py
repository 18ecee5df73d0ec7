"""The foam: loading curve, unloading, weak re-tension, shear, and failure (Eq. 26, Figs 19-20).

A bond remembers one number, e_min, the most compressive strain that it has met, and whether
it is broken. Every function takes that history as frozen. Foam that heeds the rate lags behind: its
e_min follows the strain by a flow rule, and how far it lags is the stress beyond the static one.

What a stage of the Runge-Kutta method needs has no branches on values: strains, histories and what
is broken may be numbers or vectors of them, one for each of several bonds.
"""

import taichi as ti

from taichi_foam.laws import elementary

vec2 = ti.types.vector(2, ti.f64)

# How a broken bond takes compression up again (Model.broken_contact).
RELOAD = 0
JUMP = 1

# When shear may break a bond (Model.shear_failure).
TENSION_ONLY = 0
ALWAYS = 1
PRESSURE_DEPENDENT = 2
ANGLE = 3

# The densification law is singular at the locking strain. Within this part of the way from
# locking back to densification it goes on as its tangent, so that a trial stage that oversteps
# still meets a finite, rising stress. For Table 6's constants that stress is 1.9 GPa, far above any
# that a run reaches.
GUARD = 0.05

# Slope of packed pieces beyond the densification strain, in Young's moduli.
PACKED = 4.0


@ti.dataclass
class Foam:
    """Constants of one foam: strains without unit, stresses in Pa."""

    youngs_modulus: ti.f64
    shear_modulus: ti.f64
    yield_strain: ti.f64
    tensile_strain: ti.f64
    shear_failure_strain: ti.f64
    densification_strain: ti.f64
    locking_strain: ti.f64
    densification_a: ti.f64
    densification_b: ti.f64
    crushed_tensile_strain: ti.f64
    crushed_tensile_stress: ti.f64
    crushed_strength: ti.f64  # in tension when crushed across, over that of whole foam
    broken_contact: ti.i32
    shear_failure: ti.i32
    shear_pressure_coefficient: ti.f64
    rate: ti.f64  # D of Cowper & Symonds [1/s], or 0: the foam does not heed the rate
    rate_exponent: ti.f64


@ti.func
def _densified(foam: Foam, e):
    """Stress of the densification branch and its slope (Eq. 26c, both brackets positive).

    For e < e_d; beyond the guard strain it goes on as the tangent there.
    """
    guard = foam.locking_strain + GUARD * (foam.densification_strain - foam.locking_strain)
    inside = elementary.larger(e, guard)
    room = inside - foam.locking_strain
    power = room
    if foam.densification_b != 1.0:  # a power costs as much as the exponential
        power = elementary.power(room, foam.densification_b)
    steepness = foam.densification_a / power
    exponent = steepness * (foam.densification_strain - inside)
    stress = foam.youngs_modulus * foam.yield_strain * elementary.exp(exponent)
    slope = -stress * (steepness + foam.densification_b * exponent / room)
    return stress + slope * (e - inside), slope


@ti.func
def permanent_strain(foam: Foam, e_min):
    """Strain at which a bond that has met `e_min` is without stress.

    It unloads from the plateau with the slope K; densification retraces itself, so that the
    turning point is never beyond e_d.
    """
    turn = elementary.larger(e_min, foam.densification_strain)
    turn = elementary.smaller(turn, foam.yield_strain)
    return turn - foam.yield_strain


@ti.func
def flowed_strain(foam: Foam, e, e_min, time):
    """The e_min of rate-sensitive foam that has been at strain `e` for `time` [s].

    In flow at the rate r the plateau's stress is K e_y (1 + (r / D)^(1/q)) (Cowper & Symonds 1957,
    as Perzyna's overstress): while e_min is short of e by y, its rate is D (y / |e_y|)^q. At a
    constant strain that has a closed form, whatever the time.
    """
    elastic = elementary.larger(e, foam.yield_strain)
    start = elementary.smaller(elastic, e_min)
    short = elementary.larger(start - e, 0.0)
    times = foam.rate * time / -foam.yield_strain
    left = short * elementary.exp(-times)
    if foam.rate_exponent > 1.0:
        power = foam.rate_exponent - 1.0
        # a power's base must be above 0, and what is so little short does not flow in any time
        share = elementary.larger(short / -foam.yield_strain, 1e-30)
        slowed = 1.0 + power * times * elementary.power(share, power)
        left = short * elementary.power(slowed, -1.0 / power)
    return start - (short - left)


@ti.func
def elastic_strain(foam: Foam, e, e_min):
    """What of a compressive strain unloading gives back, as if the plateau went on for ever.

    At most the yield strain, but for what e_min is short of e: rate-sensitive foam only.
    """
    strain = elementary.larger(e - permanent_strain(foam, e_min), foam.yield_strain)
    if foam.rate > 0.0:
        flows_from = elementary.smaller(e_min, foam.yield_strain)
        strain += elementary.smaller(e - flows_from, 0.0)
    return strain


@ti.func
def yielding_fraction(foam: Foam, e, e_min, broken):
    """The stress of `normal_stress`, were the plateau to go on for ever, as (numerator, divisor).

    The divisor is positive. Who divides by a length besides needs only one division so.
    """
    permanent = permanent_strain(foam, e_min)
    stretch = e - permanent
    elastic = foam.youngs_modulus * elastic_strain(foam, e, e_min)
    crushed = e_min < foam.yield_strain
    weak = ti.select(crushed, foam.crushed_tensile_stress * stretch, elastic)
    reach = ti.select(crushed, foam.crushed_tensile_strain - permanent, 1.0)
    numerator = ti.select(stretch > 0.0, weak, elastic)
    divisor = ti.select(stretch > 0.0, reach, 1.0)
    kept = elementary.smaller(numerator, 0.0)
    if foam.broken_contact == JUMP:
        kept = ti.select(e > e_min, 0.0, kept)
    return ti.select(broken, kept, numerator), divisor


@ti.func
def densification(foam: Foam, e, e_min, broken):
    """What densification adds to the yielding stress, and the slope there [Pa]; 0 above e_d."""
    stress, slope = _densified(foam, elementary.smaller(e, foam.densification_strain))
    acts = e < foam.densification_strain
    if foam.broken_contact == JUMP:
        acts = ti.select(broken, acts & (e <= e_min), acts)
    added = stress - foam.youngs_modulus * foam.yield_strain
    return ti.select(acts, added, 0.0), ti.select(acts, slope, 0.0)


@ti.func
def normal_stress(foam: Foam, e, e_min, broken):
    """Engineering stress at strain `e` with history `e_min`, intact or broken (Fig. 19)."""
    added, _ = densification(foam, e, e_min, broken)
    numerator, divisor = yielding_fraction(foam, e, e_min, broken)
    return numerator / divisor + added


@ti.func
def stored_energy(foam: Foam, e: ti.f64, e_min: ti.f64, broken: ti.i32) -> ti.f64:
    """Energy per reference volume [J/m3] that unloading from `e` to zero stress gives back.

    Under the jump reading a broken bond gives nothing back: its stress drops at once.
    """
    permanent = permanent_strain(foam, e_min)
    energy = 0.0
    if e > permanent:
        if not broken:
            numerator, divisor = yielding_fraction(foam, e, e_min, broken)
            energy = 0.5 * (e - permanent) * numerator / divisor
    elif not (broken and foam.broken_contact == JUMP):
        energy = 0.5 * foam.youngs_modulus * elastic_strain(foam, e, e_min) ** 2
        if e < foam.densification_strain:
            energy += _densified_energy(foam, e)
            if foam.rate > 0.0:
                # over what e_min is short of e here, the overstress's part holds the plateau too
                short = ti.max(ti.min(e_min, foam.densification_strain) - e, 0.0)
                energy += foam.youngs_modulus * foam.yield_strain * short
    return energy


@ti.func
def _densified_energy(foam: Foam, e: ti.f64) -> ti.f64:
    """Area under the densification branch between `e` and e_d [J/m3], by Simpson's rule.

    It is an exponential integral without a closed form for every b. Taken over the logarithm of
    e - e_l, 32 intervals are good to 1e-5 of it down to 0.93 of crush for Table 6's constants.
    """
    intervals = 32
    room = foam.densification_strain - foam.locking_strain
    ratio = ti.max(e - foam.locking_strain, GUARD * room) / room
    width = -elementary.log(ratio) / intervals
    area = 0.0
    for k in range(intervals + 1):
        weight = 2.0 + 2.0 * (k % 2)
        if k == 0 or k == intervals:
            weight = 1.0
        here = room * elementary.exp(-k * width)
        stress, _ = _densified(foam, foam.locking_strain + here)
        area += weight * here * stress
    return -area * width / 3.0


@ti.func
def elastic_modulus(foam: Foam) -> ti.f64:
    """The steepest d(sigma_e)/de before densification [Pa]: elastic, or in re-tension."""
    return ti.max(foam.youngs_modulus, foam.crushed_tensile_stress / foam.crushed_tensile_strain)


@ti.func
def shear_stress(foam: Foam, gamma):
    """tau = G gamma (Eq. 25)."""
    return foam.shear_modulus * gamma


@ti.func
def piece_stress(foam: Foam, gap: ti.f64, touch: ti.f64, length: ti.f64) -> ti.f64:
    """Stress between two pieces at a distance `gap` that touch at `touch`, for cells of `length`.

    They are foam: elastic, then a plateau. Packed to the densification strain they stiffen, by a
    fixed slope instead of Eq. 26c: the step size is then independent of powder.
    """
    packed = ti.min(gap - (1.0 + foam.densification_strain) * touch, 0.0) / length
    return foam.youngs_modulus * (
        ti.max((gap - touch) / length, foam.yield_strain) + PACKED * packed
    )


@ti.func
def energy_lost_by_breaking(foam: Foam, e: ti.f64, e_min: ti.f64) -> ti.f64:
    """Stored energy per reference volume [J/m3] that a bond can no longer give back.

    Reloading keeps what is stored in compression; the jump reading keeps nothing.
    """
    lost = stored_energy(foam, e, e_min, 0)
    if foam.broken_contact == RELOAD and e <= permanent_strain(foam, e_min):
        lost = 0.0
    return lost


@ti.func
def tensile_strength_left(foam: Foam, e_min):
    """Tensile strength of foam that has been crushed across to `e_min`, over that of whole foam.

    It falls in proportion to the crush, from yield to densification, where the foam is powder.
    """
    crush = (e_min - foam.yield_strain) / (foam.densification_strain - foam.yield_strain)
    crush = elementary.smaller(elementary.larger(crush, 0.0), 1.0)
    return 1.0 - (1.0 - foam.crushed_strength) * crush


@ti.func
def tensile_limit(foam: Foam, e_min):
    """Strain at which a bond breaks in tension: less for crushed foam (Section 4.5)."""
    return ti.select(e_min < foam.yield_strain, foam.crushed_tensile_strain, foam.tensile_strain)


@ti.func
def shear_strength(foam: Foam, e, sigma_e, size):
    """Shear stress at which a bond breaks [Pa], by the chosen reading of compression.

    `size` is the product of the lengths of F's two columns at the bond: the shear strain is
    this times the sine of the angle through which its foam has sheared.
    """
    pulled = foam.shear_modulus * foam.shear_failure_strain
    pressed = pulled + 0.0 * sigma_e
    if foam.shear_failure == TENSION_ONLY:
        pressed += ti.math.inf
    elif foam.shear_failure == PRESSURE_DEPENDENT:
        pressed += foam.shear_pressure_coefficient * ti.abs(sigma_e)
    elif foam.shear_failure == ANGLE:
        pressed *= size
    return ti.select(e < 0.0, pressed, pulled)


@ti.func
def fails(foam: Foam, e, sigma_e, tau, e_min, size, tensile, strength):
    """Whether an intact bond in this state breaks, in tension or in shear (Section 4.6).

    `tensile` is what the bond's own strength in tension is over the mean of whole ones, and
    `strength` that in shear; `size` as in `shear_strength`.
    """
    in_tension = e > tensile * tensile_limit(foam, e_min)
    return in_tension | (ti.abs(tau) > strength * shear_strength(foam, e, sigma_e, size))
