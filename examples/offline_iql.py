"""Implicit Q-learning by TorchRL: a policy from data sets of episodes, which is evaluated.

npend dataset calm-1 --kind random
python examples/offline_iql.py npend/calm-1/random-v0

It needs `pip install "npend-gym[rl]" "minari[create]" pyarrow torchrl`. Kostrikov, Nair, Levine,
arXiv:2110.06169: the policy clones the actions of the data, the more the better they turned out.
"""

from __future__ import annotations

import argparse
from typing import Any

import gymnasium as gym
import minari
import numpy as np
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.modules import IndependentNormal, ProbabilisticActor, ValueOperator
from torchrl.objectives import IQLLoss, SoftUpdate

from npend_gym.rl import Policy, evaluate
from npend_gym.rl.training import network

GAMMA, BATCH, HIDDEN = 0.99, 256, 128
DEVIATION = 0.3  # of the actions that the policy takes for as good as its own


class Gaussian(nn.Module):
    """A network for the mean action, with a constant deviation."""

    def __init__(self, net: nn.Module) -> None:
        super().__init__()
        self.net = net

    def forward(self, observation: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return mean and deviation."""
        mean = self.net(observation)
        return mean, torch.full_like(mean, DEVIATION)


class Joined(nn.Module):
    """A network of observation and action."""

    def __init__(self, net: nn.Module) -> None:
        super().__init__()
        self.net = net

    def forward(self, *parts: torch.Tensor) -> torch.Tensor:
        """Return the value."""
        return self.net(torch.cat(parts, -1))


def transitions(episodes: list[Any], scale: torch.Tensor) -> TensorDict:
    """Return the steps of episodes as TorchRL has them."""

    def column(name: str) -> torch.Tensor:
        return torch.from_numpy(np.concatenate([getattr(each, name) for each in episodes]))[:, None]

    shown = [torch.from_numpy(each.observations) / scale for each in episodes]
    ends = column("terminations")
    following = {
        "observation": torch.cat([each[1:] for each in shown]),
        "reward": column("rewards").float(),
        "terminated": ends,
        "done": ends,  # a time limit is no end: the value of the next state counts
    }
    actions = torch.from_numpy(np.concatenate([each.actions for each in episodes]))
    first = torch.cat([each[:-1] for each in shown])
    return TensorDict({"observation": first, "action": actions, "next": following}, len(actions))


def train(data: TensorDict, updates: int, temperature: float) -> nn.Module:
    """Return the network of a policy after this many updates."""
    observed, joints = data["observation"].shape[1], data["action"].shape[1]
    net = network(observed, joints, HIDDEN, last_gain=0.1)
    actor = ProbabilisticActor(
        TensorDictModule(Gaussian(net), ["observation"], ["loc", "scale"]),
        in_keys=["loc", "scale"],
        distribution_class=IndependentNormal,
    )
    loss = IQLLoss(
        actor,
        ValueOperator(
            Joined(network(observed + joints, 1, HIDDEN, 1.0)), ["observation", "action"]
        ),
        value_network=ValueOperator(Joined(network(observed, 1, HIDDEN, 1.0)), ["observation"]),
        temperature=temperature,
        expectile=0.7,
        loss_function="l2",
    )
    loss.make_value_estimator(gamma=GAMMA)
    target = SoftUpdate(loss, tau=0.005)
    optimizer = torch.optim.Adam(loss.parameters(), lr=1e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, updates)
    for _ in range(updates):
        found = loss(data[torch.randint(len(data), (BATCH,))])
        total = found["loss_actor"] + found["loss_qvalue"] + found["loss_value"]
        optimizer.zero_grad()
        total.backward()
        optimizer.step()
        schedule.step()
        target.step()
    trained = loss.actor_network_params["module", "0", "module", "net"]
    trained.to_module(net)
    return net


def main() -> None:
    """Train one policy and evaluate it in held-out episodes."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    known = minari.list_local_datasets()
    parser.add_argument("datasets", choices=known, nargs="+", metavar="DATASET")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--updates", type=int, default=10_000)
    parser.add_argument("--temperature", type=float, default=3.0, help="0 clones all actions alike")
    arguments = parser.parse_args()
    datasets = [minari.load_dataset(name) for name in arguments.datasets]
    if not isinstance(datasets[0].action_space, gym.spaces.Box):
        parser.error(f"actions must be continuous, got {datasets[0].action_space}")
    torch.set_num_threads(1)  # two are slower for networks this small
    torch.manual_seed(arguments.seed)
    episodes = [each for dataset in datasets for each in dataset]
    scale = torch.from_numpy(np.concatenate([each.observations for each in episodes]).std(0))
    net = train(transitions(episodes, scale + 1e-3), arguments.updates, arguments.temperature)
    linear = [layer for layer in net if isinstance(layer, nn.Linear)]
    weights = [layer.weight.detach().numpy() for layer in linear]
    biases = [layer.bias.detach().numpy() for layer in linear]
    env = dict(datasets[0].spec.env_spec.kwargs)
    policy = Policy((scale + 1e-3).numpy(), weights, biases, env)
    found = evaluate(policy, policy.env)
    data = float(np.mean([each.rewards.sum() for each in episodes]))
    print(
        f"return {found.returns.mean():.0f} (data {data:.0f}), success "
        f"{found.success.sum()}/{found.success.size}"
    )
    policy.save("offline.safetensors")


if __name__ == "__main__":
    main()
