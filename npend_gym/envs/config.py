"""The keywords of the environments: checked once, defaults filled in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from npend_gym import _checks, theory
from npend_gym.chain import MAX_RODS, STANDARD_GRAVITY, Chain
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.envs.modes import MODES, Mode, lifting_energy
from npend_gym.physics.kernels.lanes import MAX_SPEED

OBSERVATIONS = ("angles", "sincos")
MAX_SUBSTEPS = 100_000

# Substeps are so short that in each the fastest normal mode turns by no more than this [rad], and
# what damping and drag brake decays by no more than this. Turning points of a release then come out
# within 1e-6 s of the adaptive method's for the paper's chains up to N = 20.
_PHASE = 1.0 / 16.0
# A chain that is whirled round turns faster than it swings. Substeps in which no rod turns by more
# than this keep the energy of chains under random torques to some 1e-4 in an episode.
_TURN = 1.0 / 20.0


@dataclass(frozen=True)
class Config:
    """The checked keywords of an environment."""

    chain: Chain
    mode: Mode
    joints: NDArray[np.int64]  # actuated, in the order of the action; empty where there is none
    max_torque: float  # N m, on each actuated joint
    dt: float  # s
    substeps: int
    turn: float  # rad; a substep in which a rod turns by more is cut into parts
    with_sines: bool
    amplitude: float  # rad
    spread: float  # rad

    @property
    def hold_steps(self) -> int:
        """Number of steps over which the mode's goal must have been met to count as success."""
        return math.ceil(self.mode.hold / self.dt * (1.0 - 1e-12))  # 5 s of 0.05 s are 100 steps

    @property
    def action_space(self) -> spaces.Space[Any]:
        """Box(-1, 1) with an entry for each actuated joint; Discrete(1) where there is none."""
        if self.joints.size == 0:
            return spaces.Discrete(1)
        return spaces.Box(-1.0, 1.0, (self.joints.size,), np.float32)

    @property
    def observation_space(self) -> spaces.Space[Any]:
        """Angles (or sines and cosines), then angular velocities, float32."""
        n = self.chain.n
        bound = np.full(3 * n if self.with_sines else 2 * n, MAX_SPEED, np.float32)
        angles = 2 * n if self.with_sines else n
        bound[:angles] = 1.0 if self.with_sines else np.pi
        return spaces.Box(-bound, bound, dtype=np.float32)


def make_config(
    n: int,
    mode: str | Mode,
    masses: ArrayLike,
    lengths: ArrayLike,
    gravity: float,
    damping: ArrayLike,
    drag: ArrayLike,
    quadratic_drag: ArrayLike,
    actuated: Sequence[int],
    max_torque: float | None,
    dt: float | None,
    substeps: int | None,
    observation: str,
    amplitude: float,
    spread: float,
) -> Config:
    """Check the keywords of an environment and fill in what depends on mode and chain."""
    n = _checks.count("n", n, high=MAX_RODS)
    m, rods = _checks.vector("masses", masses, n), _checks.vector("lengths", lengths, n)
    chain = Chain(m, rods, gravity, damping, drag, quadratic_drag)
    kind = _mode(mode)
    joints = _joints(actuated, n) if kind.torque_share > 0.0 else np.zeros(0, np.int64)
    limit = 0.5 * kind.torque_share * lifting_energy(chain)
    if max_torque is not None:
        limit = _checks.nonnegative_number("max_torque", max_torque)
    step = kind.dt if dt is None else _checks.positive_number("dt", dt)
    if substeps is None:
        phase = step * _fastest_rate(chain)
        pieces, turn = max(1, min(MAX_SUBSTEPS, math.ceil(phase / _PHASE))), _TURN
    else:
        turn = math.inf
        pieces = _checks.count("substeps", substeps, high=MAX_SUBSTEPS)
    return Config(
        chain=chain,
        mode=kind,
        joints=joints,
        max_torque=limit,
        dt=step,
        substeps=pieces,
        turn=turn,
        with_sines=_checks.choice("observation", observation, OBSERVATIONS) == "sincos",
        amplitude=_angle("amplitude", _checks.number("amplitude", amplitude)),
        spread=_angle("spread", _checks.nonnegative_number("spread", spread)),
    )


def _fastest_rate(chain: Chain) -> float:
    """Return the rate [1/s] that the substeps must resolve: of the fastest mode, or of braking."""
    gravity = chain.gravity or STANDARD_GRAVITY  # as for the default torque
    swinging = Chain(chain.masses, chain.lengths, gravity)
    v = np.concatenate([[0.0], 1.0 / chain.masses])
    damping = np.append(chain.damping, 0.0)
    # a bound by Gershgorin's circles on the inverse mass matrix times the damping matrix
    braking = 4.0 * (v[:-1] + v[1:]) * (damping[:-1] + damping[1:]) / chain.lengths**2
    # drag slows no motion faster than the most slowed bob would be alone; that of the square at the
    # speed of a pendulum as long as the chain that has fallen from upright, its slope 2 |v|
    fallen = 2.0 * math.sqrt(gravity * chain.total_length)
    slowing = (chain.drag + 2.0 * fallen * chain.quadratic_drag) / chain.masses
    return max(theory.fastest_frequency(swinging), float(braking.max()) + float(slowing.max()))


def _angle(name: str, value: float) -> float:
    return float(_checks.within(name, np.array(value), 0.5 * MAX_ANGLE))


def _mode(mode: str | Mode) -> Mode:
    if isinstance(mode, Mode):
        return mode
    if str(mode) not in MODES:
        raise ValueError(
            f"mode must be one of {', '.join(MODES)} or an instance of npend_gym.envs.modes.Mode; "
            f"got {_checks.show(mode)}"
        )
    return MODES[str(mode)]()


def _joints(actuated: Any, n: int) -> NDArray[np.int64]:
    if isinstance(actuated, str) or not isinstance(actuated, (Sequence, np.ndarray)):
        raise TypeError(
            f"actuated must be a list of joints such as (0,), got {_checks.show(actuated)}"
        )
    listed: list[Any] = list(actuated)  # pyright: ignore[reportUnknownArgumentType]
    joints = [_checks.count("actuated", joint, low=0, high=n - 1) for joint in listed]
    if len(joints) == 0 or len(set(joints)) != len(joints):
        raise ValueError(
            f"actuated must name at least one joint, and each once, got {_checks.show(listed)}"
        )
    return np.array(joints, np.int64)
