"""Distance to a circle, penalty, and the spring with a slider (Coulomb)."""

import functools
import math

import numpy as np
import pytest
import taichi as ti

from taichi_foam.laws import contact as law
from taichi_foam.scene import Cylinder

vec2, vec3 = ti.types.vector(2, ti.f64), ti.types.vector(3, ti.f64)

pytestmark = pytest.mark.usefixtures("taichi_runtime")


@functools.cache
def surface_of_one() -> ti.MatrixField:
    """One for all calls: kernels are compiled for a field."""
    return ti.Vector.field(3, ti.f64, (1, 1))


def circle(x: float, y: float, radius: float) -> np.ndarray:
    surface = surface_of_one()
    surface[0, 0] = Cylinder(radius=radius).surface()[0]
    return _distance(surface, x, y)


@ti.kernel
def _distance(surface: ti.template(), x: ti.f64, y: ti.f64) -> vec3:
    return Cylinder.distance(surface, 0, 1, vec2(x, y))


@ti.kernel
def normal(stiffness: ti.f64, distance: ti.f64) -> ti.f64:
    return law.normal_force(stiffness, distance)


@ti.kernel
def tangential(stiffness: ti.f64, stretch: ti.f64, friction: ti.f64, force: ti.f64) -> ti.f64:
    return law.tangential_force(stiffness, stretch, friction, force)


@ti.kernel
def rubbing(dashpot: ti.f64, speed: ti.f64, friction: ti.f64, force: ti.f64) -> ti.f64:
    return law.rubbing_force(dashpot, speed, friction, force)


@pytest.mark.parametrize("angle", np.linspace(0.0, 2 * math.pi, 9))
@pytest.mark.parametrize("depth", [-0.004, 0.0, 0.01])
def test_a_circle_rests_on_the_origin(angle: float, depth: float) -> None:
    """A point made from its distance and direction comes back as these."""
    radius = 0.025
    n = np.array([math.cos(angle), math.sin(angle)])
    point = np.array([0.0, radius]) + (radius + depth) * n
    found = circle(point[0], point[1], radius)
    assert found[0] == pytest.approx(depth, abs=1e-16)
    np.testing.assert_allclose([found[1], found[2]], n, atol=1e-14)


def test_the_very_centre_has_a_normal_too() -> None:
    found = circle(0.0, 0.025, 0.025)
    assert found[0] == -0.025
    assert math.hypot(found[1], found[2]) == 1.0


def test_the_penalty_pushes_inside_and_never_pulls() -> None:
    assert normal(3e5, -2e-4) == pytest.approx(60.0)
    assert normal(3e5, 0.0) == 0.0
    assert normal(3e5, 2e-4) == 0.0


def test_the_slider_sticks_up_to_mu_n_and_then_gives_exactly_that() -> None:
    """Spring 1 MN/m, limit 0.3 * 10 N = 3 N: it sticks up to 3 um, to either side."""
    for sign in (-1, 1):
        assert tangential(1e6, sign * 2.9e-6, 0.3, 10.0) == pytest.approx(-sign * 2.9)
        assert tangential(1e6, sign * 3.1e-6, 0.3, 10.0) == pytest.approx(-sign * 3.0, rel=1e-15)
        assert tangential(1e6, sign * 1.0, 0.3, 10.0) == pytest.approx(-sign * 3.0, rel=1e-15)
    assert tangential(1e6, 1.0, 0.0, 10.0) == 0.0
    assert tangential(1e6, 1.0, 0.3, 0.0) == 0.0


def test_what_rubs_is_dragged_by_a_dashpot_and_by_mu_n_at_most() -> None:
    """Dashpot 2 N s/m, limit 0.3 * 10 N = 3 N: it is reached at 1.5 m/s, against the speed."""
    for sign in (-1, 1):
        assert rubbing(2.0, sign * 1.4, 0.3, 10.0) == pytest.approx(-sign * 2.8, rel=1e-15)
        assert rubbing(2.0, sign * 1.6, 0.3, 10.0) == pytest.approx(-sign * 3.0, rel=1e-15)
        assert rubbing(2.0, sign * 50.0, 0.3, 10.0) == pytest.approx(-sign * 3.0, rel=1e-15)
    assert rubbing(2.0, 1.0, 0.0, 10.0) == 0.0
    assert rubbing(2.0, 1.0, 0.3, 0.0) == 0.0
