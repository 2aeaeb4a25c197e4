"""Value iteration in a learned model: the acrobot of dm_control, from a million of its steps.

    python examples/learned_model.py    45 minutes on one core
    python examples/learned_model.py --evaluate acrobot.safetensors  in dm_control, with MuJoCo 3

`value_iteration.py` looks ahead in the exact simulation. Here a network does it, the model. It is
fitted to recorded steps and their exact derivatives (W. M. Czarnecki and others, "Sobolev training
for neural networks", NeurIPS 2017). The actions of the first 100 episodes are random. Nine times
the policy then plays 100 more, and the model is fitted again: a million steps of 0.01 s in all. No
other steps of the simulation are learned from; the learning curve has 100 more episodes a row.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial

import numpy as np
import torch
import value_iteration as exact
from torch import Tensor, nn

from npend_gym.physics import DifferentiableEnsemble
from npend_gym.tools import FloatArray

TICK = 0.01  # s: a step of dm_control
TICKS, SPAN = round(exact.HOLD / TICK), 5  # steps of an action, and of the model
REWARDED = 0.4, 0.8  # parts of its step at whose ends there are rewards
FASTEST = 40.0  # rad/s, of the model
CHANGES = 0.4  # share of random actions that differ from the one before
SIZES = torch.tensor([0.3, 0.3, 1.0, 1.5, 1.0])  # rad, rad/s and 1: changes that matter
DERIVATIVES = 0.3  # weight of their errors


@dataclass(frozen=True)
class Settings(exact.Settings):
    """The settings of a training run; its result depends on nothing else."""

    hidden: int = 192
    episodes: int = 100  # of a round
    rounds: int = 9  # after the one with random actions
    first_round: float = 0.02  # share of the updates after which the policy plays it
    last_round: float = 0.65
    model_hidden: int = 96  # units in each of two layers
    fits: int = 3000  # updates of the model after a round; twice as many after random actions
    model_batch: int = 1024
    model_learning_rate: float = 2e-3  # Adam's at first; falls within a fit, and with the rounds


class Model(nn.Module):
    """A network for what a state changes by in a step of the model, over `scale`."""

    def __init__(self, hidden: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(12, hidden), nn.SiLU(), nn.Linear(hidden, hidden), nn.SiLU(),
            nn.Linear(hidden, 4),
        )  # fmt: skip
        self.register_buffer("speeds", torch.from_numpy(exact.SCALE[4:]))
        self.register_buffer("scale", torch.ones(4))

    def forward(self, given: Tensor) -> Tensor:
        """Return the changes, (B, 4), for angles, speeds and actions, (B, 5)."""
        theta, omega = given[:, :2], given[:, 2:4] / self.speeds
        joint, product = theta[:, :1] - theta[:, 1:], omega[:, :1] * omega[:, 1:]
        seen = theta.sin(), theta.cos(), joint.sin(), joint.cos(), omega, omega**2 / 2, product / 2
        return self.layers(torch.cat([*seen, given[:, 4:]], dim=1))


class LearnedFutures(exact.Futures):
    """Actions are tried in the model."""

    def __init__(self, settings: Settings, model: Model) -> None:
        super().__init__(settings)
        self.model = model

    def step(self, states: FloatArray, actions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the states after an action, (B, 4), and their mean rewards on the way, (B,)."""
        rewards, action = np.zeros(len(states)), actions[:, None]
        for _ in range(TICKS // SPAN):
            given = torch.from_numpy(np.hstack([states, action]).astype(np.float32))
            with torch.no_grad():
                ends = states + (self.model(given) * self.model.scale).numpy()
            ends[:, 2:] = ends[:, 2:].clip(-FASTEST, FASTEST)
            for part in REWARDED:
                rewards += exact.reward(between(states, ends, part), self.lengths)
            states = ends
        return states, rewards / (len(REWARDED) * TICKS // SPAN)


def between(states: FloatArray, ends: FloatArray, part: float) -> FloatArray:
    """Return the angles, (B, 2), in a part of a step of the model: the cubic of Hermite."""
    (theta, omega), (last, speed) = ((each[:, :2], each[:, 2:]) for each in (states, ends))
    rest, span = 1.0 - part, SPAN * TICK
    bent = (theta + part * (2 * theta + span * omega), last + rest * (2 * last - span * speed))
    return rest**2 * bent[0] + part**2 * bent[1]


class Learner(exact.Learner):
    """Learns the model, too."""

    script, settings_type = "examples/learned_model.py", Settings
    changes = (*exact.Learner.changes, "model", "fitter", "recorded")

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        self.model = Model(settings.model_hidden)
        self.fitter = torch.optim.Adam(self.model.parameters())
        self.futures = LearnedFutures(settings, self.model)
        config = self.futures.config
        self.recorder = cache(
            lambda size: DifferentiableEnsemble(config.chain, size, joints=config.actuated)
        )
        self.recorded: list[list[Tensor]] = [[], [], []]  # given, changes, derivatives
        shares = np.geomspace(settings.first_round, settings.last_round, settings.rounds)
        self.due = {round(settings.updates * share) for share in shares}

    def update(self, left: float) -> float:
        """Improve the networks; where a round is due, play it and fit the model before."""
        done = round(self.settings.updates * (1.0 - left))
        if done == 0 or done in self.due:
            self.play(at_random=done == 0)
            self.fit(self.settings.fits * (1 + (done == 0)), left)
        return super().update(left)

    def play(self, *, at_random: bool) -> None:
        """Record episodes in the simulation."""
        size, rng = self.settings.episodes, self.rng
        states, actions = exact.starts(rng, size), rng.uniform(-1.0, 1.0, size)
        for _ in range(round(exact.EPISODE / exact.HOLD)):
            if at_random:
                others = rng.choice([-1.0, 1.0], size), rng.uniform(-1.0, 1.0, size)
                other = np.where(rng.random(size) < 0.5, *others)
                actions = np.where(rng.random(size) < CHANGES, other, actions)
            else:
                actions = self.explored(states)
            states = self.record(states, actions)
            self.keep(states)

    def record(self, states: FloatArray, actions: FloatArray) -> FloatArray:
        """Take an action in each state; record the motion, and return where it ends, (B, 4)."""
        limit, size = self.futures.torque, len(states)
        moved = self.recorder(size)
        moved.set_state(slice(None), states[:, :2], states[:, 2:])
        path, steps = [states], []
        for _ in range(TICKS):
            by = moved.step_jacobian(limit * actions[:, None], TICK, substeps=1)
            moved.set_state(slice(None), by.theta, by.omega)
            path.append(np.hstack([by.theta, by.omega]))
            # an action lasts: the step of state and action, (B, 5, 5)
            steps.append(np.zeros((size, 5, 5)))
            steps[-1][:, :4, :4], steps[-1][:, :4, 4:] = by.A, limit * by.B
            steps[-1][:, 4, 4] = 1.0
        for first in range(TICKS - SPAN + 1):
            through = np.eye(5)
            for step in steps[first : first + SPAN]:
                through = step @ through
            given = np.hstack([path[first], actions[:, None]])
            window = given, path[first + SPAN] - path[first], (through - np.eye(5))[:, :4]
            for kept, array in zip(self.recorded, window, strict=True):
                kept.append(torch.from_numpy(array.astype(np.float32)))
        return path[-1]

    def fit(self, updates: int, left: float) -> None:
        """Fit the model to all that is recorded."""
        given, change, derivatives = (torch.cat(each) for each in self.recorded)
        self.model.scale.copy_(change.std(dim=0))
        batch, rate = self.settings.model_batch, self.settings.model_learning_rate
        scale = self.model.scale
        for update in range(updates):
            self.fitter.param_groups[0]["lr"] = rate * (left * (1.0 - update / updates)) ** 0.5
            chosen = torch.from_numpy(self.rng.integers(len(given), size=batch))
            # a state and its mirror image need opposite actions and have opposite changes
            sign = torch.from_numpy(self.rng.choice([-1.0, 1.0], (batch, 1))).float()
            start = (given[chosen] * sign).requires_grad_()
            errors = self.model(start) - change[chosen] * sign / scale
            # the derivatives of a random sum of the four changes, by all that they depend on
            weights = torch.from_numpy(self.rng.normal(size=(batch, 4))).float()
            by = torch.autograd.grad((weights * errors).sum(), start, create_graph=True)[0]
            expected = torch.einsum("bi,bij->bj", weights / scale, derivatives[chosen])
            loss = (errors**2).mean() + DERIVATIVES * (((by - expected) * SIZES) ** 2).mean()
            self.fitter.zero_grad()
            loss.backward()
            self.fitter.step()


train = partial(exact.train, kind=Learner)

if __name__ == "__main__":
    exact.main(Learner, __doc__)
