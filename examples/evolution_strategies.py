"""Evolution strategies: a small policy from the returns of whole episodes, without gradients.

Run it with `python examples/evolution_strategies.py calm-20`: it writes `calm-20.safetensors`, a
policy of plain numbers for `npend evaluate`, and `calm-20.csv`, its learning curve. It is also a
trainer as a package of your own would offer it to `npend train`, see docs/howto/own_trainer.md.

Salimans, Ho, Chen, Sidor, Sutskever, arXiv:1703.03864, with all candidates side by side in one
vector environment.

A long chain is slow and its motor is strong. Noise that is new in every step whips the
rods and hides what an action does to the energy seconds later; noise on the weights of the policy
stays the same for a whole episode. Three things leave fewer numbers to find:

- The mirror image of a chain needs the opposite action, so the weights of the cosines stay zero.
- Weights vary smoothly along the chain: a cubic polynomial, and a weight of its own for the first
  rod.
- Two units add up, each with a limit that is found too. Large swings need a weak motor that does
  not whip the chain, small ones a strong response.

With 50 rods hardly any weights near zero are stable. So from 40 rods on the first unit starts as
LQR whose cost is the energy. LQR's gains are one more row that the weights may vary along.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.linalg import block_diag

from npend_gym.envs import EnvConfig
from npend_gym.physics import mass_matrix
from npend_gym.report import write_csv
from npend_gym.rl import Policy, episode_seeds, lqr, setting_of
from npend_gym.rl.training import (
    OF_ENV,
    Checkpoint,
    Curve,
    Stopwatch,
    TrainingSettings,
    check_settings,
    env_of_task,
    evaluation_env,
    made_by,
    used_config,
)

FloatArray, BoolArray = NDArray[np.float64], NDArray[np.bool_]
SCRIPT = "examples/evolution_strategies.py"  # named in the record of a policy
TASKS: dict[str, dict[str, Any]] = {
    "calm-5": {"num_steps": 400},
    "calm-10": {"num_steps": 500},
    "calm-20": {"updates": 160, "num_steps": 800, "noise_std": 0.007, "learning_rate": 0.01},
    "calm-50": {
        "updates": 150, "pairs": 24, "num_steps": 2400, "noise_std": 0.006, "learning_rate": 0.006
    },
}  # fmt: skip
LIMITS = np.array([0.1, 0.5])  # of the units at first, over the motor's
DEGREE, STEEP = 3, 10.0  # of the polynomial; how much faster logarithms of limits change
LONG = 40  # rods: from here on the first unit starts as LQR, with these limits, and
LIMITS_OF_LONG, ACTION_WEIGHT = np.array([0.2, 0.1]), 100.0
GENTLE = 0.1  # times the changes of limits and of the weights of speeds


@dataclass(frozen=True)
class Settings(TrainingSettings):
    """The settings of a training run; its result depends on nothing else."""

    updates: int = 60
    pairs: int = 32  # of candidates in an update, with opposite noise
    num_steps: int = 1000  # of an episode
    noise_std: float = 0.02  # on the candidates' parameters
    learning_rate: float = 0.02  # Adam's, falls linearly to zero


def settings_of(task: str, **changes: Any) -> Settings:
    """Return the settings for a task such as "calm-20"."""
    return Settings(env=env_of_task(task), **(TASKS.get(task, {}) | changes))


def smooth(config: EnvConfig) -> FloatArray:
    """Return rows of weights that the weights of a unit are a sum of, (parameters, inputs)."""
    n, degree = config.n, min(DEGREE, config.n - 1)
    rows = [np.eye(n)[:1], legendre.legvander(np.linspace(-1.0, 1.0, n), degree).T]
    of_rods = np.linalg.qr(np.concatenate(rows).T)[0].T
    of_speeds = [of_rods] * config.observe_velocities
    rest = np.eye(config.observed - (2 + len(of_speeds)) * n)  # what a cart adds is odd too
    return block_diag(np.hstack([of_rods, np.zeros_like(of_rods)]), *of_speeds, rest)


def with_lqr(config: EnvConfig, basis: FloatArray) -> FloatArray:
    """Return `basis` with gentler changes of speeds' weights, and LQR's gains as a last row."""
    n, chain = config.n, config.chain
    if config.has_cart or not config.observe_velocities:
        raise ValueError(f"n must be below {LONG} on a cart or without velocities, got {n}")
    gentle = basis * np.repeat([1.0, GENTLE], len(basis) // 2)[:, None]
    cost = block_diag(np.diag(chain.gravity * chain.lift), mass_matrix(chain, np.zeros(n)))
    gains = lqr(config, 0.0, Q=cost / cost[0, 0], R=[ACTION_WEIGHT]).gain[0]
    return np.vstack([gentle, -np.concatenate([gains[:n], np.zeros(n), gains[n:]])])


class Search:
    """A policy that follows the returns of candidates near it."""

    changes = ("rng", "parameters", "moments")

    def __init__(self, settings: Settings, config: EnvConfig) -> None:
        self.settings, self.rng = settings, np.random.default_rng(settings.seed)
        count = settings.updates + 1
        # that of an update is the same for all candidates
        self.seeds = episode_seeds("training", count, run=settings.seed, spacing=1000)
        self.basis, self.limits, self.steep = smooth(config), LIMITS, STEEP
        if config.n >= LONG:
            self.basis, self.limits = with_lqr(config, self.basis), LIMITS_OF_LONG
            self.steep *= GENTLE
        # of each unit: of the rows of `basis`, then the logarithm of its limit over `steep`
        self.parameters = np.zeros((len(LIMITS), len(self.basis) + 1))
        if config.n >= LONG:
            self.parameters[0, -2] = 1.0  # of LQR's gains
        self.moments = np.zeros((2, *self.parameters.shape))  # of Adam

    def units(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return weights (..., units, inputs) and limits (..., units) of parameters."""
        limits = self.limits * np.exp(self.steep * parameters[..., -1])
        return parameters[..., :-1] @ self.basis, limits

    def update(self, envs: Any, update: int) -> tuple[FloatArray, BoolArray]:
        """Improve the policy; return the returns and successes of the candidates."""
        settings = self.settings
        noise = self.rng.normal(size=(settings.pairs, *self.parameters.shape))
        candidates = self.parameters + settings.noise_std * np.concatenate([noise, -noise])
        returns, success = play(
            envs, *self.units(candidates), settings.num_steps, self.seeds[update]
        )
        ranks = returns.argsort().argsort() / (returns.size - 1)
        better = ranks[: settings.pairs] - ranks[settings.pairs :]
        gradient = np.tensordot(better, noise, 1) / settings.pairs
        first_moment, second_moment = self.moments
        first_moment[:] = 0.9 * first_moment + 0.1 * gradient
        second_moment[:] = 0.99 * second_moment + 0.01 * gradient**2
        mean, square = first_moment / (1.0 - 0.9**update), second_moment / (1.0 - 0.99**update)
        learning_rate = settings.learning_rate * (1.0 - (update - 1) / settings.updates)
        self.parameters += learning_rate * (mean / (np.sqrt(square) + 1e-8))
        return returns, success


