"""Evolution strategies: a linear policy from the returns of whole episodes, without gradients.

Run it with `python examples/evolution_strategies.py calm-20`: it writes `calm-20.safetensors`, a
policy of plain numbers for `npend evaluate`, and `calm-20.csv`, its learning curve. It is also a
trainer as a package of your own would offer it to `npend train`, see docs/howto/own_trainer.md.

Salimans, Ho, Chen, Sidor, Sutskever, arXiv:1703.03864, with all candidates side by side in one
vector environment.

A long chain is slow and its motor is strong. Noise that is new in every step whips the
rods and hides what an action does to the energy seconds later; noise on the weights of the policy
stays the same for a whole episode. The mirror image of a chain needs the opposite action, so the
weights of the cosines stay zero: that is a third fewer to find, and no torque remains at rest.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym.envs import EnvConfig
from npend_gym.report import write_csv
from npend_gym.rl import Policy, episode_seeds, setting_of
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
    "calm-5": {},
    "calm-10": {},
    "calm-20": {"updates": 80, "noise_std": 0.01, "learning_rate": 0.01},
}


@dataclass(frozen=True)
class Settings(TrainingSettings):
    """The settings of a training run; its result depends on nothing else."""

    updates: int = 60
    pairs: int = 32  # of candidates in an update, with opposite noise
    num_steps: int = 1000  # of an episode
    noise_std: float = 0.02  # on the candidates' weights
    learning_rate: float = 0.02  # Adam's, falls linearly to zero


def settings_of(task: str, **changes: Any) -> Settings:
    """Return the settings for a task such as "calm-20"."""
    return Settings(env=env_of_task(task), **(TASKS.get(task, {}) | changes))


class Search:
    """A linear policy that follows the returns of candidates near it."""

    changes = ("rng", "weights", "moments")

    def __init__(self, settings: Settings, config: EnvConfig) -> None:
        self.settings, self.rng = settings, np.random.default_rng(settings.seed)
        count, inputs = settings.updates + 1, config.observed
        # that of an update is the same for all candidates
        self.seeds = episode_seeds("training", count, run=settings.seed, spacing=1000)
        self.weights = np.zeros(inputs)
        self.moments = np.zeros((2, inputs))  # of Adam
        self.odd = np.ones(inputs)  # sines, cosines, speeds; what a cart adds is odd too
        self.odd[config.n : 2 * config.n] = 0.0

    def update(self, envs: Any, update: int) -> tuple[FloatArray, BoolArray]:
        """Improve the policy; return the returns and successes of the candidates."""
        settings = self.settings
        noise = self.odd * self.rng.normal(size=(settings.pairs, self.weights.size))
        candidates = self.weights + settings.noise_std * np.concatenate([noise, -noise])
        returns, success = play(envs, candidates, settings.num_steps, self.seeds[update])
        ranks = returns.argsort().argsort() / (returns.size - 1)
        gradient = (ranks[: settings.pairs] - ranks[settings.pairs :]) @ noise / settings.pairs
        first_moment, second_moment = self.moments
        first_moment[:] = 0.9 * first_moment + 0.1 * gradient
        second_moment[:] = 0.99 * second_moment + 0.01 * gradient**2
        mean, square = first_moment / (1.0 - 0.9**update), second_moment / (1.0 - 0.99**update)
        learning_rate = settings.learning_rate * (1.0 - (update - 1) / settings.updates)
        self.weights += learning_rate * (mean / (np.sqrt(square) + 1e-8))
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
    return policy_of(search.weights, settings, curve[-1]), curve


def play(envs: Any, weights: FloatArray, steps: int, seed: int) -> tuple[FloatArray, BoolArray]:
    """Play an episode with each candidate; return the returns and successes, (candidates,)."""
    observation, info = envs.reset(seed=[seed] * len(weights))
    returns, lasts = np.zeros(len(weights)), np.ones(len(weights), np.bool_)
    for _ in range(steps):
        action = np.einsum("bk,bk->b", observation, weights).clip(-1.0, 1.0)
        observation, reward, terminated, _, info = envs.step(action[:, None])
        returns += np.where(lasts, reward, 0.0)
        lasts &= ~terminated  # another episode begins after it
    return returns, info["success"] & lasts


def policy_of(weights: FloatArray, settings: Settings, last: dict[str, Any]) -> Policy:
    """Return the linear policy as plain arrays, with what made it."""
    return Policy(
        scale=np.ones(weights.size, np.float32),
        weights=[weights[None].astype(np.float32)],
        biases=[np.zeros(1, np.float32)],
        env=evaluation_env(settings.env),
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
