"""Forces between a mass point and a rigid body, and friction between pieces.

Normal force by penalty, tangential force by a spring with a Coulomb slider
(Cundall & Strack 1979, Geotechnique 29:47), which sticks without creep.
"""

from taichi_foam.backend import ti


@ti.func
def normal_force(stiffness: ti.f64, distance: ti.f64) -> ti.f64:
    """Penalty force [N], never tensile, for a signed distance [m], negative inside."""
    return stiffness * ti.max(-distance, 0.0)


@ti.func
def damped_force(spring: ti.f64, dashpot: ti.f64, parting: ti.f64) -> ti.f64:
    """Force [N] of a contact's spring and its parallel dashpot, never tensile.

    `parting` is the speed of separation [m/s], negative on approach.
    """
    return ti.max(spring - dashpot * parting, 0.0)


@ti.func
def tangential_force(
    stiffness: ti.f64, stretch: ti.f64, friction: ti.f64, normal: ti.f64
) -> ti.f64:
    """Force [N] along the tangent against the tangential stretch [m]: spring up to mu N."""
    limit = friction * normal
    return -ti.math.clamp(stiffness * stretch, -limit, limit)


@ti.func
def rubbing_force(dashpot: ti.f64, speed: ti.f64, friction: ti.f64, normal: ti.f64) -> ti.f64:
    """Force [N] along the tangent against the tangential speed [m/s]: dashpot up to mu N."""
    limit = friction * normal
    return -ti.math.clamp(dashpot * speed, -limit, limit)
