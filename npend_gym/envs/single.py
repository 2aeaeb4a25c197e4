"""NPendulumEnv: one environment, the vector environment's episodes with a single lane."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from numpy.typing import ArrayLike, NDArray
from typing_extensions import Unpack

from npend_gym._checks import FloatArray
from npend_gym.compiled.philox import keys_of
from npend_gym.envs.config import make_config
from npend_gym.envs.episodes import Episodes
from npend_gym.envs.goals import GoalReward
from npend_gym.envs.info import Info
from npend_gym.envs.inputs import checked_action, checked_state
from npend_gym.envs.keywords import EnvKeywords, PlainSpec, with_config_keywords
from npend_gym.envs.options import checked_options, given_options
from npend_gym.envs.picture import Camera
from npend_gym.envs.progress import CallGuard, Progress
from npend_gym.envs.seeds import checked_seed
from npend_gym.envs.snapshots import States

ObsArray = NDArray[np.float32]

_THE_LANE, _LANE_0 = np.ones(1, np.bool_), np.zeros(1, np.int64)


@with_config_keywords
class NPendulumEnv(gym.Env[ObsArray, Any]):
    r"""The N-pendulum: n point masses on massless rods, or n links, hung from a pivot or a cart.

    This is what `gym.make("NPendulum-v0")` returns inside its wrappers, and `gym.make` of a task by
    name, "npend/SwingUp-v1", "npend/Balance-v1", "npend/Calm-v1", "npend/Release-v1" or
    "npend/Transition-v1", which have observation="scaled", or of the classic poles on a cart,
    "npend/CartPole-v1", "npend/CartDoublePole-v1" and "npend/CartTriplePole-v1".
    `NPendulumVectorEnv` steps many of them at once.

    Description
    -----------
    A planar chain moves under gravity, damping and friction in its joints, drag of the air, and
    torques at the actuated joints (by default at the pivot). The equations of motion are exact:
    `npend_gym.physics.accelerations` solves them in O(n). Each step takes several Runge-Kutta steps
    of order 4. Every machine computes the same bits.

    Action
    ------
    ``Box(-1, 1, (len(actuated),), float32)``: the torque at each actuated joint divided by
    `max_torque`. A positive torque turns the rod below the joint counter-clockwise. Values outside
    the box are clipped. With `torque_levels` it is ``Discrete(torque_levels ** len(actuated))``,
    see there. With base="cart" the first entry is the force on the cart divided by `max_force`,
    positive to the right, and only joints named in `actuated` have motors beside it. Mode
    "passive" has ``Discrete(1)``: the only action, 0, is to wait.

    ==================== ============================================ ================== ======
    mode                 task                                         default max_torque dt [s]
    ==================== ============================================ ================== ======
    "passive"            free release, the paper's experiment         no motor           0.01
    "swingup" (default)  from hanging to upright and slow             0.5 of the static  0.05
    "balance"            stay upright; fails when the tip falls       0.5 of the static  0.02
    "calm"               bring the released chain to rest             0.2 of the static  0.05
    "transition"         from any equilibrium to any other            0.5 of the static  0.05
    ==================== ============================================ ================== ======

    The static torque, g times the sum of `Chain.lift`, holds the whole chain horizontal. Half of it
    cannot lift the chain directly: the chain must be swung up.

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

    The scale of omega_i is sqrt(2 E / J_i), with E `Chain.lifting_energy` and J_i the moment of
    inertia of rod i alone about its joint (m_i l_i^2 for a bob), of the chain as made. Beyond +-2
    the entry is clipped.

    With a cart two entries follow, its place over `rail` and its velocity over sqrt(g `rail`), that
    of a fall through half of `rail` (with g = 9.81 where there is no gravity), both clipped to +-2.

    In mode "transition" n entries follow: the cosines of the goal, 1 (hanging) or -1 (standing) for
    each rod. With `goal_env` an observation is a Dict instead, as Gymnasium-Robotics has it:
    "observation" as in the table, and "achieved_goal" and "desired_goal", float64 of shape
    (n + 1,), the cosines of the angles and the kinetic energy in units of `Chain.lifting_energy`,
    clipped to 4. ``env.unwrapped.compute_reward(achieved_goal, desired_goal, info)`` is then the
    sparse reward, of one goal or of a batch of them.

    Reward
    ------
    Between 0 and 1 in each step; 0 in mode "passive". The names are those of `Quantities`, and
    calmness = 1 / (1 + 4 kinetic_energy):

    - swingup: height^2 (1 + calmness) / 2 (1 - mean_squared_action / 10)
    - balance: max(tip, 0) (1 + calmness) / 2 (1 - mean_squared_action / 10)
    - calm: (1 / (1 + e) + 1 / (1 + 100 e)) / 2 (1 - mean_squared_action / 10), e = energy_fraction
    - transition: closeness^2 (1 + calmness) / 2 (1 - mean_squared_action / 10)

    On a cart the reward is multiplied by 1 - (x / `rail`)^2 / 2, x being its place.

    With reward_type="sparse": 1 where the goal is met at this instant, else 0.

    Starting state
    --------------
    passive, calm: at rest, all rods at `amplitude` plus one draw from [0, spread) that all share.
    swingup, balance: each angle and angular velocity is drawn within 0.05 (0.02) of hanging
    (standing) at rest. transition: start and goal are two different equilibria, in which each rod
    hangs or stands; all pairs are equally likely. Angles and angular velocities are drawn within
    0.05 of the start. A cart is at rest in the middle of its rail in passive and calm; else its
    place [m] and velocity [m/s] are drawn as angles are. ``reset(options={...})`` chooses a start
    or another chain for one episode.

    These numbers are those of ``np.random.Philox(key=seed, counter=[0, 0, 0, episode])``, episodes
    being counted from 0 since the seed was given. Nothing else decides a start.

    Episode end
    -----------
    Mode "balance" terminates when the tip falls below half the chain's length, and any mode when a
    cart is beyond the end of its rail: it then has no reward and no success. Episodes are
    truncated after 1000 steps (by `gym.make`), and when the state leaves all bounds
    (\|theta\| > 1e5, \|omega\| > 1e6, or NaN): ``info["diverged"]`` is then True and the last
    finite state is kept.

    Info
    ----
    The keys of `Info`, the same from the reset on: ``time``, ``energy``, ``energy_error``,
    ``bobs_completed``, ``pseudo_period``, ``pseudo_periods``, ``ideal_period``, ``tip_height``,
    ``theta``, ``omega``, ``diverged``, in mode "passive" ``pseudo_period_com``, with a cart
    ``cart_position`` and ``cart_velocity``, and ``success``, which is True while

    - swingup: height > 0.95 and kinetic_energy < 0.01 have held for 5 s
    - balance: the tip has not fallen below half the chain's length
    - calm: energy_fraction < 0.01
    - transition: goal_distance < 0.1 and kinetic_energy < 0.01 have held for 5 s
    - passive: never, because there is no task

    Parameters
    ----------
    n : int
        Number of rods, or of the links of `chain`.
    mode : {"swingup", "passive", "balance", "calm", "transition"}, str or Mode
        The task. A task of your own is an instance of a class derived from `Mode`, or the name of
        that class, "package.module:Class"; only a name can be written to JSON with the spec.
    chain : Chain, dict or str, optional
        A `npend_gym.Chain`, the dict that its `as_dict` gives, or a preset's name such as
        "acrobot" (`npend_gym.chain.PRESETS`). Without it, `n` and the following describe one.
    masses, lengths, gravity, damping, drag, quadratic_drag
        As in `npend_gym.Chain` [kg, m, m/s^2, N m s/rad, N s/m, N s^2/m^2].
    centres, inertias, friction, friction_speed, armature, gear
        As in `npend_gym.Chain` [m, kg m^2, N m, rad/s, kg m^2, 1]: they make links of bobs.
    actuated : sequence of int
        Joints with a motor, in the order of the action; joint 0 is the pivot. By default (0,), and
        on a cart none.
    max_torque : float, optional
        Torque of the action 1 [N m]; by default as in the table, for the chain as made.
    difficulty : {"easy", "medium", "hard"} or float, optional
        Instead of `max_torque`, the limit over the static torque: 0.5, 0.2 or 0.1, or this number.
        Instead of `max_force`, the limit over the weight.
    torque_levels : int, optional
        Makes actions discrete, with this many evenly spaced torques from -1 to 1 for each actuated
        joint: the digits of an action to this base, the last joint's being the lowest.
    base : {"pivot", "cart"}
        What the chain hangs from: a pivot at rest, or a cart on a horizontal rail. A chain that has
        a cart of its own, ``Chain(..., base=Cart(mass))``, stands on that, and needs no `base`.
    cart_mass : float, optional
        [kg]; by default that of the chain's own cart, or that of the chain. This and the next three
        are for carts alone.
    rail : float, optional
        How far the rail reaches to each side [m]; by default twice the length of the chain.
    rail_damping : float
        Viscous damping of the cart on its rail [N s/m].
    max_force : float, optional
        Force of the action 1 [N]; by default the weight of cart and chain times the factor that the
        table above has for the static torque.
    dt : float, optional
        Time of a step [s]; by default as in the table.
    substeps : int, optional
        Runge-Kutta steps in a step, always this many. By default there are enough for the fastest
        normal mode to turn by at most 1/16 rad in each, and more while a rod would turn by more
        than 1/20 rad. ``info["energy_error"]`` shows how well the energy is kept.
    observation : {"angles", "sincos", "scaled"}
    reward_type : {"dense", "sparse"}
    goal_env : bool
        In mode "transition", with reward_type="sparse": observations are a Dict with goals.
    amplitude, spread : float
        Of the release [rad].
    randomize : dict, optional
        What is drawn at every start of an episode, by the name of a parameter of the chain or
        "max_torque": a pair (low, high) of factors, or {"low": ..., "high": ...} of values. Each
        end is a number or has an entry for each rod. ``info["context"]`` has what was drawn.
    observe_context : bool
        Whether these numbers are observed, at the end, from -1 to 1 within their ranges.
    angle_noise, velocity_noise : float
        Standard deviations of what the sensors add to angles [rad] and angular velocities [rad/s].
    angle_resolution, velocity_resolution : float
        Observed are multiples of these [rad, rad/s]: 2 pi over the counts a turn of an encoder.
    observation_delay, action_delay : float
        By how many steps observations are old and actions act late, at most 100; fractions too.
    motor_lag : float
        Time constant of the motors, which follow the action as a first-order system [s].
    torque_noise : float
        Standard deviation of what each motor adds to its torque, for a step [N m].
    torque_ripple : float
        Cogging of the motors: torque_ripple sin(ripple_cycles phi), phi the angle of the joint
        relative to the rod above [N m].
    ripple_cycles : int
        Cycles of the ripple a turn.
    push_rate, push_force : float
        How often [1/s] a random horizontal force pushes the tip, for a step, and the largest size
        of the force, which is uniform between its negative and itself [N].
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

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"]}  # noqa: RUF012
    spec: Any = PlainSpec()

    def __init__(self, *, render_mode: str | None = None, **keywords: Unpack[EnvKeywords]) -> None:
        self.config = config = make_config(NPendulumEnv, keywords)
        self.action_space = config.action_space
        self.observation_space = config.observation_space
        self.metadata = NPendulumEnv.metadata | {"render_fps": config.render_fps}
        self.render_mode = render_mode
        self.camera = Camera(render_mode, config.render_fps)
        self._episodes: Episodes = Episodes(config, 1)
        self._action_shape = (config.joints.size,)
        self._is_seeded = False
        self._calls = CallGuard()
        if config.goal_env:  # no other has it: Stable-Baselines3 would expect a Dict of them
            self.compute_reward = GoalReward(config.mode)

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
            "masses", "lengths" and so on, each (n,) or one number; "amplitude", "gravity", numbers;
            with a cart "cart_position", "cart_velocity", numbers [m, m/s];
            in mode "transition" the equilibria "start" and "goal" (n,), 0 or pi for each rod.
            They make no links of point masses, nor give links friction, rotors or drag anew.
            With "persist": True they hold in later episodes too, until a reset with options.

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
        checked = checked_options(chosen, self.config) if chosen else None
        episodes = self._begin("reset", before)
        super().reset(seed=new_seed)
        self._seed(episodes, given=new_seed is not None)
        episodes.start(_THE_LANE, checked)
        episodes.observe()
        self.camera.forget(_THE_LANE)
        if self.render_mode == "human":
            self.camera.follow(episodes)
        observation, _, _, _, info = episodes.outputs.only_lane()
        self._calls.finish()
        return observation, info

    def _begin(self, call: str, before: Progress) -> Episodes:
        """Begin a call that replaces everything; return the episodes for it."""
        self._calls.begin(self, call, before)
        if before is Progress.UNFINISHED:
            self._episodes = self._episodes.renewed()
        return self._episodes

    def _seed(self, episodes: Episodes, *, given: bool) -> None:
        """Give the episodes the seed of Gymnasium's generator, where it is new."""
        seed = self.np_random_seed
        if seed < 0:  # a generator that the user has set tells no seed
            seed, given = int(self.np_random.integers(2**63)), True
        if given or not self._is_seeded:
            episodes.seed(_LANE_0, [seed], keys_of(seed, 1))
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
            self.camera.follow(episodes)
        ready.append(True)
        return result

    def get_state(self) -> States:
        """Return the whole state: chain, motion, clock, measurements, seed, number of the episode.

        Returns
        -------
        ndarray of records, shape ()
            ``state["rods"]["theta"]`` and ``state["members"]["time"]`` are read like this; the
            other fields are named in its dtype. It can be copied and pickled.
        """
        if not self._calls.ready:
            raise self._calls.refuse(self, "get_state")
        return self._episodes.get_states(_LANE_0, np.zeros(1, np.bool_)).reshape(())

    def set_state(self, state: States) -> tuple[ObsArray, Info[float, int, bool]]:
        """Continue from a state, to the last bit as the environment that it was taken from.

        Wrappers know nothing of it: that of the time limit counts on.

        Parameters
        ----------
        state : ndarray
            From `get_state`, of an environment made with the same keywords, or of one lane of such
            a vector environment.

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
        episodes = self._begin("set_state", before)
        episodes.set_states(_LANE_0, checked)
        if episodes.seeds[0] != self._np_random_seed:
            self._np_random, self._np_random_seed = seeding.np_random(episodes.seeds[0])
        self._is_seeded = True
        self.camera.forget(_THE_LANE)
        self._calls.finish()
        observation, _, _, _, info = episodes.outputs.only_lane()
        return observation, info

    @property
    def state(self) -> FloatArray:
        """Angles [rad], then angular velocities [rad/s], shape (2n,).

        With a cart, its place [m] and velocity [m/s] follow, shape (2n + 2,).

        Setting it moves the chain there; pseudo-periods are measured from then on, and time, energy
        and work count from there.
        """
        if not self._calls.ready:
            raise self._calls.refuse(self, "state")
        return self._episodes.angles[0]

    @state.setter
    def state(self, value: ArrayLike) -> None:
        if not self._calls.ready:
            raise self._calls.refuse(self, "state")
        checked = checked_state(value, (1, self.config.state_size), self.config.n)
        self._calls.begin(self, "state")
        self._episodes.angles = checked
        self._calls.finish()

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """Return the picture (H, W, 3) in mode "rgb_array"; in mode "human" show it.

        Without a `render_mode` this warns and returns None, as in Gymnasium's own environments.
        """
        frames = self.camera.render(self, self._episodes, self._calls)
        return None if frames is None else frames[0]

    def close(self) -> None:
        """Close the window."""
        self.camera.close()
