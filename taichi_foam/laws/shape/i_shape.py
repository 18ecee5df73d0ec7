"""An I-shape as impactor."""

from typing import ClassVar, Literal

import numpy as np
from pydantic import model_validator

from taichi_foam.laws.shape.base import Control
from taichi_foam.laws.shape.edges import Edged
from taichi_foam.parts import quantity


class IShape(Edged):
    """Two flanges, level before any turn, on a web between their middles."""

    shape: Literal["i-shape"] = "i-shape"
    label: ClassVar[str] = "I-shape"
    controls: ClassVar[tuple[Control, ...]] = (Control("width", "width", 10, 150, 1, "mm", 1e-3),)
    width: float = quantity(0.05, "m", "width of the flanges", at_least=1e-4, at_most=5)
    height: float = quantity(0.10, "m", "height over both flanges", at_least=1e-4, at_most=5)
    flange: float = quantity(0.01, "m", "thickness of a flange", at_least=1e-5, at_most=5)
    web: float = quantity(0.008, "m", "thickness of the web", at_least=1e-5, at_most=5)

    @model_validator(mode="after")
    def _check_web(self) -> "IShape":
        problems = []
        if self.web >= self.width:
            problems.append(
                f"impactor.web = {self.web:g}: must be below impactor.width = {self.width:g} m, "
                "that of the flanges; take shape = 'flat' for a plain block"
            )
        if 2 * self.flange >= self.height:
            problems.append(
                f"impactor.flange = {self.flange:g}: two flanges must be less than "
                f"impactor.height = {self.height:g} m; make them thinner"
            )
        if problems:
            raise ValueError("\n".join(problems))
        return self

    def corners(self) -> np.ndarray:
        """Return the twelve vertices about the middle [m]; see the base class."""
        x, y = self.width / 2, self.height / 2
        inner, under = self.web / 2, y - self.flange
        right = [[x, -y], [x, -under], [inner, -under], [inner, under], [x, under], [x, y]]
        left = [[-across, up] for across, up in right[::-1]]
        return np.array(right + left)