def train(
    settings: Settings, progress: str | None = None, checkpoint: Checkpoint | None = None
) -> tuple[Policy, Curve]:
    """Return the trained policy and its learning curve, a row for every tenth update."""
    check_settings(settings)
    keywords = settings.env | {"max_episode_steps": None}
    config = used_config("es", settings.env, OF_ENV - {"observe_context"})
    if config.joints.size != 1 or config.observes_goals:
        raise ValueError(
            "actuated and mode must give es one motor and no goal, because its policy is one odd "
            f"function; got {config.joints.size} motors and {config.mode!r}"
        )
    envs = setting_of(keywords).make(2 * settings.pairs)
    search = Search(settings, config)
    curve: Curve = []
    clock = Stopwatch()
    parts = {"search": search, "curve": curve, "clock": clock}
    checkpoint = checkpoint or Checkpoint(settings)
    for update in checkpoint.rounds(parts, settings.updates, progress, "update"):
        returns, success = search.update(envs, update)
        if update % 10 == 0 or update == settings.updates:
            curve.append({
                "steps": update * returns.size * settings.num_steps,
                "seconds": round(clock.seconds, 2),
                "return": round(float(returns.mean()), 4),
                "success": round(float(success.mean()), 4),
                "std": settings.noise_std,
            })  # fmt: skip
    envs.close()
    return policy_of(*search.units(search.parameters), settings, curve[-1]), curve


def play(
    envs: Any, weights: FloatArray, limits: FloatArray, steps: int, seed: int
) -> tuple[FloatArray, BoolArray]:
    """Play an episode with each candidate; return the returns and successes, (candidates,).

    Candidates have weights (candidates, units, inputs) and limits (candidates, units).
    """
    observation, info = envs.reset(seed=[seed] * len(weights))
    returns, lasts = np.zeros(len(weights)), np.ones(len(weights), np.bool_)
    for _ in range(steps):
        signals = np.einsum("bk,bjk->bj", observation, weights)
        action = (limits * np.tanh(signals / limits)).sum(axis=1).clip(-1.0, 1.0)
        observation, reward, terminated, _, info = envs.step(action[:, None])
        returns += np.where(lasts, reward, 0.0)
        lasts &= ~terminated  # another episode begins after it
    return returns, info["success"] & lasts


def policy_of(
    weights: FloatArray, limits: FloatArray, settings: Settings, last: dict[str, Any]
) -> Policy:
    """Return the units as a network of plain arrays, with what made it.

    Episodes of its environment last as long as those of the training where these are longer.
    """
    steps = settings.num_steps
    return Policy(
        scale=np.ones(weights.shape[1], np.float32),
        weights=[np.float32(weights / limits[:, None]), np.float32(limits[None])],
        biases=[np.zeros(len(limits), np.float32), np.zeros(1, np.float32)],
        env=evaluation_env(settings.env) | ({"max_episode_steps": steps} if steps > 1000 else {}),
        provenance=made_by(SCRIPT, settings, last),
    )


def main() -> None:
    """Train one policy as the command line says, and write it to a file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", help='mode and number of rods, as in "calm-20"')
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--updates", type=int, help="of the weights")
    parser.add_argument("--out", type=Path, default=Path(), help="folder of the files")
    arguments = parser.parse_args()
    if arguments.updates is not None and arguments.updates < 1:
        parser.error(f"--updates must be at least 1, got {arguments.updates}")
    changes = {"updates": arguments.updates} if arguments.updates else {}
    settings = settings_of(arguments.task, seed=arguments.seed, **changes)
    policy, curve = train(settings, arguments.task)
    path = arguments.out / f"{arguments.task}.safetensors"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_csv(path.with_suffix(".csv"), curve)
    policy.save(path)
    print(f"{path}: {curve[-1]}")


if __name__ == "__main__":
    main()
