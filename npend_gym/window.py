"""A window on the screen that shows pictures one after the other (extra "render")."""

from __future__ import annotations

import os
import sys
from typing import Any

from npend_gym import _checks
from npend_gym.render import Frame, check_frame, pygame_module


class Window:
    """A window that the first frame opens; a copy of it starts closed."""

    def __init__(self) -> None:
        pygame_module()
        self._clock: Any = None  # a pygame.time.Clock while the window is open
        self._refused = False

    def __reduce__(self) -> tuple[type[Window], tuple[()]]:
        return type(self), ()

    def show(self, frame: Frame, fps: float) -> None:
        """Show `frame`, and wait so that calls follow each other at `fps` a second.

        Once the user has closed the window this does nothing, until `close` is called.
        """
        frame, fps = check_frame("frame", frame), _checks.positive_number("fps", fps)
        if self._refused:
            return
        pg, size = pygame_module(), (frame.shape[1], frame.shape[0])
        if sys.platform == "linux" and "XDG_RUNTIME_DIR" not in os.environ:
            # Wayland's socket would be there: without it SDL would try in vain, and complain
            os.environ.setdefault("SDL_VIDEODRIVER", "x11,kmsdrm,offscreen")
        pg.display.init()  # does nothing where it is done already
        self._clock = self._clock or pg.time.Clock()
        screen = pg.display.get_surface()
        if screen is None or screen.get_size() != size:
            screen = pg.display.set_mode(size)
            pg.display.set_caption("npend_gym")
        screen.blit(pg.image.frombuffer(frame.tobytes(), size, "RGB"), (0, 0))
        pg.display.flip()
        if any(event.type == pg.QUIT for event in pg.event.get()):
            self.close()
            self._refused = True
        else:
            self._clock.tick(fps)

    def close(self) -> None:
        """Close the window; a later `show` opens a new one."""
        if self._clock is not None:
            pygame_module().display.quit()
        self._clock, self._refused = None, False
