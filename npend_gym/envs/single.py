"""NPendulumEnv: one environment, the vector environment's episodes with a single environment."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray
from typing_extensions import Unpack

from npend_gym.chain import Chain
from npend_gym.envs.config import make_config
from npend_gym.envs.episodes import Episodes
from npend_gym.envs.info import Info
from npend_gym.envs.inputs import checked_action, given_options
from npend_gym.envs.keywords import EnvKeywords, with_config_keywords
from npend_gym.envs.observing import ObsArray
from npend_gym.envs.seeds import checked_seed
from npend_gym.envs.session import Session
from npend_gym.envs.snapshots import States

_THE_LANE, _LANE_0 = np.ones(1, np.bool_), np.zeros(1, np.int64)


@with_config_keywords
class NPendulumEnv(Session, gym.Env[ObsArray, Any]):
    r"""The N-pendulum: n point masses on massless rods, or n links, hung from a pivot or a cart.

    This is what `gym.make` returns inside its wrappers for a task by name: "npend/SwingUp-v1",
    "npend/Balance-v1", "npend/Calm-v1", "npend/Release-v1" or "npend/Transition-v1", or one of the
    classic poles on a cart, "npend/CartPole-v1", "npend/CartDoublePole-v1" and
    "npend/CartTriplePole-v1". They have observation="scaled". "NPendulum-v0" has the defaults of
    the keywords, and its task is `mode`. `NPendulumVectorEnv` steps many of them at once.

    Description
    -----------
    A planar chain moves under gravity, damping and friction in its joints,
    and drag of the air. Torques act at the actuated joints, by default at the pivot. The equations
    of motion are exact: `npend_gym.physics.accelerations` solves them in O(n). Each step takes
    several Runge-Kutta steps of order 4. Every x86-64 or ARM CPU computes the same bits.

    Action
    ------
    ``Box(-1, 1, (len(actuated),), float32)``: the torque at each actuated joint
    divided by `max_torque`. A positive torque turns the rod below the joint counter-clockwise.
    Values outside the box are clipped. With `torque_levels` it is ``Discrete(torque_levels **
    len(actuated))``, see there. With base="cart" the first entry is the force on the cart divided
    by `max_force`, positive to the right. Only joints named in `actuated` have motors beside it.
    Mode "passive" has ``Discrete(1)``: the only action, 0, is to wait.

    The static torque, g times the sum of `Chain.lift`, holds the whole chain horizontal. Half of it
    cannot lift the chain directly: the chain must be swung up.

    Tasks
    -----
    The names in the formulas are those of `Quantities`.

    `help` lists them.

    Observation
    -----------
    float32, in rad and rad/s. Angles are measured from the downward vertical, positive
    counter-clockwise:

    ============= ========= ========================================== ================
    observation   shape     entries                                    bounds
    ============= ========= ========================================== ================
    "angles"      (2n,)     theta wrapped to [-pi, pi), then omega     pi, then 1e6
    "sincos"      (3n,)     sin theta, cos theta, omega                1, 1, then 1e6
    "scaled"      (3n,)     sin theta, cos theta, omega over its scale 1, 1, then 2
    ============= ========= ========================================== ================

    The scale of omega_i is sqrt(2 E / J_i), for the chain as made. E is `Chain.lifting_energy`. J_i
    is the moment of inertia of rod i alone about its joint, m_i l_i^2 for a bob. Beyond +-2 the
    entry is clipped.

    With a cart two entries follow, both clipped to +-2: its place over `rail` and its velocity over
    sqrt(g `rail`). This is the velocity of a fall through half of `rail`, with g = 9.81 where there
    is no gravity. With ``observe_velocities=False`` there is no velocity in it, neither omega nor
    the cart's.

    In mode "transition" n entries follow: the cosines of the goal, 1 (hanging) or -1 (standing) for
    each rod. With `goal_env` an observation is a Dict instead, as Gymnasium-Robotics has it:
    "observation" as in the table, and "achieved_goal" and "desired_goal", float64 of shape (n +
    1,). Goals are the cosines of the angles, and the kinetic energy in units of
    `Chain.lifting_energy`, clipped to 4. ``env.unwrapped.compute_reward(achieved_goal,
    desired_goal, info)`` is then the sparse reward, of one goal or of a batch of them.

    Reward
    ------
    Between 0 and 1 in each step, as the list of tasks says; 0 in mode "passive".

    On a cart the reward is multiplied by 1 - (x / `rail`)^2 / 2, x being its place.

    With reward_type="sparse": 1 where the goal is met at this instant, else 0.

    Starting state
    --------------
    passive, calm: at rest, all rods at `amplitude` plus one draw from [0, spread) that all share.
    swingup, balance: each angle and angular velocity is drawn within `spread` of hanging
    (standing) at rest. transition: start and goal are two different equilibria, in which each rod
    hangs or stands; all pairs are equally likely. Angles and angular velocities are drawn within
    `spread` of the start. By default `spread` is 0.017 in passive and calm, 0.02 in balance, else
    0.05. A cart is at rest in the middle of its rail in passive and calm, and in modes with a
    `start` of their own. Else its place [m] and velocity [m/s] are drawn as angles are.
    ``reset(options={...})`` chooses a start or another chain for one episode.

    These numbers are those of ``np.random.Philox(key=seed, counter=[0, 0, 0, episode])``, episodes
    being counted from 0 since the seed was given. Nothing else decides a start.

    Episode end
    -----------
    Mode "balance" terminates when the tip falls below half the chain's length, or a rod leans by
    more than `max_tilt`. Any mode does when a cart is beyond the end of its rail: it then has no
    reward and no success. Episodes are
    truncated after 1000 steps (by `gym.make`), and when the state leaves all bounds
    (\|theta\| > 1e5, \|omega\| > 1e6, or NaN): ``info["diverged"]`` is then True and the last
    finite state is kept.

    Info
    ----
    The keys of `Info`, the same from the reset on. ``info["success"]`` is True while the success
    that the list of tasks names has held without interruption, for as long as it says. A mode of
    your own that defines neither `achieved` nor `failed` has no such key.

    Parameters
    ----------
    **keywords
        Listed by `help`.
    render_mode : {None, "rgb_array", "human"}

    Raises
    ------
    TypeError, ValueError
        If a keyword is unknown or breaks its rule.

    Version history
    ---------------
    NPendulum-v0, npend/...-v1: initial versions.

    References
    ----------
    S. Charles, "The Lagrangian Mechanics and Pseudo-Periodicity of The Many-Body Planar Pendulum
    System", 2019.

    Examples
    --------
    >>> from npend_gym import NPendulumEnv
    >>> env = NPendulumEnv(n=3, mode="swingup")
    >>> observation, info = env.reset(seed=0)
    >>> observation.shape, round(info["tip_height"], 3)
    ((6,), -2.998)
    """

    _is_single = True

    def __init__(self, *, render_mode: str | None = None, **keywords: Unpack[EnvKeywords]) -> None:
        config = make_config(NPendulumEnv, keywords)
        self._open(config, render_mode)
        self.action_space: gym.Space[Any] = config.action_space
        self.observation_space: gym.Space[ObsArray] = config.observation_space
        self._action_shape = (config.joints.size,)
        self._is_seeded = False

    def reset(  # type: ignore[override]
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[ObsArray, Info[float, int, bool]]:
        """Begin a new episode.

        Parameters
        ----------
        seed : int, optional
            Seed of all that is drawn from now on; without one, the next episode of the last seed.
        options : dict, optional
            For this episode: "theta", "omega" (a chosen start), and the parameters of the chain,
            "masses", "lengths" and so on, each (n,) or one number; "gravity", "amplitude",
            "spread", "max_torque" and what else motors and sensors have, as numbers; with a cart
            "max_force", "cart_position", "cart_velocity" [N, m, m/s]; in mode "transition" the
            equilibria "start" and "goal" (n,), 0 or pi for each rod. They make no links of point
            masses, and add no friction, rotors or drag to links that have none. They need no more
            than three times the default `substeps`. Errors of motors and sensors are at most those
            that the environment is made with. With "persist": True they hold in later
            episodes too, until a reset with options.

        Returns
        -------
        observation : ndarray, float32, shape (2n,) or (3n,)
        info : Info

        Raises
        ------
        ValueError, TypeError
            If seed or options break a rule; the environment is then unchanged.
        """
        before = self._calls.progress
        new_seed, chosen = checked_seed(seed), given_options(options)
        checked = self._checked_options(chosen)
        episodes = self._begin("reset", before)
        super().reset(seed=new_seed)
        self._seed(episodes, given=new_seed is not None)
        episodes.start(_THE_LANE, checked)
        episodes.observe()
        if self.render_mode is not None:
            self.camera.follow(episodes, _THE_LANE)
        observation, _, _, _, info = episodes.outputs.only_lane()
        self._calls.finish()
        return observation, info

    def _seed(self, episodes: Episodes, *, given: bool) -> None:
        """Give the episodes the seed of Gymnasium's generator, where it is new."""
        seed = self.np_random_seed
        if seed < 0:  # a generator that the user has set tells no seed
            seed, given = int(self.np_random.integers(2**63)), True
        if given or not self._is_seeded:
            episodes.seed(seed, _THE_LANE)
        self._is_seeded = True

    def step(  # type: ignore[override]
        self, action: Any
    ) -> tuple[ObsArray, float, bool, bool, Info[float, int, bool]]:
        """Advance by `dt`; an action beyond the box is clipped.

        Raises
        ------
        ValueError, TypeError
            If the action is not a number, not finite or of the wrong shape; nothing has changed
            then.
        ResetNeeded
            Before the first reset, and after a call of `step` or `reset` that was interrupted.
        EnvInUse
            While another thread is inside `step` or `reset`; nothing has changed then.
        """
        ready = self._calls.ready
        if not ready:
            raise self._calls.refuse(self, "step")
        checked = checked_action(action, self._action_shape, self.config.action_table)
        try:
            ready.pop()  # as CallGuard.begin does, in less time
        except IndexError:
            raise self._calls.refuse(self, "step") from None
        episodes = self._episodes
        episodes.step(checked)
        result = episodes.outputs.only_lane()
        if self.render_mode is not None:
            self.camera.follow(episodes, ~_THE_LANE)
        ready.append(True)
        return result

    @property
    def chain(self) -> Chain:
        """The chain of this episode, as `randomize` and the options of `reset` made it."""
        self._calls.check(self, "chain")
        return self._episodes.chain(0)

    def get_state(self) -> States:
        """Return the whole state: chain, motion, clock, measurements, seed, number of the episode.

        Options that persist are not in it: they belong to the environment that was given them.

        Returns
        -------
        ndarray of records, shape ()
            ``state["rods"]["theta"]`` and ``state["members"]["time"]`` are read like this; the
            other fields are named in its dtype. It can be copied and pickled.
        """
        self._calls.check(self, "get_state")
        return self._episodes.snapshots.take(_LANE_0, np.zeros(1, np.bool_)).reshape(())

    def set_state(self, state: States) -> tuple[ObsArray, Info[float, int, bool]]:
        """Continue from a state of `get_state`, with the same bits as where it was taken.

        Wrappers know nothing of it: that of the time limit counts on.

        Parameters
        ----------
        state : ndarray
            From `get_state`, of an environment made with the same keywords, or of one environment
            of such a vector environment.

        Returns
        -------
        observation, info
            As `reset` returns them.

        Raises
        ------
        TypeError, ValueError
            If the state is none, of another version or environment, or has a number that no state
            has; nothing has changed then.
        """
        before = self._calls.progress
        checked = self._episodes.snapshots.check(state, 1)
        episodes = self._continue(checked, _LANE_0, before)
        seed = episodes.seeds.values[0]
        if seed != self._np_random_seed:
            self._np_random, self._np_random_seed = seeding.np_random(seed)
        self._is_seeded = True
        self._calls.finish()
        observation, _, _, _, info = episodes.outputs.only_lane()
        return observation, info

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """Return the picture (H, W, 3) in mode "rgb_array"; in mode "human" show it.

        Without a `render_mode` this warns and returns None, as in Gymnasium's own environments.
        """
        frames = self.camera.render(self, self._episodes, self._calls)
        return None if frames is None else frames[0]

    def close(self) -> None:
        """Close the window."""
        self.camera.close()
