"""SHAC of an actor that remembers, with random chains, noisy and late sensors, and pushes.

As `shac`, with these differences. The actor is given its last observations and actions and the
critic the true state and what was drawn for the episode, so that the actor alone has to find out
what it cannot see: an asymmetric actor-critic (L. Pinto et al., "Asymmetric actor critic for
image-based robot learning", RSS 2018). The noise of the sensors is drawn again whenever a horizon
is taken again, along the Jacobians of its steps; the gradient leads through what is observed late.
"""

# torch's stubs leave parts unknown
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import torch

from npend_gym.envs import EnvConfig
from npend_gym.rl.policies.policy import Policy
from npend_gym.rl.training import shac
from npend_gym.rl.training.checkpoints import Checkpoint
from npend_gym.rl.training.disturbed_horizons import DisturbedCollector, DisturbedTask
from npend_gym.rl.training.disturbed_task import OF_LANE
from npend_gym.rl.training.keywords import OF_CHAIN, check_swing_up, used_config
from npend_gym.rl.training.short_horizons import Horizons
from npend_gym.rl.training.tasks import Curve, env_of_task, one_thread


@dataclass(frozen=True)
class Settings(shac.Settings):
    """The settings of a training run; its result depends on nothing else."""

    total_timesteps: int = 400_000
    num_envs: int = 64
    updates: int = 14
    batch_size: int = 128
    critic_batch_size: int = 768
    memory: int = 60_000
    actor_learning_rate: float = 3e-3
    critic_learning_rate: float = 3e-3
    exploration: float = 0.1  # noise of the torque over its limit; it falls linearly to zero
    episode: int = 80
    length: int = 5  # observations that the actor is given
    change_scale: tuple[float, float, float] = (0.2, 0.2, 2.0)  # of changes in a step
    ideal_share: float = 0.15  # of the episodes, which are as the environment without `randomize`
    first_level: float = 0.2  # of the disturbances at first, over those of the environment
    ramp: tuple[float, float] = (0.0, 0.5)  # from when to when they grow, of the training
    starts: tuple[float, float] = (0.25, 0.3)  # shares of the task's start and of near upright
    nearness: tuple[float, float] = (0.2, 0.7)  # deviations near upright [rad, rad/s]
    demonstrator: str = ""  # a policy of the package, from whose way episodes start
    pulse_rate: float = 0.25  # pulses of torque at a random joint in a second
    pulse: float = 5.0 / 6.0  # largest peak of them over the torque limit


class RobustLearner(shac.Learner):
    """The learner of `shac`, for an actor with memory."""

    task: DisturbedTask

    def retake(self, old: Horizons) -> tuple[list[torch.Tensor], torch.Tensor, torch.Tensor]:
        """Take horizons again with the actor as it is now, as in `shac`, with new noise."""
        task, past, length, size = self.task, self.task.past, self.task.length, len(old.states)
        states, actions = [*old.states[:, :past].unbind(1)], [*old.actions[:, :past].unbind(1)]
        deviation = torch.zeros_like(old.states[:, 0]).requires_grad_()
        noise = torch.randn(self.settings.horizon + length, *deviation.shape).unbind(0)
        observations = [
            task.sense([*old.states[:, : past + 1 - ago].unbind(1)], old.context, noise[ago])
            for ago in range(length - 1, 0, -1)
        ]
        states.append(old.states[:, past] + deviation)
        outputs, near = [], [torch.ones(size)]
        for t in range(self.settings.horizon):
            observations.append(task.sense(states, old.context, noise[length + t]))
            outputs.append(self.actor(task.frames(observations, actions)))
            actions.append(outputs[-1].tanh())
            change = actions[-1] - old.actions[:, past + t]
            change = torch.cat([states[-1] - old.states[:, past + t], change], 1)
            deviation = (old.jacobians[:, t] @ change[..., None])[..., 0]
            states.append(old.states[:, past + t + 1] + deviation)
            away = (deviation.detach() / task.state_scale).abs().amax(-1)
            near.append(near[-1] * (away < self.settings.trust))
        return states[past:], torch.stack(outputs, 1), torch.stack(near, 1)

    def policy(self, last: dict[str, Any]) -> Policy:
        """Return the actor as a policy with memory, of the environment without `randomize`."""
        policy, task = super().policy(last), self.task
        first = torch.from_numpy(policy.weights[0]) @ task.to_inputs.T
        frames = torch.ones(task.length, 3 * task.n + 1).numpy()
        weights = [first.numpy(), *policy.weights[1:]]
        env = {name: value for name, value in policy.env.items() if name != "randomize"}
        about = policy.provenance | {"trained_by": "robust_shac"}
        return replace(policy, scale=frames, weights=weights, env=env, provenance=about)


@one_thread()
def train(
    settings: Settings, progress: str | None = None, checkpoint: Checkpoint | None = None
) -> tuple[Policy, Curve]:
    """Return the trained policy and its learning curve, a row for every tenth; see `shac.learn`."""
    config = used_config("robust_shac", settings.env, (*OF_CHAIN, "randomize", *OF_LANE))
    check_swing_up("robust_shac", config)
    torch.manual_seed(settings.seed)
    task = DisturbedTask(config, settings)
    collector = DisturbedCollector(task, settings)
    return shac.learn(collector, RobustLearner(task, 1, settings), progress, checkpoint)


RANDOMIZE: dict[str, Any] = {
    "masses": [0.75, 1.25],
    "lengths": [0.75, 1.25],
    "damping": {"low": 0.0, "high": 0.12},  # N m s/rad
    "observation_delay": {"low": 0.0, "high": 1.2},  # steps
    "angle_noise": {"low": 0.0, "high": 0.003},  # rad
    "velocity_noise": {"low": 0.0, "high": 0.5},  # rad/s
}
_TORQUE_NOISE = 0.2  # over the torque limit
TASKS: dict[str, dict[str, Any]] = {"swingup-2-robust": {}}


def settings_of(task: str, **changes: Any) -> Settings:
    """Return the settings for a task such as "swingup-2-robust"."""
    env = env_of_task(task)
    if env["mode"] != "swingup" or "randomize" not in env:
        raise ValueError(f'task must be a robust swing-up, like "swingup-2-robust", got {task!r}')
    limit = EnvConfig(**env).max_torque
    noise = {"torque_noise": {"low": 0.0, "high": round(_TORQUE_NOISE * limit, 3)}}
    env["randomize"] = RANDOMIZE | noise
    return Settings(env=env, **(TASKS.get(task, {}) | changes))
