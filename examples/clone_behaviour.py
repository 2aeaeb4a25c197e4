"""Behaviour cloning: a network learns the actions of a data set, and is evaluated.

npend dataset swingup-2 --kind medium
python examples/clone_behaviour.py npend/swingup-2/medium-v0
"""

import argparse

import gymnasium as gym
import minari
import numpy as np
import torch

from npend_gym.rl import Policy, evaluate
from npend_gym.rl.training import network

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("dataset", choices=minari.list_local_datasets(), metavar="DATASET")
parser.add_argument("epochs", type=int, nargs="?", default=40)
arguments = parser.parse_args()
dataset, epochs = minari.load_dataset(arguments.dataset), arguments.epochs
if not isinstance(dataset.action_space, gym.spaces.Box):
    parser.error(f"actions must be continuous, got {dataset.action_space}")
if epochs < 1:
    parser.error(f"epochs must be at least 1, got {epochs}")
torch.set_num_threads(1)
torch.manual_seed(0)
episodes = list(dataset)
observations = torch.from_numpy(np.concatenate([e.observations[:-1] for e in episodes]))
actions = torch.from_numpy(np.concatenate([e.actions for e in episodes]))
scale = observations.std(0) + 1e-3
net = network(observations.shape[1], actions.shape[1], 128, last_gain=0.1)
optimizer = torch.optim.Adam(net.parameters(), lr=2e-3)
schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, epochs)
for _ in range(epochs):
    for batch in torch.randperm(len(actions)).split(512):
        loss = (net(observations[batch] / scale) - actions[batch]).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    schedule.step()
linear = [layer for layer in net if isinstance(layer, torch.nn.Linear)]
weights, biases = ([getattr(each, name).detach().numpy() for each in linear]
                   for name in ("weight", "bias"))  # fmt: skip
policy = Policy(scale.numpy(), weights, biases, dict(dataset.spec.env_spec.kwargs))
found = evaluate(policy, policy.env)
print(
    f"loss {loss.item():.5f}, success {found.success_rate:.0%}, return {found.returns.mean():.0f}"
)
policy.save("cloned.safetensors")
