"""Functions that Taichi translates several times, from one syntax tree (`taichi_foam.backend`)."""

import numpy as np

from taichi_foam.backend import ti


@ti.func
def factorial(n: ti.template()):
    product = 1
    if ti.static(n > 1):
        product = n * factorial(n - 1)
    return product


@ti.data_oriented
class Doubled:
    """Has a method with the name of a vector's."""

    @ti.func
    def sum(self):
        return 2.0


@ti.func
def summed(values: ti.template()):
    return values.sum()


@ti.kernel
def compute(found: ti.types.ndarray(), doubled: ti.template()):
    for _ in range(1):
        found[0] = factorial(5) + factorial(3)
        found[1] = summed(ti.Vector([1.0, 2.0]))
        found[2] = summed(doubled)
        found[3] = summed(ti.Vector([3.0, 4.0, 5.0]))


def test_calls_of_a_function_leave_nothing_to_each_other() -> None:
    """One that calls itself, and one whose argument is a vector or has a method of its own."""
    found = np.zeros(4)
    compute(found, Doubled())
    assert found.tolist() == [126.0, 3.0, 2.0, 12.0]
