"""PPO by TorchRL, on the native vector environment.

Run it with `python examples/train_torchrl.py swingup-1`: it writes `swingup-1.npz`, a policy of
plain numbers for `examples/evaluate.py`, and `swingup-1.csv`, its learning curve. It wants
`pip install "npend-gym[rl]" torchrl`.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import torch
from tensordict.nn import AddStateIndependentNormalScale, TensorDictModule
from torch import nn
from torchrl.collectors import Collector
from torchrl.data import LazyTensorStorage, SamplerWithoutReplacement, TensorDictReplayBuffer
from torchrl.envs import (
    Compose,
    GymWrapper,
    ObservationNorm,
    RewardScaling,
    RewardSum,
    TransformedEnv,
)
from torchrl.modules import IndependentNormal, ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE
from tqdm import tqdm
from train_cleanrl import Settings, as_policy, main, network

from npend_gym.rl.policies import Policy


def make_env(settings: Settings) -> TransformedEnv:
    """Return all environments as one; TorchRL itself says which of them begin anew."""
    envs = gym.make_vec(
        "npend_gym:NPendulum-v0", settings.num_envs, autoreset_mode="DISABLED", **settings.env
    )
    env = GymWrapper(envs, device="cpu")
    env.set_seed(1000 * settings.seed)  # these are for training, those from 10^6 on for evaluation
    return TransformedEnv(
        env,
        Compose(
            RewardSum(),  # the return of an episode
            RewardScaling(0.0, 1.0 - settings.discount),  # so that values are of order one
            ObservationNorm(0.0, 1.0 / scale(settings), in_keys=["observation"]),
        ),
    )


def scale(settings: Settings) -> torch.Tensor:
    """Return what the observation is divided by."""
    return torch.tensor(settings.scale).repeat_interleave(settings.env["n"])


def train(settings: Settings, progress: str | None = None) -> tuple[Policy, list[dict[str, Any]]]:
    """Return the trained policy and its learning curve, a row for every update."""
    torch.set_num_threads(1)  # two are slower for networks this small
    torch.manual_seed(settings.seed)
    env = make_env(settings)
    inputs, actions = env.observation_spec["observation"].shape[-1], env.action_spec.shape[-1]
    mean = network(inputs, actions, settings.hidden, last_gain=0.01)
    drawn = nn.Sequential(mean, AddStateIndependentNormalScale(actions, scale_mapping="exp"))
    actor = ProbabilisticActor(
        TensorDictModule(drawn, in_keys=["observation"], out_keys=["loc", "scale"]),
        in_keys=["loc", "scale"],
        distribution_class=IndependentNormal,
        return_log_prob=True,
    )
    critic = ValueOperator(network(inputs, 1, settings.hidden, last_gain=1.0))
    judge = GAE(gamma=settings.discount, lmbda=settings.trace, value_network=critic)
    loss = ClipPPOLoss(
        actor,
        critic,
        clip_epsilon=settings.clip,
        entropy_coeff=0.0,
        critic_coeff=0.5,
        loss_critic_type="l2",
        normalize_advantage=True,
    )
    optimizer = torch.optim.Adam(loss.parameters(), settings.learning_rate, eps=1e-5, fused=True)
    batch = settings.num_envs * settings.rollout
    updates = max(1, settings.total_steps // batch)
    slower = torch.optim.lr_scheduler.LinearLR(optimizer, 1.0, 0.0, updates)
    memory = TensorDictReplayBuffer(
        storage=LazyTensorStorage(batch),
        sampler=SamplerWithoutReplacement(),
        batch_size=settings.minibatch,
    )
    collector = Collector(env, actor, frames_per_batch=batch, total_frames=updates * batch)
    curve: list[dict[str, Any]] = []
    last: float | None = None  # mean return of the episodes that ended last
    for seen in tqdm(collector, progress, updates, disable=None, unit="update"):
        judge(seen)
        memory.extend(seen.reshape(-1))
        for _ in range(settings.epochs):
            for some in memory:
                parts = loss(some)
                optimizer.zero_grad()
                (parts["loss_objective"] + parts["loss_critic"]).backward()
                nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
                optimizer.step()
        slower.step()
        ended = seen["next", "episode_reward"][seen["next", "done"]]
        last = round(float(ended.mean()), 4) if len(ended) > 0 else last
        curve.append({"steps": (len(curve) + 1) * batch, "return": last})
    collector.shutdown()
    return as_policy(mean, scale(settings), "train_torchrl.py", settings, curve[-1]), curve


if __name__ == "__main__":
    main(train, __doc__)
