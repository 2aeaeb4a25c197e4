"""A window on the screen that shows pictures one after the other (extra "render")."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

from npend_gym import _checks
from npend_gym.render import Frame, check_frame, pygame_module


def check_display() -> None:
    """See that a window would be shown: without a display SDL may draw where nobody sees it.

    Raises
    ------
    RuntimeError
        If there is no display, and the environment variable SDL_VIDEODRIVER asks for none.
    """
    pg = pygame_module()
    pg.display.init()
    driver = pg.display.get_driver()
    if driver in ("offscreen", "dummy") and not os.environ.get("SDL_VIDEODRIVER"):
        pg.display.quit()
        raise RuntimeError(f"there is no display (the driver of SDL is {driver!r})")


class Window:
    """A window that the first frame opens; a copy of it starts closed.

    Parameters
    ----------
    on_event : callable, optional
        Called with every event of pygame that arrives while a frame is shown.
    """

    def __init__(self, on_event: Callable[[Any], None] | None = None) -> None:
        pygame_module()
        self._on_event = on_event
        self._clock: Any = None  # a pygame.time.Clock while the window is open
        self._refused = False

    def __reduce__(self) -> tuple[type[Window], tuple[Any]]:
        return type(self), (self._on_event,)

    def show(self, frame: Frame, fps: float) -> None:
        """Show `frame`, and wait so that calls follow each other at `fps` a second.

        Once the user has closed the window this does nothing, until `close` is called.
        """
        frame, fps = check_frame("frame", frame), _checks.positive_number("fps", fps)
        if self._refused:
            return
        pg, size = pygame_module(), (frame.shape[1], frame.shape[0])
        pg.display.init()  # does nothing where it is done already
        self._clock = self._clock or pg.time.Clock()
        screen = pg.display.get_surface()
        if screen is None or screen.get_size() != size:
            screen = pg.display.set_mode(size)
            pg.display.set_caption("npend_gym")
        screen.blit(pg.image.frombuffer(frame.tobytes(), size, "RGB"), (0, 0))
        pg.display.flip()
        events = pg.event.get()
        if self._on_event is not None:
            for event in events:
                self._on_event(event)
        if any(event.type == pg.QUIT for event in events):
            self.close()
            self._refused = True
        else:
            self._clock.tick(fps)

    def close(self) -> None:
        """Close the window; a later `show` opens a new one."""
        if self._clock is not None:
            pygame_module().display.quit()
        self._clock, self._refused = None, False
