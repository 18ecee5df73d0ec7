"""What a picture shows and in which tones: the choices that all renderers share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from taichi_foam.errors import UserError
from taichi_foam.picture.colours import THEMES, Theme
from taichi_foam.picture.modes import MODES, Mode

if TYPE_CHECKING:
    from taichi_foam.scene import Scene


@dataclass(frozen=True)
class Look:
    """How pictures are drawn.

    mode   key of `modes.MODES`: what the colours show
    theme  key of `colours.THEMES`
    grid   draw the grid of the foam as it is deformed
    words  draw title, figures and key beside the field; without, the field fills the picture

    Raises UserError for a name that there is not.
    """

    mode: str = "worst-strain"
    theme: str = "light"
    grid: bool = True
    words: bool = True

    def __post_init__(self) -> None:
        for name, given, known in (("mode", self.mode, MODES), ("theme", self.theme, THEMES)):
            if given not in known:
                raise UserError(f"{name} = {given!r}: must be one of {', '.join(known)}")

    @classmethod
    def of(cls, scene: Scene) -> Look:
        """What the scene itself asks for."""
        return cls(scene.output.mode, scene.output.theme)

    @property
    def tones(self) -> Theme:
        """The theme's tones."""
        return THEMES[self.theme]

    @property
    def shown(self) -> Mode:
        """What the colours show."""
        return MODES[self.mode]
