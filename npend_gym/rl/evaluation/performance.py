"""RealAIGym's performance score: how well a swing-up is done.

`src/python/double_pendulum/analysis/leaderboard.py` and `leaderboard/pendubot/simulation_v2` of
dfki-ric-underactuated-lab/double_pendulum have the definitions and the numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import Chain
from npend_gym.envs.config import EnvConfig
from npend_gym.rl.evaluation.models import Model, as_controller
from npend_gym.rl.evaluation.rollouts import Controller, Result, joint_motion, rollout
from npend_gym.rl.evaluation.seeds import HELD_OUT
from npend_gym.rl.evaluation.settings import EnvLike, evaluating, setting_of

UP = 0.9  # of the chain's length: the tip above it is up
_SAMPLING = 0.002  # s: their time step, by which the smoothness of the torque is evaluated


@dataclass(frozen=True, eq=False, repr=False)
class Performance(Result):
    """How well each swing-up was done, arrays of shape (episodes,), see `performance`.

    Attributes
    ----------
    success : ndarray, bool
        Whether the tip is above 0.9 of the chain's length at the end.
    swing_up_time : ndarray
        Time [s] since which it has been so.
    energy : ndarray
        sum over steps and motors of abs(torque times turn of the joint) [J].
    max_torque : ndarray
        Largest torque [N m].
    integrated_torque : ndarray
        Integral of the absolute torque [N m s].
    torque_cost : ndarray
        Integral of the squared torque [N^2 m^2 s].
    smoothness : ndarray
        Standard deviation of the change of the torque in 0.002 s [N m], see `performance`.
    velocity_cost : ndarray
        Integral of the sum over all joints of the squared velocity of the joint [rad^2/s].
    score : ndarray
        0 to 1.
    """

    success: BoolArray
    swing_up_time: FloatArray
    energy: FloatArray
    max_torque: FloatArray
    integrated_torque: FloatArray
    torque_cost: FloatArray
    smoothness: FloatArray
    velocity_cost: FloatArray
    score: FloatArray

    def as_row(self) -> dict[str, float]:
        """Return the means over the episodes."""
        arrays: dict[str, FloatArray] = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: round(float(values.mean()), 4) for name, values in arrays.items()}


@evaluating
def performance(
    model: Controller | Model,
    env: EnvLike,
    *,
    seed: int = HELD_OUT,
    episodes: int = 20,
    seconds: float = 10.0,
) -> Performance:
    """RealAIGym's performance score of swing-ups.

    score = success (1 - sum_i tanh(pi c_i / m_i) / 5), with the swing-up time c_1 and m_1 = 20 s,
    the energy and 60 J, the torque cost and 20 N^2 m^2 s, the smoothness and 0.1 N m, the velocity
    cost and 400 rad^2/s. These m_i are for their robot, ``Chain.realaigym("C.1")``. For another
    chain they are multiplied by what its lifting energy is over that robot's (for the energy and
    the smoothness; squared for the torque cost) and by sqrt(length over that robot's) (for the
    time and the torque cost; the velocity cost is divided by it).

    On a cart the length of the chain makes a torque of the force, and an angle of the place.
    `randomize` is left out. Delays, noise and pushes of the environment are kept.

    The smoothness of their definition is the standard deviation of the change of the torque from
    one step to the next, of 0.002 s. The torque is sampled as often here, whatever the step of the
    environment is. So a coarse step does not count as a rough torque.

    Parameters
    ----------
    model, env
        As for `evaluate`.
    seed : int
        Seed of the first episode.
    episodes : int
    seconds : float
        Duration of an episode.

    Returns
    -------
    Performance

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, or the environment has no motor.

    References
    ----------
    F. Wiebe and others, arXiv:2503.15290 (2025); constants of
    `leaderboard/pendubot/simulation_v2/create_leaderboard.py`.

    Examples
    --------
    >>> from npend_gym.rl import Policy, performance
    >>> policy = Policy.pretrained("swingup-1")
    >>> round(float(performance(policy, policy.env, episodes=4).score.mean()), 2)
    0.58
    """
    _checks.count("seed", seed, low=0)
    count = _checks.count("episodes", episodes)
    nominal, config, steps = setting_of(env).nominal(seconds)
    controller = as_controller(model, config, nominal.wrappers)
    length, coordinates = config.chain.total_length, config.n + config.has_cart
    unit = np.where(np.arange(coordinates) < config.n, 1.0, length)  # 1 for angles
    shape = (count, config.joints.size)  # of the torques that acted, not of the commands
    torques, up = np.zeros((steps, *shape)), np.zeros((steps + 1, count), np.bool_)
    angles = np.zeros((steps + 1, count, coordinates))
    speeds = np.zeros((steps, count, coordinates))  # at the start of each step
    for k, (running, before, _, info) in enumerate(rollout(controller, nominal.make(count), seed)):
        torques[k] = np.where(running[:, None], unit[config.joints] * info["torque"], 0.0)
        angles[k], speed = joint_motion(before) / unit
        angles[k + 1], _ = joint_motion(info) / unit
        speeds[k] = np.where(running[:, None], speed, 0.0)
        up[k + 1] = running & (info["tip_height"] > UP * length)
    return _evaluated(config, torques, angles[:, :, config.joints], speeds, up)


def _evaluated(
    config: EnvConfig, torques: FloatArray, angles: FloatArray, speeds: FloatArray, up: BoolArray
) -> Performance:
    """Return the criteria of trajectories, (steps, episodes, joints), and their score."""
    dt, steps = config.dt, len(torques)
    held = np.logical_and.accumulate(up[::-1])[::-1]  # up, and from there on to the end
    every = max(1, round(dt / _SAMPLING))
    changes = np.diff(torques, axis=0)
    samples = every * steps - 1  # changes of the torque sampled, most of them zero
    square = (changes**2).sum(axis=0) / samples - (changes.sum(axis=0) / samples) ** 2
    found = {
        "success": held[-1],
        "swing_up_time": dt * np.minimum(len(held) - held.sum(axis=0), steps),
        "energy": np.abs(torques * np.diff(angles, axis=0)).sum(axis=(0, 2)),
        "max_torque": np.abs(torques).max(axis=(0, 2)),
        "integrated_torque": dt * np.abs(torques).sum(axis=(0, 2)),
        "torque_cost": dt * (torques**2).sum(axis=(0, 2)),
        "smoothness": np.sqrt(np.maximum(square, 0.0)).sum(axis=1),
        "velocity_cost": dt * (speeds**2).sum(axis=(0, 2)),
    }
    most = _most(config)
    costs = [np.tanh(np.pi * found[name] / most[name]) for name in most]
    return Performance(**found, score=found["success"] * (1.0 - np.mean(costs, axis=0)))


def _most(config: EnvConfig) -> dict[str, float]:
    """Upper bounds of each criterion, in the scale of the chain."""
    chain, robot = config.chain, Chain.realaigym("C.1", motors=False)
    energy = chain.lifting_energy / robot.lifting_energy
    time = math.sqrt(chain.total_length / robot.total_length)
    return {  # the numbers are for their robot
        "swing_up_time": 20.0 * time,  # s
        "energy": 60.0 * energy,  # J
        "torque_cost": 20.0 * (energy**2 * time),  # N^2 m^2 s
        "smoothness": 0.1 * energy,  # N m
        "velocity_cost": 400.0 * (1.0 / time),  # rad^2/s
    }
