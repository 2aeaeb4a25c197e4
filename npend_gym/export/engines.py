"""The environments' tasks with the motions of another engine, MuJoCo."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._extras import require
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.envs import EnvConfig, NPendulumVectorEnv
from npend_gym.envs.episodes import STATE, Episodes
from npend_gym.envs.keywords import CHAIN_KEYWORDS
from npend_gym.envs.observing import ObsArray
from npend_gym.envs.registration import MAX_EPISODE_STEPS, register_envs
from npend_gym.envs.rows import Flag
from npend_gym.envs.settings import COUNTED, HARDWARE
from npend_gym.envs.snapshots import States
from npend_gym.export.mjcf import to_mjcf
from npend_gym.physics.kernels.layout import MAX_SPEED, Member
from npend_gym.physics.kernels.link_terms import MODEL
from npend_gym.physics.memory import CallPlan
from npend_gym.rl.evaluation.settings import EnvLike, setting_of

MUJOCO_ID = "npend/MuJoCo-v0"
_ENTRY_POINT = "npend_gym.export.engines:MujocoVectorEnv"
_MAX_TIMESTEP = 0.001  # s
# What states hold of the chain
_OF_RODS = "mass", "length", "damping"


def in_mujoco(env: EnvLike, num_envs: int = 1) -> NPendulumVectorEnv:
    """Return an environment whose chains MuJoCo moves, with the same starts, rewards and success.

    A policy that does as well there does not depend on the package's own dynamics.

    Parameters
    ----------
    env : mapping, str, EnvSpec, or environment
        As for `npend_gym.rl.evaluate`, without wrappers that change observations or actions. Its
        number of sub-environments, autoreset and rendering are left out.
    num_envs : int
        Number of sub-environments.

    Returns
    -------
    NPendulumVectorEnv
        `npend_gym.rl.evaluate` takes it, too, and plays all its episodes in MuJoCo at once.

    Raises
    ------
    ValueError
        If the chain has what `to_mjcf` does not know; if the environment has errors of motors or
        sensors, pushes or randomized chains. Its `reset` and `set_state` raise one if they are to
        change the chain.
    ImportError
        If MuJoCo is not installed.

    Notes
    -----
    MuJoCo integrates each step from the state before it, under constant torques, by RK4 with a time
    step of at most 1 ms. Pseudo-periods are not measured, and ``info["energy_error"]`` counts no
    work. Dry friction is another law in MuJoCo, see `to_mjcf`.

    Examples
    --------
    >>> from npend_gym import rl
    >>> from npend_gym.export import in_mujoco
    >>> policy = rl.Policy.pretrained("balance-2")
    >>> envs = in_mujoco(policy.env)  # doctest: +SKIP
    >>> rl.evaluate(policy, envs, episodes=2).success.tolist()  # doctest: +SKIP
    [True, True]
    """
    setting = setting_of(env)
    if setting.wrappers:
        name = type(setting.wrappers[0]).__name__
        raise ValueError(f"env must be without wrappers, got {name}: wrap what in_mujoco returns")
    register_envs()
    if MUJOCO_ID not in gym.registry:
        gym.register(
            MUJOCO_ID, vector_entry_point=_ENTRY_POINT, max_episode_steps=MAX_EPISODE_STEPS
        )
    spec = gym.spec(setting.env_id)
    more: dict[str, Any] = {"measure_periods": False, "max_episode_steps": spec.max_episode_steps}
    keywords = more | spec.kwargs | setting.keywords
    made: Any = gym.make_vec(MUJOCO_ID, num_envs=num_envs, **keywords)
    return made


class MujocoEpisodes(Episodes):
    """Episodes whose chains MuJoCo moves; parameters are those of `Episodes`."""

    def __init__(
        self, config: EnvConfig, count: int, threads: int = 1, max_steps: int | None = None,
        *, single: bool = False,
    ) -> None:  # fmt: skip
        _check(config)
        mujoco = _mujoco()
        self._substeps = math.ceil(config.dt / _MAX_TIMESTEP * (1.0 - 1e-12))
        largest = config.action_limits
        # a motor without torque is a motor, whose control is 0
        limits = np.where(largest > 0.0, largest, 1.0) if largest.size > 0 else None
        timestep = config.dt / self._substeps
        text = to_mjcf(config.chain, config.joints.tolist(), limits, timestep)
        self._model = mujoco.MjModel.from_xml_string(text)
        # MuJoCo would begin anew where a motion leaves all bounds: here the episode ends
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET.value
        self._data = mujoco.MjData(self._model)
        super().__init__(config, count, threads, max_steps, single=single)

    def _run(self, plan: CallPlan, task: FloatArray) -> None:
        """Move the chains by MuJoCo; the step kernel, in which none is active, only judges them."""
        if task is not self._task:
            super()._run(plan, task)
            return
        memory, flags = self._memory, self.outputs.flags[:, : self.count]
        members, before = memory.members, self.angles
        after = before.copy()
        moves = members[Member.ACTIVE] > 0.0
        for lane in np.flatnonzero(moves).tolist():
            after[lane] = self._moved(before[lane], self._actions[:, lane])
        n, carts = self.config.n, int(self.config.has_cart)
        limits = np.repeat([MAX_ANGLE, MAX_SPEED] * 2, [n, n, carts, carts])
        sound = np.all(np.abs(after) <= limits, axis=1)  # no comparison holds for NaN
        after = np.where(sound[:, None], after, before)
        for field, values in zip(STATE, (after[:, :n], after[:, n : 2 * n]), strict=True):
            memory.fill(memory.per_rod(field), values)
        for field, values in zip(STATE, after.T[2 * n :], strict=False):
            memory.fill(memory.of_base(field), values)
        members[Member.TIME, moves & sound] += self.config.dt
        members[Member.ACTIVE] = 0.0
        super()._run(plan, task)
        members[Member.ACTIVE] = 1.0
        members[Member.DIVERGED, ~sound] = 1.0
        flags[Flag.DIVERGED, ~sound] = flags[Flag.TRUNCATED, ~sound] = True

    def _moved(self, state: FloatArray, action: FloatArray) -> FloatArray:
        """Return the state of a sub-environment after a step; MuJoCo limits the torques."""
        data, n, cart = self._data, self.config.n, state[2 * self.config.n :].reshape(2, -1)
        turns = np.diff(state[: 2 * n].reshape(2, n), prepend=0.0)
        data.qpos[:], data.qvel[:] = np.hstack([cart, turns])
        data.ctrl[:] = action * self.config.action_limits
        data.qacc_warmstart[:] = 0.0  # no sub-environment depends on the sub-environment before it
        _mujoco().mj_step(self._model, data, nstep=self._substeps)
        moved = np.array([data.qpos, data.qvel])
        on_cart = moved.shape[1] - n
        return np.append(np.cumsum(moved[:, on_cart:], axis=1), moved[:, :on_cart])


class MujocoVectorEnv(NPendulumVectorEnv):
    """The vector environment with the motions of MuJoCo; parameters are those of its base."""

    env_id = MUJOCO_ID
    _kind = MujocoEpisodes

    def _checked_options(self, given: dict[str, Any]) -> dict[str, Any] | None:
        """Refuse options for what MuJoCo's model has as made."""
        for name in (*CHAIN_KEYWORDS, "max_torque", "max_force"):
            if name in given:
                raise ValueError(
                    f"options[{name!r}] must be left out: MuJoCo's model has chain and motors as "
                    f"made; got {_checks.show(given[name])}"
                )
        return super()._checked_options(given)

    def set_state(
        self, state: States, which: ArrayLike | None = None
    ) -> tuple[ObsArray, dict[str, Any]]:
        """Continue from states as `NPendulumVectorEnv.set_state` does, all of the chain as made."""
        mine = self._episodes.snapshots.take(np.zeros(1, np.int64), np.zeros(1, np.bool_))
        same_kind = getattr(state, "dtype", None) == mine.dtype
        if same_kind and np.any(_parameters(state) != _parameters(mine)):
            raise ValueError(
                "state must be one of the chain as made, which MuJoCo's model has: take it from an "
                "episode without options for the chain"
            )
        return super().set_state(state, which)


def _parameters(states: Any) -> FloatArray:
    """Return the parameters of the chains in records of `get_state`, (k, numbers)."""
    records: Any = np.atleast_1d(states)
    parts = [records["members"]["gravity"], *(records["rods"][name] for name in _OF_RODS)]
    parts += [records[name] for name in MODEL if name in records.dtype.names]
    return np.hstack([part.reshape(len(records), -1) for part in parts])


def _mujoco() -> Any:
    """Return the module of MuJoCo, which environments that are copied cannot hold."""
    return require("mujoco", "mujoco", "motions in MuJoCo")


def _check(config: EnvConfig) -> None:
    """Refuse what acts on the chain or the sensors beside the torques of ideal motors."""
    given: dict[str, Any] = {"measure_periods": config.measure_periods}
    given["randomize"] = config.randomize if config.context_names else None
    given |= {name: config.largest[name] for name in HARDWARE if name not in COUNTED}
    for name, value in given.items():
        if value:
            raise ValueError(
                f"{name} must be left out: only ideal environments can be played in MuJoCo; "
                f"got {_checks.show(value)}"
            )
