"""Where a mass point stands to a rigid body, and the force between them.

Bodies translate only. Normal force by penalty, tangential force by a spring with a Coulomb slider
(Cundall & Strack 1979, Geotechnique 29:47), which sticks without creep.
"""

import taichi as ti

vec2 = ti.types.vector(2, ti.f64)
vec3 = ti.types.vector(3, ti.f64)


@ti.func
def circle_distance(point: vec2, radius: ti.f64) -> vec3:
    """Signed distance [m] to a circle that rests on the origin, and the outward normal there."""
    away = point - vec2(0.0, radius)
    length = away.norm()
    normal = vec2(0.0, -1.0)
    if length > 0.0:
        normal = away / length
    return vec3(length - radius, normal.x, normal.y)


@ti.func
def normal_force(stiffness: ti.f64, distance: ti.f64) -> ti.f64:
    """Penalty force [N], never pulling, for a signed distance [m], negative inside."""
    return stiffness * ti.max(-distance, 0.0)


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
