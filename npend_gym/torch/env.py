"""DifferentiableVectorEnv: many environments as tensors, with gradients through whole episodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from torch import Tensor
from typing_extensions import Unpack

from npend_gym import _checks
from npend_gym._threads import Crew
from npend_gym.envs import EnvKeywords
from npend_gym.envs.config import make_config
from npend_gym.envs.episodes import Episodes
from npend_gym.envs.inputs import checked_state
from npend_gym.envs.keywords import with_config_keywords
from npend_gym.envs.progress import Progress, lanes_are_done
from npend_gym.envs.session import ManyLanes
from npend_gym.torch.autograd import StepFunction, applied, uncompiled
from npend_gym.torch.checks import (
    DivergedError,
    check_device,
    check_ideal,
    check_known,
    check_tensor,
    clipped_action,
)
from npend_gym.torch.compiled_steps import call_of
from npend_gym.torch.hardware import TensorMotors, TensorSensors, begun
from npend_gym.torch.judging import Lanes, TensorState, judge, observe, with_goals


@with_config_keywords
class DifferentiableVectorEnv(ManyLanes):
    """Many N-pendulums as tensors: rewards and observations have gradients by all past actions.

    Episodes are those of `NPendulumVectorEnv` with the same keywords: the same starts of the same
    seeds, and without lag, ripple and pushes the same states to the last bit. All else agrees to
    rounding.

    Parameters
    ----------
    num_envs : int
        Number of sub-environments B.
    max_episode_steps : int or None
        Steps after which a sub-environment is truncated; None for never.
    autoreset_mode : gymnasium.vector.AutoresetMode or str
        As for `NPendulumVectorEnv`. With SAME_STEP ``info["final_obs"]`` has the observations
        before the reset, of all environments, with their gradients. A start has no gradient by what
        came before it.
    dtype : torch.dtype
        Of observations, rewards and actions: float64 or float32. States are float64.
    threads : int
        Threads that share the sub-environments. No result depends on their number.
    device : torch.device or str
        Where all tensors are: "cpu", or "cuda" for steps on a GPU, which need the extra "cuda".
    **keywords
        As for `NPendulumEnv`. On "cuda" motors and sensors are ideal, and the pivot is at rest.
        `randomize` never draws the mass or the damping of a cart. Nothing is rendered, and no
        pseudo-periods are measured.

    Attributes
    ----------
    single_observation_space, single_action_space, observation_space, action_space : Space
        As those of `NPendulumVectorEnv`; tensors take the place of arrays.

    Notes
    -----
    The graph of past steps grows until `detach` cuts it, or `reset` begins again. It
    keeps states and actions alone; a backward pass takes every step once more.

    Examples
    --------
    >>> from npend_gym.torch import DifferentiableVectorEnv
    >>> env = DifferentiableVectorEnv(4, n=2)
    >>> observation, info = env.reset(seed=0)
    >>> observation.shape
    torch.Size([4, 4])
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        max_episode_steps: int | None = 1000,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        dtype: torch.dtype = torch.float64,
        threads: int = 1,
        device: str | torch.device = "cpu",
        **keywords: Unpack[EnvKeywords],
    ) -> None:
        config = make_config(DifferentiableVectorEnv, keywords)
        if dtype not in (torch.float64, torch.float32):
            raise TypeError(f"dtype must be torch.float64 or torch.float32, got {dtype}")
        self.dtype: torch.dtype = dtype
        self.device: torch.device = check_device(device)
        self._open_lanes(config, num_envs, max_episode_steps, autoreset_mode)
        self.observation_size: int = config.observed
        self.action_size: int = config.joints.size
        check_known(config)
        check_ideal(self._episodes, self.device)
        self._fit_hardware()
        self._crew = Crew(threads)
        self._theta: Tensor = self._zeros(self.num_envs, config.state_size // 2)  # and of a cart
        self._omega: Tensor = self._theta
        self._start_energy = self._zeros(self.num_envs)
        self._age = self._held = self._zeros(self.num_envs, dtype=torch.int64)
        self._done = self._zeros(self.num_envs, dtype=torch.bool)
        self._taken = 0

    def _fit_hardware(self) -> None:
        self._motors = TensorMotors(self._episodes, self.device)
        self._sensors = TensorSensors(self._episodes)

    def _begin(self, call: str, before: Progress) -> Episodes:
        episodes = super()._begin(call, before)
        if before is Progress.UNFINISHED:  # they are new
            self._fit_hardware()
        return episodes

    def _zeros(self, *shape: int, dtype: torch.dtype = torch.float64) -> Tensor:
        return torch.zeros(*shape, dtype=dtype, device=self.device)

    # -- episodes ---------------------------------------------------------------------------

    @uncompiled
    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Tensor, dict[str, Tensor]]:
        """Begin a new episode in every sub-environment, or in those of ``options["reset_mask"]``.

        Parameters
        ----------
        seed, options
            As for `NPendulumVectorEnv.reset`; the mask may be a tensor.

        Returns
        -------
        observation : Tensor, shape (B, k)
        info : dict of Tensor
        """
        if isinstance(options, dict) and isinstance(options.get("reset_mask"), Tensor):
            options = options | {"reset_mask": options["reset_mask"].cpu().numpy()}
        chosen, checked = self._begin_lanes(seed, options)
        begun = torch.from_numpy(chosen).to(self.device)
        state = self._start(begun, checked)
        self._done = self._done & ~begun
        if chosen.all():
            self._taken = 0
        self._calls.finish()
        return self._observation(state), self._info(state)

    def _start(self, mask: Tensor, options: Any = None) -> TensorState:
        """Begin new episodes in the lanes of `mask`; return the state of all lanes."""
        config = self.config
        self._episodes.start(mask.cpu().numpy(), options)
        began = self._episodes.beginnings()
        alike = not config.randomization.names and not self._episodes.some_altered
        self._lanes = lanes = Lanes.of(began, config, self.device, alike=alike)
        motors = self._motors
        self._call = call_of(config, motors.joints, motors.pieces, lanes.rows, self._crew)
        self._theta, self._omega = self._replaced(
            mask, torch.from_numpy(began.state).to(self.device)
        )
        motors.begin(mask)
        self._sensors.begin(mask, self._theta, self._omega)
        state = TensorState(self._theta, self._omega, lanes)
        energy = state.energy.detach()
        energy = torch.where(energy > 0.0, energy, lanes.lifting_energy)
        self._start_energy = torch.where(mask, energy, self._start_energy)
        with torch.no_grad():
            achieved = judge(config, state, self._start_energy, torch.zeros_like(energy))[2]
        self._age = torch.where(mask, 0, self._age)
        self._held = torch.where(mask, achieved.to(torch.int64), self._held)
        return state

    def _replaced(self, mask: Tensor, start: Tensor) -> tuple[Tensor, Tensor]:
        """Return q and u with new ones, as `Episodes.angles` has them, in the lanes of `mask`."""
        n = self.config.n  # and of a cart two columns more
        theta, omega, place, velocity = start.tensor_split((n, 2 * n, 2 * n + 1), dim=1)
        theta, omega = torch.cat([theta, place], 1), torch.cat([omega, velocity], 1)
        return begun(mask, theta, self._theta), begun(mask, omega, self._omega)

    # -- stepping ---------------------------------------------------------------------------

    @uncompiled
    def step(self, action: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, dict[str, Any]]:
        """Advance every sub-environment by `dt`; actions beyond the box are clipped.

        Parameters
        ----------
        action : Tensor, shape (B, joints)
            Torques over their limit; integers (B,) where actions are discrete.

        Returns
        -------
        observation : Tensor, shape (B, k)
        reward : Tensor, shape (B,)
        terminated, truncated : Tensor, bool, shape (B,)
        info : dict of Tensor
            "theta" and "omega" [rad, rad/s], (B, n), "energy" [J] and "time" [s]. With a cart also
            "cart_position" [m] and "cart_velocity" [m/s]; in modes with goals "goal" [rad], (B, n).
            "success", except in a mode that defines neither `achieved` nor `failed`. With SAME_STEP
            "final_obs" and "final_info", of all environments as they were before any began again.

        Raises
        ------
        TypeError, ValueError
            If the actions break their rule; no sub-environment has then changed.
        DivergedError
            If an environment leaves all bounds, with the number of the step since all environments
            were reset.
        ResetNeeded
            As for `NPendulumVectorEnv.step`.
        """
        self._calls.check(self, "step")
        waiting, mode = self._done, self.autoreset_mode
        resets = mode is AutoresetMode.NEXT_STEP and bool(waiting.any())
        if mode is AutoresetMode.DISABLED and waiting.any():
            raise lanes_are_done(waiting.cpu().numpy())
        clipped = clipped_action(action, self.config, self.num_envs, self.dtype, self.device)
        self._calls.begin(self, "step")
        if resets:
            self._start(waiting)
            clipped = torch.where(waiting[:, None], 0.0, clipped)
        began = self._theta, self._omega
        self._advance(clipped)
        if resets:
            column = waiting[:, None]
            self._theta = torch.where(column, began[0], self._theta)
            self._omega = torch.where(column, began[1], self._omega)
        result = self._outcome(clipped, waiting if resets else None)
        self._calls.finish()
        return result

    def _advance(self, clipped: Tensor) -> None:
        self._taken += 1
        motors = self._motors
        motors.act(clipped, self._age, self._lanes)
        for piece in range(motors.pieces):
            state = self._theta, self._omega
            loads = motors.loads(piece, *state, self._lanes)
            try:
                self._theta, self._omega = applied(StepFunction, self._call, *state, loads)
            except DivergedError as error:
                raise DivergedError(error.chains, self._taken) from None

    def _outcome(
        self, clipped: Tensor, fresh: Tensor | None
    ) -> tuple[Tensor, Tensor, Tensor, Tensor, dict[str, Any]]:
        """Result of `step`; lanes that are `fresh` have only begun."""
        state = TensorState(self._theta, self._omega, self._lanes)
        squares = (clipped * clipped).mean(-1) if clipped.shape[1] else self._zeros(self.num_envs)
        reward, terminated, achieved = judge(self.config, state, self._start_energy, squares)
        self._age, held = self._age + 1, self._held + 1
        if fresh is not None:
            self._age, held = torch.where(fresh, 0, self._age), torch.where(fresh, 1, held)
            reward, terminated = torch.where(fresh, 0.0, reward), terminated & ~fresh
        self._held = held * achieved
        truncated = torch.zeros_like(terminated)
        if self.max_episode_steps is not None:
            truncated = self._age >= self.max_episode_steps
        self._done = terminated | truncated
        self._sensors.see(self._theta, self._omega)
        info: dict[str, Any] = self._info(state)
        observation = self._observation(state)
        if self.autoreset_mode is AutoresetMode.SAME_STEP:
            final = {"final_obs": observation, "final_info": info}
            if self._done.any():
                began = self._start(self._done)
                observation, info = self._observation(began), self._info(began)
                self._done = torch.zeros_like(terminated)
            info = info | final
        return observation, reward.to(self.dtype), terminated, truncated, info

    def _observation(self, state: TensorState) -> Any:
        sensed = self._sensors.shown(state, self._age)
        observation = observe(self.config, sensed).to(self.dtype)
        if self.config.goal_env:
            return with_goals(observation, state)
        return observation

    def _info(self, state: TensorState) -> dict[str, Tensor]:
        info = {
            "theta": state.theta.clone(),  # copies: what is done to them does not change the state
            "omega": state.omega.clone(),
            "energy": state.energy,
            "time": self._age.to(torch.float64) * self.config.dt,
        }
        if self.config.mode.defines_success:
            info["success"] = self._held > self.config.hold_steps
        if self.config.has_cart:
            place, velocity = state.place[:, 0].clone(), state.velocity[:, 0].clone()
            info |= {"cart_position": place, "cart_velocity": velocity}
        if self.config.mode.has_goals:
            info["goal"] = torch.where(self._lanes.goals < 0.0, np.pi, 0.0)
        return info

    # -- states -----------------------------------------------------------------------------

    def detach(self) -> None:
        """Cut the graph: gradients of what comes later end here."""
        self._theta, self._omega = self._theta.detach(), self._omega.detach()
        self._motors.detach()
        self._sensors.detach()

    def close(self) -> None:
        """End the threads."""
        self._crew.close()

    @property
    def state(self) -> tuple[Tensor, Tensor]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Angles [rad] and angular velocities [rad/s], float64, with their graph.

        (B, n) each; with a cart (B, n + 1), its position [m] and velocity [m/s] last. They can be
        set, to tensors with gradients too. Nothing else changes with them.
        """
        self._calls.check(self, "state")
        return self._theta, self._omega

    @state.setter
    def state(self, value: tuple[Tensor, Tensor]) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
        self._calls.check(self, "state")
        pair = _checks.listed("state", value, "(theta, omega)")
        if len(pair) != 2:
            raise ValueError(f"state must be two tensors, (theta, omega), got {len(pair)}")
        shape, n = tuple(self._theta.shape), self.config.n
        theta, omega = (
            check_tensor(name, given, shape, self.device).to(torch.float64)
            for name, given in zip(("theta", "omega"), pair, strict=True)
        )
        # A step from numbers out of bounds would raise, and leave the environment without a state
        columns = theta[:, :n], omega[:, :n], theta[:, n:], omega[:, n:]
        numbers = torch.cat(columns, 1).detach().cpu().numpy()
        checked_state(numbers, (self.num_envs, self.config.state_size), n)
        self._theta, self._omega = theta, omega
