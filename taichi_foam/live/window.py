"""The live window on a desktop, opened by SDL (through pygame)."""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path

from PIL import Image

from taichi_foam.errors import UserError, installed
from taichi_foam.live.screen import FPS, Screen, panel
from taichi_foam.live.session import Session
from taichi_foam.picture import raster
from taichi_foam.results.files import next_numbered, whole_file

#: Help text for the keys.
HELP = (
    ("Space", "pause, resume"),
    ("→", "a single step"),
    ("−  +", "slower, faster"),
    ("R", "drop again"),
    ("↑  ↓", "impactor faster or slower by 0.1 m/s; drops again"),
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
    """Raise UserError if no window can be opened; the message recommends the page."""
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


def show(session: Session, size: tuple[int, int] = SIZE, shots: Path = Path("shots")) -> None:
    """Open a window that shows a session's drops, and finish the last one when it is closed.

    Args:
        size: initial size of the window [pixels].
        shots: folder for screenshots; created when needed.

    Raises:
        UserError: no display, or the arch is not available.
    """
    check_display()
    window = _Window(Screen(session), size, shots)
    try:
        with session:
            with contextlib.suppress(KeyboardInterrupt):  # Ctrl-C also closes it
                window.run()
            window.announce_closing()
            with contextlib.suppress(KeyboardInterrupt):
                session.finish()
    finally:
        window.close()


class _Window:
    """A resizable window: its keys and its pictures."""

    def __init__(self, screen: Screen, size: tuple[int, int], shots: Path) -> None:
        # pygame prints a greeting to stdout when it is imported
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
            pygame.quit()  # SDL falls back on this if a display does not answer
            display = os.environ.get("DISPLAY", "")
            raise UserError(_no_window(f"the display {display!r} does not answer"))
        pygame.key.set_repeat(400, 80)
        self._clock = pygame.time.Clock()
        self._screen = screen
        self._shots = shots
        self._has_help = False
        self._held: set[int] = set()  # keys that are down
        self._told = ""  # shown instead of the hint: where a screenshot was saved
        k, session = pygame, screen.session
        repeated = {
            (k.K_RIGHT, k.K_PERIOD): screen.step,
            (k.K_MINUS, k.K_KP_MINUS): lambda: session.change_pace(-1),
            (k.K_PLUS, k.K_EQUALS, k.K_KP_PLUS): lambda: session.change_pace(1),
            (k.K_UP,): lambda: screen.change_velocity(1),
            (k.K_DOWN,): lambda: screen.change_velocity(-1),
        }
        once = {
            (k.K_SPACE,): screen.toggle_pause,
            (k.K_r,): session.restart,
            (k.K_i,): screen.next_shape,
            (k.K_m,): lambda: screen.next_mode(-1 if k.key.get_mods() & k.KMOD_SHIFT else 1),
            (k.K_g,): screen.toggle_grid,
            (k.K_c,): screen.toggle_curve,
            (k.K_t,): screen.next_theme,
            (k.K_s,): self._save_screenshot,
            (k.K_h, k.K_F1): self._toggle_help,
        }
        self._actions = {key: do for keys, do in (repeated | once).items() for key in keys}
        self._repeated = {key for keys in repeated for key in keys}

    def close(self) -> None:
        self._pygame.quit()

    def announce_closing(self) -> None:
        """Show that the window is closing: saving may take a while."""
        self._pygame.display.set_caption("closing · taichi_foam")
        self._pygame.display.flip()

    def run(self) -> None:
        """Draw and handle events until the window is closed."""
        self._draw()  # show the initial state even while the drop is prepared
        while True:
            is_stale = self._screen.update(0.5 / FPS)
            for event in self._pygame.event.get():
                if self._closes(event):
                    return
                is_stale |= self._obey(event)
            if is_stale:
                self._draw()
            self._clock.tick(FPS)

    def _closes(self, event) -> bool:
        pygame = self._pygame
        is_key = event.type == pygame.KEYDOWN and event.key in (pygame.K_q, pygame.K_ESCAPE)
        return event.type == pygame.QUIT or is_key

    def _obey(self, event) -> bool:
        """Handle an event; return whether the picture changes."""
        pygame = self._pygame
        if event.type == pygame.KEYUP:
            self._held.discard(event.key)
        if event.type == pygame.KEYDOWN and event.key in self._actions:
            is_again = event.key in self._held
            self._held.add(event.key)
            if is_again and event.key not in self._repeated:
                return False
            self._told = ""
            self._screen.dismiss()
            self._actions[event.key]()
            return True
        return event.type in (pygame.VIDEORESIZE, pygame.VIDEOEXPOSE)

    def _draw(self) -> None:
        pygame = self._pygame
        picture = self._screen.picture(self._size(), self._told or _HINT)
        if self._has_help:
            panel(picture, HELP, self._screen.look.theme)
        height, width = picture.shape[:2]
        self._surface.blit(
            pygame.image.frombuffer(picture.tobytes(), (width, height), "RGB"), (0, 0)
        )
        pygame.display.flip()
        pygame.display.set_caption(f"{self._screen.session.scene.name} · taichi_foam")

    def _size(self) -> tuple[int, int]:
        """Size of the picture: a window can be made smaller than a picture may be."""
        width, height = self._surface.get_size()
        return max(width, raster.SMALLEST[0]), max(height, raster.SMALLEST[1])

    def _toggle_help(self) -> None:
        self._has_help = not self._has_help

    def _save_screenshot(self) -> None:
        picture = self._screen.picture(self._size())
        try:
            self._shots.mkdir(parents=True, exist_ok=True)
            path = next_numbered(self._shots / "shot", ".png")
            with whole_file(path) as partial:
                Image.fromarray(picture).save(partial)
        except OSError as error:
            self._told = f"no screenshot: {error.strerror or error}"
        else:
            self._told = f"saved {path}"
