"""SHAC: a short-horizon actor-critic that learns through the simulation's exact derivatives.

The actor climbs the gradient of the discounted rewards of a short horizon and of the critic's value
at its end, as in J. Xu et al., "Accelerated policy learning with parallel differentiable
simulation", ICLR 2022. It differs from that paper in three things, all of which save steps:

- A horizon is simulated once and replayed many times, along the Jacobians of its steps. A replay
  ends where the present actor leads too far from the states of these Jacobians.
- The critic learns slopes of the values too, which the way back through a horizon gives.
- Half the episodes start anywhere and a quarter upright; a quarter starts as the task says.
"""

# torch's stubs leave parts unknown
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import nn

from npend_gym import _checks
from npend_gym._threads import one_torch_thread
from npend_gym.envs.keywords import CHAIN_KEYWORDS
from npend_gym.rl.evaluation.episodes import evaluate
from npend_gym.rl.evaluation.recovery import RULES
from npend_gym.rl.policies.policy import Policy
from npend_gym.rl.training.checkpoints import Checkpoint, Stopwatch
from npend_gym.rl.training.keywords import OF_CARTS, OF_CHAIN, used_config, with_wider_ranges
from npend_gym.rl.training.optimizers import Optimizer
from npend_gym.rl.training.short_horizons import Collector, Horizons, TensorTask
from npend_gym.rl.training.tasks import (
    Curve,
    TrainingSettings,
    check_settings,
    env_of_task,
    network,
    policy_of,
)

_FORGOTTEN = 0.1  # of success; a run that loses more returns its best policy


@dataclass(frozen=True)
class Settings(TrainingSettings):
    """The settings of a training run; its result depends on nothing else."""

    total_timesteps: int = 144_000
    num_envs: int = 32
    horizon: int = 10  # steps
    updates: int = 15  # for each horizon of all environments
    batch_size: int = 64  # horizons of an update; a quarter of them are drawn from the newest
    critic_batch_size: int = 512  # states of an update
    memory: int = 40_000  # the last steps, whose horizons are taken again
    trust: float = 1.0  # how far from its state a Jacobian is used [rad, obs_scale rad/s]
    actor_learning_rate: float = 4e-3  # both fall linearly in the last two thirds
    critic_learning_rate: float = 4e-3
    muon_learning_rate: float = 0.0  # of both networks' matrices by Muon; 0: Adam learns them too
    gamma: float = 0.98
    tau: float = 0.05  # how far the target's parameters move to the critic's in an update
    slope_coef: float = 0.02
    max_grad_norm: float = 1.0
    hidden: int = 64
    critic_hidden: int = 128
    obs_scale: tuple[float, float, float] = (1.0, 1.0, 5.0)  # of sines, cosines, speeds [rad/s]
    exploration: float = 0.3  # deviation of the first actions' noise; it falls linearly to zero
    saturation_coef: float = 0.01  # of the actor's output beyond 1.5, where tanh has no slope
    episode: int = 64  # steps in training
    speed: float = 2.5  # deviation of angular velocities of starts anywhere [rad/s]
    knocked: float = 0.0  # share of the episodes that start after a knock-down
    rule: str = "simulation"  # of these knock-downs, as for `recovery`
    turns: float = 0.0  # standard deviation of whole turns by which these turn joints further
    uptime: float = 0.0  # share of the reward that is for a tip where `recovery` counts it as up
    max_speed: float = 0.0  # of joints [rad/s]; beyond, they cost reward; 0: nowhere
    margin: float = 0.0  # by which ranges of `randomize` are wider, see `with_wider_ranges`


