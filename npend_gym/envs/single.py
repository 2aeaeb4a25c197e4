"""NPendulumEnv: one environment, the vector environment's batch with a single lane."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from typing_extensions import Unpack

from npend_gym.envs.batch import Batch
from npend_gym.envs.config import EnvKeywords, make_config, with_config_keywords
from npend_gym.envs.info import Info
from npend_gym.envs.inputs import Progress, checked_action
from npend_gym.envs.modes import Quantities
from npend_gym.envs.picture import Camera, warn_of_no_render_mode

ObsArray = NDArray[np.float32]

_THE_LANE = np.ones(1, np.bool_)
_READY, _UNFINISHED = Progress.READY, Progress.UNFINISHED


@with_config_keywords
class NPendulumEnv(gym.Env[ObsArray, Any]):
    r"""The N-pendulum: n point masses on massless rods, hung from a pivot.

    What `gym.make("NPendulum-v0")` wraps. The vector form is `NPendulumVectorEnv`.

    Description
    -----------
    A planar chain moves under gravity, joint damping, drag of the air and torques at the actuated
    joints (by default the base). The state is exact up to the integrator: the equations of motion
    are solved through the rod tensions (`npend_gym.physics.kernels.dynamics`), which equals the
    paper's system A(theta) theta'' = b, by Runge-Kutta steps of order 4, `substeps` a step. All
    results are the same bits on every machine.

    Action
    ------
    ``Box(-1, 1, (len(actuated),), float32)``: torque at each actuated joint over `max_torque`,
    positive counter-clockwise on the rod below the joint; beyond the box it is clipped. In mode
    "passive" ``Discrete(1)``: 0 is to wait.

    ==================== ============================================ =================
    mode                 task                                         default max_torque
    ==================== ============================================ =================
    "passive"            free release, the paper's experiment         none
    "swingup" (default)  from hanging to upright and slow             0.5 of the static
    "balance"            stay upright; fails when the tip falls       0.5 of the static
    "calm"               bring the released chain to rest             0.2 of the static
    ==================== ============================================ =================

    The static torque g sum_i l_i sum_{k>=i} m_k holds the whole chain horizontal. Half of it
    cannot lift the chain in one go: it must be swung. `dt` is 0.01 s in mode "passive", so that
    the paper's 10 s are 1000 steps, 0.02 s in "balance", where the fall is quick, 0.05 s else.

    Observation
    -----------
    float32, in rad and rad/s, angles from the downward vertical, counter-clockwise positive:

    ============= ========= ========================================== ================
    observation   shape     entries                                    bounds
    ============= ========= ========================================== ================
    "angles"      (2n,)     theta wrapped to [-pi, pi), then omega     pi, then 1e6
    "sincos"      (3n,)     sin theta, cos theta, omega                1, 1, then 1e6
    ============= ========= ========================================== ================

    Reward
    ------
    Between 0 and 1 a step; 0 in mode "passive". With `height` of the centre of mass (0 hanging,
    1 upright), `tip` height over length, `kinetic` and `energy` above rest in units of the energy
    that lifts the chain upright, `left` the energy over that at the start, `effort` the mean
    square of the clipped actions, and calmness = 1 / (1 + 4 kinetic):

    - swingup: height^2 (1 + calmness) / 2 (1 - effort / 10)
    - balance: max(tip, 0) (1 + calmness) / 2 (1 - effort / 10)
    - calm: (1 / (1 + left) + 1 / (1 + 100 left)) / 2 (1 - effort / 10)

    Starting state
    --------------
    passive, calm: at rest, all rods at `amplitude` plus one draw from [0, spread) common to all.
    swingup, balance: each angle and angular velocity drawn within 0.05 (0.02) of hanging
    (standing) at rest. ``reset(options={...})`` takes, for this episode: "theta", "omega" (n,),
    "amplitude", "masses", "lengths", "damping", "drag", "quadratic_drag" (n,), "gravity"; one
    number stands for all rods.

    Episode end
    -----------
    Terminates in mode "balance" when the tip falls below half the chain's length. Truncated after
    1000 steps (`gym.make`'s TimeLimit), and where the state leaves all bounds (\|theta\| > 1e5
    or \|omega\| > 1e6, or no number): then ``info["diverged"]`` is True and the last sound state
    is kept.

    Info
    ----
    The same keys from the reset on. ``time`` [s]; ``energy`` above hanging at rest [J];
    ``energy_error``: energy less that at the start less the work of torque, damping and drag, over
    the larger of the two energies; ``bobs_completed``, ``pseudo_periods`` (n,) [s] (0.0 where not
    yet) and their mean ``pseudo_period``, in the reading "bob" of `npend_gym.pseudo_periods`;
    ``ideal_period``, the paper's T0 [s]; ``tip_height`` over the pivot [m]; ``theta`` (n,),
    unwrapped, and ``omega`` (n,); ``diverged``; ``success``, whether the task is done as of now,
    on the last step that of the episode:

    - swingup: for the last 5 s, `height` > 0.95 and `kinetic` < 0.01
    - balance: the tip has not fallen below half the chain's length
    - calm: `left` < 0.01
    - passive: never; there is no task

    Parameters
    ----------
    n : int
        Number of rods.
    mode : {"swingup", "passive", "balance", "calm"} or npend_gym.envs.modes.Mode
        The task; an instance of a class of your own derived from Mode will do.
    masses, lengths, damping, drag, quadratic_drag : float or array_like, shape (n,)
        As in `npend_gym.Chain` [kg, m, N m s/rad, N s/m, N s^2/m^2].
    gravity : float
        [m/s^2].
    actuated : sequence of int
        Joints with an actuator, in the order of the action; joint 0 is the base.
    max_torque : float, optional
        [N m]; by default as in the table above, of the chain as made (options change nothing).
    dt : float, optional
        Time of a step [s].
    substeps : int, optional
        Runge-Kutta steps a step, that many always; by default so many that in each the fastest
        normal mode turns by at most 1/16 rad, and more where a rod would turn by more than 1/20
        rad. ``info["energy_error"]`` tells how well the energy is kept.
    observation : {"angles", "sincos"}
    amplitude, spread : float
        Of the release [rad].
    render_mode : {None, "rgb_array", "human"}

    Raises
    ------
    TypeError, ValueError
        If a keyword breaks its rule.

    Version history
    ---------------
    v0: initial version.

    References
    ----------
    S. Charles, "The Lagrangian Mechanics and Pseudo-Periodicity of The Many-Body Planar Pendulum
    System", 2019.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"]}  # noqa: RUF012

    def __init__(self, *, render_mode: str | None = None, **keywords: Unpack[EnvKeywords]) -> None:
        self.config = config = make_config(NPendulumEnv, keywords)
        self.action_space = config.action_space
        self.observation_space = config.observation_space
        self.metadata = NPendulumEnv.metadata | {"render_fps": config.render_fps}
        self.render_mode = render_mode
        self.camera = Camera(render_mode, config.render_fps)
        self._batch = Batch(config, 1)
        self._mode = config.mode
        self._action_shape = (config.joints.size,)
        self._hold_steps = config.hold_steps
        self._steps_held = 0  # instants in a row at which the goal was met
        self._progress = Progress.NEW

    def reset(  # type: ignore[override]
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[ObsArray, Info[float, int, bool]]:
        """Begin a new episode.

        Parameters
        ----------
        seed : int, optional
            Seed of the generator; without, it goes on.
        options : dict, optional
            For this episode: "theta", "omega" (a chosen start), "masses", "lengths", "damping",
            "drag", "quadratic_drag", each (n,) or one number; "amplitude", "gravity", numbers.

        Raises
        ------
        ValueError, TypeError
            If an option is unknown or breaks its rule; nothing has changed then.
        """
        broken = self._progress is _UNFINISHED
        batch = Batch(self.config, 1) if broken else self._batch
        checked = batch.check_options(options, single=True)
        self._progress = _UNFINISHED
        self._batch = batch
        super().reset(seed=seed)
        batch.rngs = [self.np_random]
        batch.start(_THE_LANE, checked)
        self.camera.forget(_THE_LANE)
        if self.render_mode == "human":
            self.camera.follow(batch)
        quantities, info = batch.only_lane()
        self._steps_held = 0
        info["success"] = self._success(quantities)
        observation = batch.observation[0]
        self._progress = _READY
        return observation, info

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
        """
        if self._progress is not _READY:
            raise self._progress.refuse("step")
        batch, mode = self._batch, self._mode
        checked = checked_action(action, self._action_shape)
        self._progress = _UNFINISHED
        batch.step(checked)
        quantities, info = batch.only_lane()
        reward, failed = float(mode.reward(quantities)), bool(mode.failed(quantities))
        info["success"] = self._success(quantities)
        if self.render_mode is not None:
            self.camera.follow(batch)
        result = batch.observation[0], reward, failed, info["diverged"], info
        self._progress = _READY
        return result

    def _success(self, quantities: Quantities[float]) -> bool:
        """Return whether the goal is met now and was over all of the mode's `hold`."""
        self._steps_held = self._steps_held + 1 if self._mode.achieved(quantities) else 0
        return self._steps_held > self._hold_steps

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """Return the picture (H, W, 3) in mode "rgb_array"; in mode "human" show it.

        Without a `render_mode` this warns and returns None, as in Gymnasium's own environments.
        """
        if self.render_mode is None:
            warn_of_no_render_mode(self)
            return None
        if self._progress is not _READY:
            raise self._progress.refuse("render")
        frames = self.camera.render(self._batch)
        return None if frames is None else frames[0]

    def close(self) -> None:
        """Close the window."""
        self.camera.close()
