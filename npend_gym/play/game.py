"""A chain to play with, in a live window (extra "render")."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain, as_chain
from npend_gym.experiments.draws import starts
from npend_gym.physics import Ensemble, energy
from npend_gym.play.panel import SIZE, draw_panel
from npend_gym.render import Frame, Painter, Scene, pygame_module
from npend_gym.window import Window

MAX_N = 200
_DT, _STEPS = 0.02, 2  # s, and steps between two pictures
_SPREAD = 0.017  # rad, of the release
_TRACE = 150  # latest places of the tip that are drawn
_ANGLE = math.radians(5.0)  # smallest amplitude, and its change by a key


class Game:
    """What the window shows and how it answers to events. It opens no window itself.

    Parameters
    ----------
    n : int, optional
        Number of pendulums, at most 200; by default 5.
    amplitude : float
        Angle of the release [rad].
    seed : int
        Seed of the draw from [0, 0.017) rad that is added to the amplitude, as in the paper.
    chain : Chain, dict or str, optional
        A chain in place of `n` equal rods: a `Chain`, the dict of its parameters, or a preset's
        name.
    """

    def __init__(
        self,
        n: int | None = None,
        amplitude: float = math.pi / 4,
        seed: int = 0,
        chain: Chain | Mapping[str, Any] | str | None = None,
    ) -> None:
        if n is not None and chain is not None:
            raise ValueError(f"n must be left out where chain is given, got {_checks.show(n)}")
        self._given = None if chain is None else as_chain(chain)
        count = 5 if n is None else n
        self.n = _checks.count("n", self._given.n if self._given else count, high=MAX_N)
        self.amplitude = _checks.number("amplitude", amplitude)
        if not 0.0 < abs(self.amplitude) < math.pi:
            rule = f"must not be 0, and must be {_checks.in_radians('pi', self.amplitude)}"
            raise ValueError(f"amplitude {rule}")
        self.seed = _checks.count("seed", seed, low=0)
        self.paused = self.over = False
        self._painter = Painter(SIZE)
        self.release()

    def release(self) -> None:
        """Release the chain from rest."""
        self._chain = self._given or Chain.uniform(self.n)
        self._max_torque = 0.25 * self._chain.lifting_energy  # N m, half of what holds it level
        self._motion = Ensemble(self._chain, 1, joints=range(self.n))
        self._motion.set_state(0, starts(self.seed, 0, 1, self.amplitude, _SPREAD)[0])
        self._key_action = 0.0  # torque at the pivot by the keys, divided by its limit
        self._held_bob: int | None = None  # by the mouse
        self._mouse = np.zeros(2)  # its place [m]
        self._pushed = False
        self._trace: list[FloatArray] = []
        self._marks: dict[int, FloatArray] = {}  # where each bob completed

    # -- the motion ------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Time since the release, or since the last push ended [s]."""
        return float(self._motion.time[0])

    @property
    def theta(self) -> FloatArray:
        """Angles [rad], shape (n,)."""
        return self._motion.theta[0]

    @property
    def omega(self) -> FloatArray:
        """Angular velocities [rad/s], shape (n,)."""
        return self._motion.omega[0]

    @property
    def energy(self) -> float:
        """Energy above hanging at rest [J]."""
        return float(self._motion.energy[0])

    @property
    def positions(self) -> FloatArray:
        """Places of the bobs [m], shape (n, 2)."""
        return self._motion.positions[0]

    @property
    def periods(self) -> FloatArray:
        """Pseudo-period of each bob [s]; 0 where not complete, and while the player pushes."""
        return np.zeros(self.n) if self._pushed else np.nan_to_num(self._motion.pseudo_periods[0])

    def advance(self) -> None:
        """Advance the time by 0.02 s, unless paused.

        After a push the time starts at 0 again: pseudo-periods are those of the free motion since.
        """
        if self.paused:
            return
        action = self._action()
        pushing = bool(np.any(action))
        if self._pushed and not pushing:
            self._motion.set_state(0, self.theta, self.omega)
        if pushing:
            self._marks = {}
        self._pushed = pushing
        self._motion.advance(self._max_torque * action[None], _DT)
        places = self.positions
        self._trace = [*self._trace[1 - _TRACE :], places[-1]]
        for bob in np.flatnonzero(self.periods).tolist():
            self._marks.setdefault(bob, places[bob])

    def _action(self) -> FloatArray:
        """Return the torque on every joint, divided by its limit: of the keys and of the mouse."""
        action = np.zeros(self.n)
        action[0] = self._key_action
        if self._held_bob is not None:
            chain, bob, theta = self._chain, self._held_bob, self.theta
            speed = energy.velocities(chain, theta, self.omega)[bob]
            mass, rate = chain.masses.mean(), math.sqrt(chain.gravity / chain.lengths.mean())
            # a spring to the mouse, damped because the force is held for a step
            pull = rate * (self._mouse - self.positions[bob]) - 0.5 * speed
            force = 4.0 * mass * rate * pull
            along = chain.lengths * (np.cos(theta) * force[0] + np.sin(theta) * force[1])
            along[bob + 1 :] = 0.0  # the force does not act on the rods beyond the bob
            # the torque on joint j acts on everything below it
            action += np.cumsum(along[::-1])[::-1] / self._max_torque
        return np.clip(action, -1.0, 1.0)

    # -- the player ------------------------------------------------------------------------------

    def handle(self, event: Any) -> None:
        """Answer to an event of pygame."""
        pg = pygame_module()
        if event.type == pg.QUIT:
            self.over = True
        elif event.type in (pg.KEYDOWN, pg.KEYUP):
            self._key(event.key, down=event.type == pg.KEYDOWN)
        elif event.type == pg.MOUSEBUTTONDOWN and event.pos[0] < SIZE:
            self._mouse = self._place(event.pos)
            self._held_bob = int(np.argmin(np.hypot(*(self.positions - self._mouse).T)))
        elif event.type == pg.MOUSEBUTTONUP:
            self._held_bob = None
        elif event.type == pg.MOUSEMOTION:
            self._mouse = self._place(event.pos)

    def _place(self, pixel: tuple[int, int]) -> FloatArray:
        """Return the place of a pixel [m]."""
        return self._painter.place(pixel) * self._chain.total_length

    def _key(self, key: int, *, down: bool) -> None:
        pg = pygame_module()
        torques = {pg.K_LEFT: -1.0, pg.K_RIGHT: 1.0}
        if key in torques:
            self._key_action = torques[key] if down else 0.0
        elif not down:
            return
        elif key in (pg.K_q, pg.K_ESCAPE):
            self.over = True
        elif key == pg.K_SPACE:
            self.paused = not self.paused
        elif key == pg.K_r:
            self.release()
        else:
            self._change(key)

    def _change(self, key: int) -> None:
        pg = pygame_module()
        n_change = {pg.K_UP: 1, pg.K_DOWN: -1}.get(key, 0)
        angle_change = {pg.K_PAGEUP: _ANGLE, pg.K_PAGEDOWN: -_ANGLE}.get(key, 0.0)
        n = self.n if self._given else min(max(self.n + n_change, 1), MAX_N)
        amplitude = min(max(self.amplitude + angle_change, _ANGLE), math.pi - _ANGLE)
        if (n, amplitude) != (self.n, self.amplitude):
            self.n, self.amplitude = n, amplitude
            self.release()

    # -- the picture -----------------------------------------------------------------------------

    def picture(self) -> Frame:
        """Return the picture of this moment, shape (560, 880, 3)."""
        done = self.periods[self.periods > 0.0]
        chain = self._painter.paint(
            Scene(
                positions=self.positions,
                reach=self._chain.total_length,
                time=self.time,
                energy=self.energy,
                pseudo_period=float(done.mean()) if done.size else 0.0,
                completed=done.size,
                torque=float(self._action()[0]),
                caption=f"n = {self.n}" + (", paused" if self.paused else ""),
                trace=np.reshape(self._trace, (-1, 2)),
                marks=np.reshape(list(self._marks.values()), (-1, 2)),
                centres=energy.bodies(self._chain, self.theta),
            )
        )
        return np.hstack([chain, draw_panel(self._chain, self.amplitude, self.periods)])


def play(game: Game) -> None:
    """Open a window on `game` and keep it until the player quits."""
    window = Window(game.handle)
    try:
        while not game.over:
            for _ in range(_STEPS):
                game.advance()
            window.show(game.picture(), fps=1.0 / (_DT * _STEPS))
    finally:
        window.close()
