"""From the deformation gradient at a face to strain, and from stress to the face's force."""

import taichi as ti

vec2 = ti.types.vector(2, ti.f64)


@ti.func
def engineering_strain(along: vec2) -> ti.f64:
    """e = stretch - 1, from the gradient's column along the connection (Eqs 15b, 17)."""
    return along.norm() - 1.0


@ti.func
def shear_strain(along: vec2, across: vec2) -> ti.f64:
    """gamma = 2 E_12: the Green-Lagrange shear of the two columns of F (Eqs 12, 23)."""
    return along.dot(across)


@ti.func
def normal_traction(sigma_e: ti.f64, along: vec2) -> vec2:
    """Force per reference area of the normal stress: F S N with S_nn = sigma_e / stretch (Eq. 20)."""
    return along * (sigma_e / along.norm())


@ti.func
def shear_traction(tau: ti.f64, across: vec2) -> vec2:
    """Force per reference area of the shear stress S_12 = tau (Eqs 10-11 with Nanson's formula)."""
    return across * tau
