"""From the deformation gradient at a face to strain.

A face's force per reference area is F S N (Eqs 10-11 with Nanson's formula): its normal stress acts
along the gradient's column along the bond, its shear stress along the column across it.
Arguments may be scalars, or vectors with one component per bond.
"""

from taichi_foam.backend import ti


@ti.func
def engineering_strain(stretch):
    """e = stretch - 1 (Eq. 15b)."""
    return stretch - 1.0


@ti.func
def shear_strain(along_x, along_y, across_x, across_y):
    """gamma = 2 E_12: the Green-Lagrange shear of the two columns of F (Eqs 12, 23)."""
    return along_x * across_x + along_y * across_y
