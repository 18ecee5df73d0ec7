"""The live window: a drop on a desk, in a window that SDL opens (through pygame)."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable
from pathlib import Path

from PIL import Image

from taichi_foam.errors import UserError, installed
from taichi_foam.live.overlay import panel
from taichi_foam.live.stage import FPS, PACE, Keep, Stage
from taichi_foam.picture import raster
from taichi_foam.results.folders import whole_file
from taichi_foam.scene import Scene

#: What the keys do, as the help says it.
HELP = (
    ("Space", "pause, go on"),
    ("→", "a single step"),
    ("−  +", "slower, faster"),
    ("R", "drop again"),
    ("↑  ↓", "impactor faster, slower by 0.1 m/s; drops again"),
    ("I", "next impactor shape; drops again"),
    ("M", "next colours (Shift: back)"),
    ("G  C  T", "grid, curve, light or dark"),
    ("S", "save a screenshot"),
    ("H", "this help"),
    ("Q  Esc", "close; results so far are kept"),
)
_HINT = "H help"
SIZE = (1280, 720)


def check_display() -> None:
    """Raise UserError where no window can be opened; the page is the way then."""
    is_windowless = sys.platform.startswith("linux") and not any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")
    )
    if is_windowless:
        raise UserError(_no_window("neither DISPLAY nor WAYLAND_DISPLAY is set"))


def _no_window(why: str) -> str:
    return (
        f"no window can be opened ({why}); watch it in a browser instead: taichi-foam serve SCENE, "
        "over SSH with a tunnel: ssh -L 8000:localhost:8000 HOST"
    )


def watch(
    scene: Scene,
    keep: Keep,
    *,
    size: tuple[int, int] = SIZE,
    arch: str = "cpu",
    threads: int | None = None,
    pace: float | None = PACE,
    shots: Path = Path("shots"),
) -> Stage:
    """Open a window on a drop of `scene`, until it is closed.

    Args:
        scene: what is dropped first.
        keep: gets the result of each drop that comes to its end, and of the last as it is.
        size: of the window at first [pixels].
        arch, threads: as for `runtime.start`; of the process that computes.
        pace: simulated seconds in one of watching at first; None: as fast as it goes.
        shots: folder for screenshots; made when it is needed.

    Returns:
        The stage, its run ended: `was_cut`, `failures`, and what could not be kept.

    Raises:
        UserError: no display, or an arch that cannot be had.
    """
    check_display()
    window = _Window(size, shots)
    try:
        with Stage(scene, keep, arch=arch, threads=threads, pace=pace) as stage:
            with contextlib.suppress(KeyboardInterrupt):  # Ctrl-C closes it, too
                window.show(stage)
            window.say_goodbye()
            with contextlib.suppress(KeyboardInterrupt):
                stage.finish()
            return stage
    finally:
        window.close()


class _Window:
    """A resizable window, what its keys do, and its pictures."""

    def __init__(self, size: tuple[int, int], shots: Path) -> None:
        # pygame greets on stdout when it is imported
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        with installed("a live window", "taichi-foam[live]"):
            import pygame

        self._pygame = pygame
        try:
            pygame.display.init()
            self._surface = pygame.display.set_mode(size, pygame.RESIZABLE)
        except pygame.error as error:
            raise UserError(_no_window(str(error))) from None
        driver = pygame.display.get_driver()
        if driver in ("offscreen", "dummy") and "SDL_VIDEODRIVER" not in os.environ:
            pygame.quit()  # what SDL falls back on where a display does not answer
            display = os.environ.get("DISPLAY", "")
            raise UserError(_no_window(f"the display {display!r} does not answer"))
        pygame.key.set_repeat(400, 80)
        self._clock = pygame.time.Clock()
        self._shots = shots
        self._has_help = False
        self._held: set[int] = set()  # keys that are down
        self._told = ""  # instead of the hint: where a screenshot went
        k = pygame
        self._keys: dict[int, Callable[[Stage], object]] = {
            k.K_SPACE: Stage.toggle_pause,
            k.K_RIGHT: Stage.step,
            k.K_PERIOD: Stage.step,
            k.K_MINUS: lambda stage: stage.change_pace(-1),
            k.K_KP_MINUS: lambda stage: stage.change_pace(-1),
            k.K_PLUS: lambda stage: stage.change_pace(1),
            k.K_EQUALS: lambda stage: stage.change_pace(1),
            k.K_KP_PLUS: lambda stage: stage.change_pace(1),
            k.K_r: Stage.again,
            k.K_UP: lambda stage: stage.change_velocity(1),
            k.K_DOWN: lambda stage: stage.change_velocity(-1),
            k.K_i: Stage.next_shape,
            k.K_g: Stage.toggle_grid,
            k.K_c: Stage.toggle_curve,
            k.K_t: Stage.next_theme,
            k.K_m: self._next_mode,
            k.K_s: self._save_screenshot,
            k.K_h: self._toggle_help,
            k.K_F1: self._toggle_help,
        }
        self._repeated = {
            k.K_RIGHT, k.K_PERIOD, k.K_UP, k.K_DOWN,
            k.K_MINUS, k.K_KP_MINUS, k.K_PLUS, k.K_EQUALS, k.K_KP_PLUS,
        }  # fmt: skip

    def close(self) -> None:
        self._pygame.quit()

    def say_goodbye(self) -> None:
        """Show that it closes: what is saved may take its time."""
        self._pygame.display.set_caption("closing · taichi_foam")
        self._pygame.display.flip()

    def show(self, stage: Stage) -> None:
        """Draw and obey until the window is closed."""
        while True:
            is_stale = stage.update(0.5 / FPS)
            for event in self._pygame.event.get():
                if self._is_goodbye(event):
                    return
                is_stale |= self._obey(event, stage)
            if is_stale:
                self._draw(stage)
            self._clock.tick(FPS)

    def _is_goodbye(self, event) -> bool:
        pygame = self._pygame
        is_key = event.type == pygame.KEYDOWN and event.key in (pygame.K_q, pygame.K_ESCAPE)
        return event.type == pygame.QUIT or is_key

    def _obey(self, event, stage: Stage) -> bool:
        """Do what an event asks for; whether the picture changes by it."""
        pygame = self._pygame
        if event.type == pygame.KEYUP:
            self._held.discard(event.key)
        if event.type == pygame.KEYDOWN and event.key in self._keys:
            is_again = event.key in self._held
            self._held.add(event.key)
            if is_again and event.key not in self._repeated:
                return False
            self._told = ""
            stage.dismiss()
            self._keys[event.key](stage)
            return True
        return event.type in (pygame.VIDEORESIZE, pygame.VIDEOEXPOSE)

    def _draw(self, stage: Stage) -> None:
        pygame = self._pygame
        picture = self._picture(stage)
        height, width = picture.shape[:2]
        self._surface.blit(
            pygame.image.frombuffer(picture.tobytes(), (width, height), "RGB"), (0, 0)
        )
        pygame.display.flip()
        pygame.display.set_caption(f"{stage.scene.name} · taichi_foam")

    def _picture(self, stage: Stage):
        picture = stage.picture(self._size(), self._told or _HINT)
        if self._has_help:
            panel(picture, HELP, stage.look.theme)
        return picture

    def _size(self) -> tuple[int, int]:
        """Of the picture: a window can be made smaller than a picture may be."""
        width, height = self._surface.get_size()
        return max(width, raster.SMALLEST[0]), max(height, raster.SMALLEST[1])

    def _next_mode(self, stage: Stage) -> None:
        is_back = self._pygame.key.get_mods() & self._pygame.KMOD_SHIFT
        stage.next_mode(-1 if is_back else 1)

    def _toggle_help(self, stage: Stage) -> None:
        self._has_help = not self._has_help

    def _save_screenshot(self, stage: Stage) -> None:
        picture = stage.picture(self._size())
        try:
            self._shots.mkdir(parents=True, exist_ok=True)
            names = (path.stem.removeprefix("shot-") for path in self._shots.glob("shot-*.png"))
            last = max((int(name) for name in names if name.isdecimal()), default=0)
            path = self._shots / f"shot-{last + 1:03d}.png"
            with whole_file(path) as partial:
                Image.fromarray(picture).save(partial)
        except OSError as error:
            self._told = f"no screenshot: {error.strerror or error}"
        else:
            self._told = f"saved {path}"
