"""A rectangular block as impactor."""

from typing import ClassVar, Literal

import numpy as np

from taichi_foam.laws.shape.base import Control, Impactor
from taichi_foam.parts import quantity


class FlatBlock(Impactor):
    """A rectangular block, face down or tilted (paper, Fig. 4a)."""

    shape: Literal["flat"] = "flat"
    label: ClassVar[str] = "flat block"
    controls: ClassVar[tuple[Control, ...]] = (Control("width", "width", 10, 150, 1, "mm", 1e-3),)
    width: float = quantity(
        0.05, "m", "width of the face, before turning", at_least=1e-4, at_most=5
    )
    height: float = quantity(0.10, "m", "height", at_least=1e-4, at_most=5)

    def corners(self) -> np.ndarray:
        """Return the four vertices about the middle [m]; see the base class."""
        x, y = self.width / 2, self.height / 2
        return np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
