"""What the training scripts share: networks, policies with their provenance, the command line."""

from __future__ import annotations

import argparse
import csv
import re
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from npend_gym._provenance import provenance
from npend_gym.report import write_csv
from npend_gym.rl import Policy

Curve = list[dict[str, Any]]  # the learning curve, a row for every few updates


# Of a "robust" task: a new chain in every episode, 20 % about the default, with damped joints
ROBUST: dict[str, Any] = {
    "masses": [0.8, 1.2],
    "lengths": [0.8, 1.2],
    "gravity": [0.8, 1.2],
    "max_torque": [0.8, 1.2],
    "damping": {"low": 0.0, "high": 0.05},  # N m s/rad
}


def env_of_task(task: str) -> dict[str, Any]:
    """Return the keywords of the environment of a task such as "swingup-2" or "calm-2-robust"."""
    mode, n, *variant = task.split("-")
    if variant not in ([], ["robust"]):
        raise ValueError(f'task must be like "swingup-2" or "swingup-2-robust", got {task!r}')
    env = {"n": int(n), "mode": mode, "observation": "sincos"}
    return env | {"randomize": ROBUST} if variant else env


def network(inputs: int, outputs: int, hidden: int, last_gain: float) -> Any:
    """Return a PyTorch network of two hidden tanh layers with orthogonal weights."""
    from torch import nn

    layers: list[nn.Module] = []
    for width_in, width_out, gain in (
        (inputs, hidden, 2**0.5), (hidden, hidden, 2**0.5), (hidden, outputs, last_gain)
    ):  # fmt: skip
        layer = nn.Linear(width_in, width_out)
        nn.init.orthogonal_(layer.weight, gain)
        nn.init.zeros_(layer.bias)
        layers += [layer, nn.Tanh()]
    return nn.Sequential(*layers[:-1])


def policy_of(
    mean: Any, obs_scale: Any, script: str, settings: Any, last: dict[str, Any]
) -> Policy:
    """Return the network of the mean action as plain arrays, with what made it.

    Parameters
    ----------
    mean : torch.nn.Sequential
        Made by `network`.
    obs_scale : torch.Tensor
        The observations are divided by it.
    script : str
        Name of the training script.
    settings : dataclass
        Settings of the training run, with the fields "env" and "seed".
    last : dict
        Last row of the learning curve.
    """
    import torch

    linear = [layer for layer in mean if isinstance(layer, torch.nn.Linear)]
    return Policy(
        scale=obs_scale.numpy(),
        weights=[layer.weight.detach().numpy() for layer in linear],
        biases=[layer.bias.detach().numpy() for layer in linear],
        env=evaluation_env(settings.env),
        provenance=made_by(script, settings, last) | {"torch": torch.__version__},
    )


def evaluation_env(env: dict[str, Any]) -> dict[str, Any]:
    """Return the keywords for evaluation: episodes have the environment's own length."""
    return {name: value for name, value in env.items() if name != "max_episode_steps"}


def made_by(script: str, settings: Any, last: dict[str, Any]) -> dict[str, Any]:
    """Return the provenance of a policy that `script` trained with `settings`."""
    about = {"trained_by": f"examples/{script}", "training": last}
    return about | provenance(asdict(settings), settings.seed)


def keep(policy: Policy, curve: Curve, path: Path) -> None:
    """Write a policy to `path` (.npz), after its learning curve beside it (.csv)."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_csv(path.with_suffix(".csv"), curve)
    policy.save(path)


def read_rows(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a CSV file; an empty cell is None."""
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return [{name: value_of(text) for name, text in row.items()} for row in rows]


def value_of(text: str) -> int | float | str | None:
    """Return the value of a cell in a CSV file."""
    if text.isdigit():
        return int(text)
    return float(text) if re.fullmatch(r"-?[\d.]+", text) else text or None


def main(
    description: str | None,
    settings_of: Callable[..., Any],
    train: Callable[[Any, str | None], tuple[Policy, Curve]],
    **options: tuple[str, str],
) -> None:
    """Train one policy as the command line says, and write it to a file.

    Parameters
    ----------
    description : str
        Help text of the script.
    settings_of : callable
        Returns the settings for a task and changed fields.
    train : callable
        Returns the policy and the learning curve for settings and the label of a progress bar.
    **options : tuple of str
        Option and help text of the integer fields of the settings that the script lets change.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("task", help='mode and number of rods, as in "swingup-2"')
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path(), help="folder of the files")
    for field, (option, text) in options.items():
        parser.add_argument(option, type=int, dest=field, help=text)
    arguments = parser.parse_args()
    given = {field: getattr(arguments, field) for field in options}
    changes = {field: value for field, value in given.items() if value is not None}
    policy, curve = train(
        settings_of(arguments.task, seed=arguments.seed, **changes), arguments.task
    )
    path = arguments.out / f"{arguments.task}.npz"
    keep(policy, curve, path)
    print(f"{path}: {curve[-1]}")
