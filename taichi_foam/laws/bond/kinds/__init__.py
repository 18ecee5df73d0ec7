"""The package's bond laws: a file for each, and its name here, in the order of tables."""

from taichi_foam.laws.bond.kinds.crushable import Foam
from taichi_foam.laws.bond.kinds.recovering import RecoveringFoam
from taichi_foam.laws.bond.kinds.tabulated import TabulatedFoam

__all__ = ["Foam", "TabulatedFoam", "RecoveringFoam"]  # noqa: RUF022
