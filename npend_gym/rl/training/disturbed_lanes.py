"""Lanes in each of which one thing is wrong: its chain, its sensors, or its motor."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.envs import EnvConfig
from npend_gym.physics import Ensemble
from npend_gym.rl.training.context_plans import ContextPlans

# What is wrong in an episode, and in which share of the episodes by default. In the last some of
# the others are wrong at once, half as much
ERRORS = {
    "nothing": 0.06,
    "chain": 0.38,
    "velocity_noise": 0.14,
    "torque_noise": 0.07,
    "motor_lag": 0.02,
    "delay": 0.16,
    "pulses": 0.12,
    "several": 0.05,
}
_NAMES = tuple(ERRORS)
_SEVERAL = {"chain": 0.5, "velocity_noise": 0.5, "torque_noise": 0.3, "delay": 0.5}
_VELOCITY_NOISE = 0.5  # rad/s
_TORQUE_NOISE = 1.1 / 6.0  # over the torque limit
_LAG = 0.02  # s
_DELAY = 1.5  # steps; whatever is drawn above 1 is 1
_PULSE_RATE, _PAUSE = 0.35, 0.8  # a second; s, at least, between two pulses
_PULSE_WIDTH, _PULSE = (0.05, 0.1), (1.0 / 12.0, 5.0 / 6.0)  # s; peaks over the torque limit
_START = 0.05  # rad, rad/s
_PAST = 4  # states that are kept
_GROWTH, _JUDGED = 1.25, 12  # of a level, after at least so many episodes


class DisturbedLanes:
    """Simulates chains with one motor at the base, each with errors of its own.

    The errors are those of `robustness`, drawn between zero and the largest that is tried there.

    Parameters
    ----------
    config : EnvConfig
        Of the environment without errors.
    plans : ContextPlans
        The chains.
    size : int
        Number of lanes.
    seed : int
    shares : mapping
        How often each of `ERRORS` is drawn, over the sum of all.

    Attributes
    ----------
    levels : ndarray, shape (errors,)
        What errors are multiplied by, in the order of `ERRORS`. Those of the chain are what they
        are.
    judged : ndarray, int64, shape (2, errors)
        How many episodes have been judged since then, and in how many the chain stood.
    error : ndarray, int64, shape (B,)
        What is wrong, as a number of `ERRORS`.
    which : ndarray, int64, shape (B,)
        The lane's chain, as a number of the plans.
    age : ndarray, int64, shape (B,)
        Steps since the start of the episode.
    begins : ndarray, bool, shape (B,)
        Where an episode begins.
    """

    changes = (
        "levels", "judged", "error", "which", "age", "begins", "_rng", "_past", "_last", "_noise",
        "_torque_noise", "_lag", "_delay", "_pulse",
    )  # fmt: skip

    def __init__(
        self,
        config: EnvConfig,
        plans: ContextPlans,
        size: int,
        seed: int,
        shares: Mapping[str, float] = MappingProxyType(ERRORS),
    ) -> None:
        self.config, self.plans, self.size = config, plans, size
        self._rng = np.random.default_rng([seed, 1])
        chances = np.array([shares.get(name, 0.0) for name in _NAMES])
        self._chances: FloatArray = chances / chances.sum()
        self.levels = np.ones(len(ERRORS))
        self.judged = np.zeros((2, len(ERRORS)), np.int64)
        self._lanes = Ensemble(config.chain, size, joints=[0])
        self._past = np.zeros((size, _PAST, 2 * config.n))  # states, the newest first
        self._last = np.zeros(size)  # actions
        self._noise, self._torque_noise, self._lag, self._delay = np.zeros((4, size))
        self._pulse = np.zeros((3, size))  # time of the peak, width [s], peak over the limit
        self.error, self.which, self.age = np.zeros((3, size), np.int64)
        self.begins = np.ones(size, np.bool_)
        self.restart(self.begins)

    @property
    def states(self) -> FloatArray:
        """Angles and angular velocities, (B, 2n)."""
        return self._past[:, 0]

    def restart(self, over: BoolArray) -> None:
        """Begin new episodes in some lanes."""
        lanes, rng, n = np.flatnonzero(over), self._rng, self.config.n
        if lanes.size == 0:
            return
        error = rng.choice(len(ERRORS), lanes.size, p=self._chances)
        self._draw_errors(lanes, error)
        self._set_chains(lanes)
        theta, omega = rng.uniform(-_START, _START, (2, lanes.size, n))
        self._lanes.set_state(lanes, theta, omega)
        self._past[lanes] = np.hstack([theta, omega])[:, None]
        self._last[lanes], self.age[lanes], self.begins[lanes] = 0.0, 0, True
        self._pulse[:, lanes] = np.array([-1.0, 1.0, 0.0])[:, None]

    def judge(self, lanes: NDArray[np.int64], stood: BoolArray) -> None:
        """Count episodes that are over, and whether the chain stood in them."""
        judged = [np.bincount(self.error[k], minlength=len(ERRORS)) for k in (lanes, lanes[stood])]
        self.judged += judged

    def grow(self) -> None:
        """Raise the levels of errors with which the chain stood in most of the episodes judged."""
        episodes, stood = self.judged
        enough = episodes >= _JUDGED
        higher = enough & (2 * stood > episodes)
        self.levels[higher] = np.minimum(1.0, _GROWTH * self.levels[higher])
        self.judged[:, enough] = 0

    def restored(self) -> None:
        """Put all lanes into the states that were restored."""
        self._set_chains(np.arange(self.size))
        self._lanes.set_state(slice(None), *np.split(self.states, 2, axis=1))

    def _set_chains(self, lanes: np.ndarray) -> None:
        """Give some lanes the chains of their plans."""
        plans, which = self.plans, self.which[lanes]
        chains = self.config.chain.repeated(
            lanes.size,
            masses=plans.masses[which], lengths=plans.lengths[which], damping=plans.damping[which],
        )  # fmt: skip
        self._lanes.set_chain(lanes, chains)

    def _draw_errors(self, lanes: np.ndarray, error: np.ndarray) -> None:
        """Draw what is wrong in some lanes."""
        rng, several = self._rng, error == _NAMES.index("several")

        def drawn(name: str) -> FloatArray:
            among = several & (rng.random(lanes.size) < _SEVERAL.get(name, 0.0))
            kind = _NAMES.index(name)
            size = np.where(error == kind, 1.0, np.where(among, 0.5, 0.0))
            return self.levels[kind] * size * rng.random(lanes.size)

        self.error[lanes] = error
        wrong = drawn("chain") > 0.0
        self.which[lanes] = np.where(wrong, rng.integers(len(self.plans), size=lanes.size), 0)
        self._noise[lanes] = _VELOCITY_NOISE * drawn("velocity_noise")
        self._torque_noise[lanes] = _TORQUE_NOISE * drawn("torque_noise")
        self._lag[lanes] = _LAG * drawn("motor_lag")
        self._delay[lanes] = np.minimum(_DELAY * drawn("delay"), 1.0)

    def observe(self) -> FloatArray:
        """Return the observations, (B, 3n): late, between two states, and with noise."""
        n, dt, lanes = self.config.n, self.config.dt, np.arange(self.size)
        delay = np.minimum(self._delay, self.age)
        whole = delay.astype(np.int64)
        older, newer = self._past[lanes, whole + 1], self._past[lanes, whole]
        s = (1.0 - (delay - whole))[:, None]
        # the cubic of `npend_gym.envs.sensors`, from 0 at `older` to 1 at `newer`
        turned = newer[:, :n] - older[:, :n]
        first, last = dt * older[:, n:], dt * newer[:, n:]
        bend, twist = 3.0 * turned - 2.0 * first - last, first + last - 2.0 * turned
        theta = older[:, :n] + s * (first + s * (bend + s * twist))
        omega = (first + s * (2.0 * bend + s * 3.0 * twist)) / dt
        omega += self._noise[:, None] * self._rng.normal(size=omega.shape)
        return np.hstack([np.sin(theta), np.cos(theta), omega])

    def step(self, actions: FloatArray) -> None:
        """Take a step of all lanes with actions, (B,)."""
        rng, dt = self._rng, self.config.dt
        taken = np.clip(actions, -1.0, 1.0)
        # with a lag the motor's mean torque in a step is partly that of the step before
        decay = 1.0 - np.exp(-dt / np.maximum(self._lag, 1e-6))
        torque = taken + (self._last - taken) * self._lag / dt * decay
        torque += self._torque_noise * rng.normal(size=self.size) + self._pulses()
        self._last = taken
        limit = self.config.max_torque
        self._lanes.advance(limit * torque[:, None], dt, self.config.substeps)
        self._past[:, 1:] = self._past[:, :-1].copy()
        self._past[:, 0] = np.hstack([self._lanes.theta, self._lanes.omega])
        self.age += 1
        self.begins[:] = False

    def _pulses(self) -> FloatArray:
        """Return the torques of pulses over the limit, (B,); new ones begin now and then."""
        rng, dt = self._rng, self.config.dt
        time = self.age * dt
        begin = (self.error == _NAMES.index("pulses")) & (rng.random(self.size) < _PULSE_RATE * dt)
        begin &= time > self._pulse[0] + _PAUSE
        count = int(begin.sum())
        peaks = self.levels[_NAMES.index("pulses")] * rng.uniform(*_PULSE, count)
        peaks *= rng.choice([-1.0, 1.0], count)
        widths = rng.uniform(*_PULSE_WIDTH, count)
        self._pulse[:, begin] = [time[begin] + 2.0 * _PULSE_WIDTH[1], widths, peaks]
        peak_time, width, peak = self._pulse
        return peak * np.exp(-0.5 * ((time + 0.5 * dt - peak_time) / width) ** 2)