class Learner:
    """The actor, the critic and the critic's target, with what has been simulated lately."""

    changes: tuple[str, ...] = ("actor", "critic", "target", "memory", "optimizers", "best")

    def __init__(self, task: TensorTask, actions: int, settings: Settings) -> None:
        self.task: TensorTask = task
        self.settings: Settings = settings
        self.actor: nn.Sequential = network(task.inputs, actions, settings.hidden, last_gain=0.1)
        self.critic: nn.Sequential = network(task.judged, 1, settings.critic_hidden, last_gain=1.0)
        self.target: nn.Sequential = copy.deepcopy(self.critic)
        self.memory: Horizons | None = None
        self.discounts: torch.Tensor = settings.gamma ** torch.arange(settings.horizon + 1.0)
        muon = settings.muon_learning_rate
        self.optimizers: dict[str, Optimizer] = {
            "actor": Optimizer(self.actor, settings.actor_learning_rate, muon, (0.9, 0.95)),
            "critic": Optimizer(self.critic, settings.critic_learning_rate, muon, (0.9, 0.98)),
        }
        self.share: float = 1.0  # of the learning rates
        self.best: dict[str, Any] = {"success": 0.0}  # of the rows of the curve, with its actor

    def sample(self, memory: Horizons) -> Horizons:
        """Return some horizons; a quarter of them are of the last call of the collector."""
        size, count = self.settings.batch_size, len(memory.states)
        chosen = torch.randint(count, (size,))
        newest = count - self.settings.num_envs
        chosen[: size // 4] = torch.randint(newest, count, (size // 4,))
        return Horizons(*(part[chosen] for part in memory))

    def replay(self, old: Horizons) -> tuple[list[torch.Tensor], torch.Tensor, torch.Tensor]:
        """Replay horizons with the present actor, along the Jacobians of their steps.

        Returned are the states, (horizons, 2c), one more than steps; the outputs of the actor,
        (horizons, steps, actions), before tanh; and `near`, (horizons, steps + 1): 1 where the
        Jacobians hold up to this state and the episode goes on, else 0.
        """
        deviation = torch.zeros_like(old.states[:, 0]).requires_grad_()
        states, outputs = [old.states[:, 0] + deviation], []
        near = [torch.ones(len(deviation))]
        alive = ~self.task.ended(old.states, old.context[:, None])
        for t in range(self.settings.horizon):
            outputs.append(self.actor(self.task.observe(states[-1], old.context)))
            change = outputs[-1].tanh() - old.actions[:, t]
            change = torch.cat([states[-1] - old.states[:, t], change], 1)
            deviation = (old.jacobians[:, t] @ change[..., None])[..., 0]
            states.append(old.states[:, t + 1] + deviation)
            size = (deviation.detach() / self.task.state_scale).abs().amax(-1)
            near.append(near[-1] * (size < self.settings.trust) * alive[:, t + 1])
        return states, torch.stack(outputs, 1), torch.stack(near, 1)

    def update(self, memory: Horizons) -> dict[str, float]:
        """Improve actor and critic with some horizons."""
        settings, parameters = self.settings, [*self.actor.parameters()]
        horizons = self.sample(memory)
        states, outputs, near = self.replay(horizons)
        reached, taken = torch.stack(states[1:], 1), near[:, :-1]
        last = taken - nn.functional.pad(near[:, 1:-1], (0, 1))  # the value stands for what follows
        context = horizons.context[:, None].expand(-1, settings.horizon, -1)
        rewards = self.task.reward(reached, outputs.tanh(), context)
        values = self.target(self.task.critic_inputs(reached, context)).squeeze(-1)
        values = values * ~self.task.ended(reached, context)
        gain = (taken * self.discounts[:-1] * rewards + last * self.discounts[1:] * values).sum()
        excess = (outputs.abs() - 1.5).clamp(min=0.0).square().sum()
        gradients = torch.autograd.grad(
            gain - settings.saturation_coef * excess, parameters + states[:-1]
        )
        for parameter, gradient in zip(parameters, gradients, strict=False):
            parameter.grad = -gradient / len(taken)
        self.improve(self.optimizers["actor"])
        with torch.no_grad():
            slopes = torch.stack(gradients[len(parameters) :], 1) / self.discounts[:-1, None]
            returns, following = torch.empty_like(rewards), torch.zeros(len(rewards))
            for t in reversed(range(settings.horizon)):
                following = torch.where(last[:, t] > 0, values[:, t], following)
                following = returns[:, t] = rewards[:, t] + settings.gamma * following
            chosen = taken.flatten().nonzero()[:, 0]
            chosen = chosen[torch.randperm(len(chosen))[: settings.critic_batch_size]]
            steps = torch.stack(states[:-1], 1).detach(), context, returns, slopes
            steps = [part.flatten(0, 1)[chosen] for part in steps]
        error = self.fit(*steps)
        return {"value": float(returns.mean()), "critic_error": error}

    def fit(
        self,
        states: torch.Tensor,
        context: torch.Tensor,
        returns: torch.Tensor,
        slopes: torch.Tensor,
    ) -> float:
        """Fit the critic to returns (B,) and slopes (B, 2c); return its mean squared error."""
        states.requires_grad_()
        values = self.critic(self.task.critic_inputs(states, context)).squeeze(-1)
        (own,) = torch.autograd.grad(values.sum(), states, create_graph=True)
        difference = ((own - slopes) * self.task.state_scale).square().sum(-1)
        error = (values - returns).square().mean()
        # a square for small errors, and no more than proportional to large ones
        loss = error + self.settings.slope_coef * ((1.0 + 10.0 * difference).sqrt() - 1.0).mean()
        loss.backward()
        self.improve(self.optimizers["critic"])
        with torch.no_grad():
            pairs = zip(self.target.parameters(), self.critic.parameters(), strict=True)
            for parameter, latest in pairs:
                parameter.lerp_(latest, self.settings.tau)
        return float(error.detach())

    def improve(self, optimizer: Optimizer) -> None:
        """Change a network along its gradients, which are clipped."""
        nn.utils.clip_grad_norm_(optimizer.network.parameters(), self.settings.max_grad_norm)
        optimizer.step(self.share)

    def keep(self, row: dict[str, float]) -> None:
        """Keep the actor of a row of the curve, unless an earlier one succeeded more often."""
        if row["success"] >= self.best["success"]:
            self.best = row | {"actor": copy.deepcopy(self.actor.state_dict())}

    def final(self, last: dict[str, Any]) -> Policy:
        """Policy of the last row of the curve; if it succeeds much less, of the best one."""
        if last["success"] < self.best["success"] - _FORGOTTEN:
            last = self.best.copy()
            self.actor.load_state_dict(last.pop("actor"))
        return self.policy(last)

    def policy(self, last: dict[str, Any]) -> Policy:
        """Return the actor as a policy."""
        made = policy_of(self.actor, self.task.obs_scale, "shac", self.settings, last)
        return replace(made, output="tanh")


def remembered(memory: Horizons | None, new: Horizons, steps: int) -> Horizons:
    """Return old horizons and new ones, without the oldest beyond a number of steps."""
    if memory is None:
        return new
    most = steps // new.jacobians.shape[1]
    return Horizons(*(torch.cat(pair)[-most:] for pair in zip(memory, new, strict=True)))


@one_torch_thread()
def train(
    settings: Settings, progress: str | None = None, checkpoint: Checkpoint | None = None
) -> tuple[Policy, Curve]:
    """Return the trained policy and its learning curve, a row for every tenth.

    Its seconds are processor time. The episodes that it tells of are played without noise and teach
    nothing; neither their steps nor their time are counted. If in the end far fewer of them succeed
    than in an earlier row, the policy is that of the best row.
    """
    uses = (*OF_CHAIN, *OF_CARTS, "reward_type", "randomize", "observe_context")
    config = used_config("shac", settings.env, uses)
    if config.joints.size == 0:
        raise ValueError(f"mode must have a motor for shac, got {config.mode!r}")
    drawn = settings.env.get("randomize") or {}
    for name in drawn:
        if name not in (*CHAIN_KEYWORDS, "max_torque"):
            raise ValueError(
                f"shac does not use randomize[{name!r}], only parameters of the chain and "
                "max_torque: leave it out, or train by imitation"
            )
    check_settings(settings, below_one=("gamma", "uptime"))
    _checks.choice("rule", settings.rule, tuple(RULES))
    for name in ("knocked", "tau"):
        if getattr(settings, name) > 1.0:
            raise ValueError(f"{name} must lie from 0 to 1, got {getattr(settings, name)}")
    _checks.positive_number("trust", settings.trust)
    # slopes are divided by the discounts
    _checks.positive_number("gamma to the power of horizon", settings.gamma**settings.horizon)
    _checks.count("memory", settings.memory, low=settings.num_envs * settings.horizon)
    torch.manual_seed(settings.seed)
    config = with_wider_ranges(config, settings.margin)  # so that their ends are common
    parts_of_reward = settings.uptime, settings.max_speed
    task = TensorTask(config, settings.gamma, settings.obs_scale, *parts_of_reward)
    collector = Collector(config, task, settings)
    learner = Learner(task, config.joints.size, settings)
    collector.lanes.step_jacobian(0.0, config.dt)  # compiles, where not done yet
    batch_size = settings.num_envs * settings.horizon
    num_iterations = max(1, settings.total_timesteps // batch_size)
    clock, curve = Stopwatch(), Curve()
    parts = {
        "learner": learner, "collector": collector, "curve": curve, "clock": clock,
        "random": torch.default_generator,
    }  # fmt: skip
    checkpoint = checkpoint or Checkpoint(settings)
    for k in checkpoint.rounds(parts, num_iterations, progress, "horizons"):
        left = 1.0 - (k - 1) / num_iterations
        learner.share = min(1.0, 1.5 * left + 0.02)
        new = collector.collect(learner.actor, settings.exploration * left)
        learner.memory = remembered(learner.memory, new, settings.memory)
        means = [learner.update(learner.memory) for _ in range(settings.updates)][-1]
        if k % max(1, num_iterations // 10) == 0 or k == num_iterations:
            seconds = clock.seconds
            curve.append({"steps": k * batch_size, "seconds": round(seconds, 2)})
            policy = learner.policy({})
            trial = evaluate(policy, policy.env, episodes=20, seed=0)
            shown = {"return": float(trial.returns.mean()), "success": trial.success_rate} | means
            curve[-1] |= {name: round(value, 6) for name, value in shown.items()}
            learner.keep(curve[-1])
            clock.seconds = seconds
    return learner.final(curve[-1]), curve


# RealAIGym's robot is stronger, and thrown about by `recovery`: speeds are higher, and hesitating
# costs more
_ROBOT: dict[str, Any] = {
    "total_timesteps": 320_000,
    "batch_size": 96,
    "memory": 80_000,
    "actor_learning_rate": 3e-3,
    "critic_learning_rate": 3e-3,
    "gamma": 0.985,
    "hidden": 128,
    "obs_scale": (1.0, 1.0, 8.0),
    "episode": 80,
    "speed": 7.0,
    "knocked": 0.7,
}
_RECOVERY = _ROBOT | {
    "total_timesteps": 480_000, "hidden": 192, "muon_learning_rate": 0.01, "knocked": 0.85,
    "uptime": 0.7,
}  # fmt: skip
_HARDWARE = _RECOVERY | {  # knock-downs leave chains nearly at rest, and speed causes more of them
    "total_timesteps": 240_000, "knocked": 0.8, "rule": "hardware", "speed": 4.0, "max_speed": 18.0,
}  # fmt: skip
# `recovery` turns joints back by all their whole turns: fast starts, which differ more
_TURNED = {"num_envs": 64, "batch_size": 128, "obs_scale": (1.0, 1.0, 12.0)}
TASKS: dict[str, dict[str, Any]] = {
    "swingup-1": {"total_timesteps": 20_000},
    "swingup-2": {"total_timesteps": 144_000},
    "swingup-1-robust": {"total_timesteps": 160_000, "episode": 128, "margin": 1.0},
    "balance-1": {"total_timesteps": 20_000},
    "balance-2": {"total_timesteps": 60_000},
    "balance-3": {"total_timesteps": 144_000},
    "swingup-1-cart": {"total_timesteps": 20_000},
    "balance-1-cart": {"total_timesteps": 20_000},
    "balance-2-cart": {"total_timesteps": 60_000},
    "balance-3-cart": {"total_timesteps": 144_000},
    "calm-1": {"total_timesteps": 40_000},
    "calm-2": {"total_timesteps": 60_000, "knocked": 0.5},
    "calm-3": {"total_timesteps": 60_000},
    "calm-5": {"total_timesteps": 60_000},
    "calm-10": {"total_timesteps": 144_000},
    "swingup-2-pendubot": _ROBOT,
    "swingup-2-pendubot-recovery": _RECOVERY,
    "swingup-2-pendubot-hardware": _HARDWARE | _TURNED | {"total_timesteps": 480_000, "turns": 0.7},
    "swingup-2-acrobot": _ROBOT,
    "swingup-2-acrobot-hardware": _HARDWARE,
    "swingup-2-acrobot-recovery": _RECOVERY | _TURNED | {"total_timesteps": 640_000, "turns": 1.2},
}


def settings_of(task: str, **changes: Any) -> Settings:
    """Return the settings for a task such as "swingup-2"."""
    fields: dict[str, Any] = {"env": env_of_task(task), **TASKS.get(task, {}), **changes}
    return Settings(**fields)
