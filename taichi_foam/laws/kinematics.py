"""From the deformation gradient at a face to strain.

A face's force per reference area is F S N (Eqs 10-11 with Nanson's formula): its normal stress acts
along the gradient's column along the connection, its shear stress along the column across it.
"""

import taichi as ti

vec2 = ti.types.vector(2, ti.f64)


@ti.func
def engineering_strain(stretch: ti.f64) -> ti.f64:
    """e = stretch - 1 (Eq. 15b)."""
    return stretch - 1.0


@ti.func
def shear_strain(along: vec2, across: vec2) -> ti.f64:
    """gamma = 2 E_12: the Green-Lagrange shear of the two columns of F (Eqs 12, 23)."""
    return along.dot(across)
