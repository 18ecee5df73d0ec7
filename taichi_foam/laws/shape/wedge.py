"""A wedge as impactor."""

import math
from typing import ClassVar, Literal

import numpy as np
from pydantic import model_validator

from taichi_foam.laws.shape.base import Control, Impactor
from taichi_foam.parts import quantity


class Wedge(Impactor):
    """A symmetric wedge tip below a straight shank (paper, Fig. 4c)."""

    shape: Literal["wedge"] = "wedge"
    label: ClassVar[str] = "wedge"
    controls: ClassVar[tuple[Control, ...]] = (Control("angle_deg", "angle", 30, 160, 1, "°", 1.0),)
    angle_deg: float = quantity(
        90.0,
        "deg",
        "angle between the two faces",
        at_least=10,
        at_most=170,
        fix="angles are in degrees, between the two faces (the paper's wedge is 90)",
    )
    shank_width: float = quantity(0.05, "m", "width of the shank", at_least=1e-4, at_most=5)
    height: float = quantity(0.20, "m", "height from tip to top", at_least=1e-4, at_most=5)

    @model_validator(mode="after")
    def _check_height(self) -> "Wedge":
        if self.height <= self.tip_depth:
            raise ValueError(
                f"impactor.height = {self.height:g}: must be above {self.tip_depth:.4g} m, the "
                f"depth of a tip of {self.angle_deg:g} degrees and {self.shank_width:g} m width; "
                "raise it, or take a larger impactor.angle_deg"
            )
        return self

    @property
    def tip_depth(self) -> float:
        """Depth of the tip [m]: half the width over the tangent of half the angle."""
        # tan(45 degrees) falls one bit short of 1 in floating point; the paper's tip is W/2 deep.
        slope = 1.0 if self.angle_deg == 90 else math.tan(math.radians(self.angle_deg / 2))
        return self.shank_width / 2 / slope

    @property
    def width(self) -> float:
        """Width of the shank [m]."""
        return self.shank_width

    def corners(self) -> np.ndarray:
        """Return the five vertices [m], tip first; see the base class."""
        x, shoulder, top = self.shank_width / 2, self.tip_depth, self.height
        return np.array([[0.0, 0.0], [x, shoulder], [x, top], [-x, top], [-x, shoulder]])
