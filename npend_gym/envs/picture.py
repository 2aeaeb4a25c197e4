"""The camera of an environment: keeps the trace of each tip, paints pictures and shows them."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks, render
from npend_gym._checks import FloatArray
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.episodes import BoolArray, Episodes
from npend_gym.envs.progress import CallGuard
from npend_gym.envs.rows import Output
from npend_gym.physics import energy
from npend_gym.window import Window

RENDER_MODES = ("human", "rgb_array")
_TRACE_LENGTH = 150  # frames
_PUSH_SHOWN = 0.4  # s for which a push, which takes a step, is seen


class DependencyNotInstalled(  # noqa: N818 - a name of Gymnasium
    gym.error.DependencyNotInstalled, ImportError
):
    """Raised where an environment is to be rendered and pygame cannot be imported."""


class Camera:
    """Paints the sub-environments as `render_mode` asks: None, "human" or "rgb_array"."""

    def __init__(self, render_mode: str | None, config: EnvConfig) -> None:
        if render_mode is not None:
            _checks.choice("render_mode", render_mode, RENDER_MODES)
        self.mode: str | None = render_mode
        self.fps: int = config.render_fps
        self._traces: dict[int, deque[FloatArray]] = {}
        self._pushes: dict[int, tuple[float, int]] = {}  # with the number of pictures to come
        self._painter: render.Painter | None = None
        try:
            if render_mode is not None:
                self._painter = render.Painter(config.render_size, config.render_plain)
            self._window = Window() if render_mode == "human" else None
        except ImportError as error:
            raise DependencyNotInstalled(str(error)) from error

    def forget(self, lanes: BoolArray) -> None:
        """Drop the traces of sub-environments (B,) whose episode has ended."""
        for lane in np.flatnonzero(lanes).tolist() if self._traces else ():
            self._traces.pop(lane, None)
            self._pushes.pop(lane, None)

    def follow(self, episodes: Episodes, begun: BoolArray) -> None:
        """Add the tips' places to the traces and, in "human" mode, show the picture.

        Environments that have `begun` an episode, (B,), have taken no step of it: they have no
        trace yet.
        """
        self.forget(begun)
        tips, pushes = episodes.places()[:, -1], episodes.pushes().tolist()
        for lane in np.flatnonzero(~begun).tolist():
            trace = self._traces.setdefault(lane, deque(maxlen=_TRACE_LENGTH))
            trace.append(tips[lane])
            push, (before, left) = pushes[lane], self._pushes.get(lane, (0.0, 0))
            seen = (push, math.ceil(_PUSH_SHOWN * self.fps)) if push != 0.0 else (before, left - 1)
            self._pushes[lane] = seen if seen[1] > 0 else (0.0, 0)
        if self.mode == "human":
            self._show(episodes)

    def render(
        self, env: Any, episodes: Episodes, calls: CallGuard
    ) -> tuple[NDArray[np.uint8], ...] | None:
        """Return a picture of every lane, or show them and return None, as `env` is asked to."""
        if self.mode is None:
            name = "NPendulum-v0" if env.spec is None else env.spec.id
            gym.logger.warn(
                "render() does nothing without a render mode: choose one where the environment "
                f'is made, such as gym.make("{name}", render_mode="rgb_array")'
            )
            return None
        if not calls.ready:
            raise calls.refuse(env, "render")
        return self._show(episodes)

    def _show(self, episodes: Episodes) -> tuple[NDArray[np.uint8], ...] | None:
        """Paint every sub-environment; return the pictures, or show them in the window."""
        if self._painter is None:
            return None
        places = zip(episodes.places(), episodes.places(energy.bodies), strict=True)
        frames = tuple(
            self._painter.paint(self._scene(episodes, lane, *of_lane))
            for lane, of_lane in enumerate(places)
        )
        if self._window is None:
            return frames
        self._window.show(render.tile(frames), self.fps)
        return None

    def _scene(
        self,
        episodes: Episodes,
        lane: int,
        positions: FloatArray,
        centres: FloatArray,
    ) -> render.Scene:
        trace = self._traces.get(lane)
        action, config = episodes.action(lane).clip(-1.0, 1.0), episodes.config
        rail, measured = config.rail or 0.0, config.measure_periods
        numbers = episodes.outputs.rows[: len(Output), lane].tolist()
        forces, torques = np.split(action, [int(config.has_cart)])
        return render.Scene(
            positions=positions,
            # beside the end of a rail the chain leaves it
            reach=max(rail, episodes.chain_length(lane), float(np.abs(positions).max())),
            time=numbers[Output.TIME],
            energy=numbers[Output.ENERGY],
            pseudo_period=numbers[Output.PSEUDO_PERIOD] if measured else None,
            completed=int(numbers[Output.BOBS_COMPLETED]) if measured else 0,
            torque=float(torques[0]) if torques.size else 0.0,
            caption=f"{config.mode.name}, n = {config.chain.n}",
            trace=np.array(trace) if trace else np.empty((0, 2)),
            centres=centres,
            joint=int(config.joints[forces.size]) if torques.size else 0,
            rail=rail,
            cart=numbers[Output.CART_POSITION] if config.has_cart else 0.0,
            force=float(forces[0]) if forces.size else 0.0,
            push=self._pushes.get(lane, (0.0, 0))[0],
        )

    def close(self) -> None:
        """Close the window."""
        if self._window is not None:
            self._window.close()
