"""What all trainers share: tasks by name, networks, policies with their provenance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from npend_gym import _checks, _files
from npend_gym._provenance import provenance
from npend_gym.chain import Chain, check_parameter, plain_keywords
from npend_gym.envs.modes import MODES
from npend_gym.envs.registration import MAX_EPISODE_STEPS
from npend_gym.envs.registration import TASKS as REGISTERED
from npend_gym.rl.evaluation.episodes import evaluate
from npend_gym.rl.evaluation.seeds import training_seed
from npend_gym.rl.policies.policy import Policy

if TYPE_CHECKING:
    from torch import Tensor, nn  # an extra

    from npend_gym.envs import EnvConfig

Curve = list[dict[str, Any]]  # the learning curve, a row for every few updates
_LEAST_SECONDS = 10.0  # of an episode: a swing-up succeeds after standing for 5 s
LEAST_SUCCESS = 0.1  # of the episodes that judge a policy; below it the training has failed


@dataclass(frozen=True)
class TrainingSettings:
    """The fields that the settings of all trainers begin with."""

    env: dict[str, Any] = field(default_factory=dict[str, Any])  # keywords of the environment
    seed: int = 0

    def __post_init__(self) -> None:
        training_seed(self.seed)


def row_of(policy: Policy, settings: Any, **options: Any) -> dict[str, Any]:
    """Return `Evaluation.as_row` in the task of a training, with its discrete actions, if any.

    `options` are those of `evaluate`.
    """
    discrete = {"torque_levels": settings.env.get("torque_levels")}  # which no policy names
    return evaluate(policy, policy.env | discrete, **options).as_row()


def failure_of(row: Mapping[str, Any]) -> str:
    """Return why a training has failed whose policy has this `Evaluation.as_row`, or nothing."""
    success = row["success"]
    if success is None or not success < LEAST_SUCCESS:  # a mode may know no success
        return ""
    return (
        f"the training failed: the policy succeeds in {success:.0%} of {row['episodes']} episodes, "
        f"fewer than {LEAST_SUCCESS:.0%}. Train longer, or with another --seed or --algorithm, or "
        "see by npend evaluate --controller plan whether the motor suffices"
    )


def check_settings(settings: TrainingSettings, below_one: Sequence[str] = ()) -> None:
    """Raise an error for settings of the wrong type or sign.

    Counts and scales that are positive by default must be positive, and some numbers `below_one`.
    """
    for each in fields(settings):
        name, default, value = each.name, each.default, getattr(settings, each.name)
        if isinstance(default, str):
            if not isinstance(value, str):
                raise TypeError(f"{name} must be a text, got {_checks.show(value)}")
        elif isinstance(default, bool):
            _checks.truth(name, value)
        elif isinstance(default, int):
            _checks.count(name, value, low=min(default, 1))
        elif isinstance(default, float):
            if _checks.nonnegative_number(name, value) >= 1.0 and name in below_one:
                raise ValueError(f"{name} must lie from 0 to below 1, got {value}")
        elif isinstance(default, tuple):
            size = len(cast("tuple[float, ...]", default))
            if np.ndim(value) == 0:
                raise ValueError(f"{name} must be {size} numbers, got {_checks.show(value)}")
            _checks.positive(name, _checks.vector(name, value, size))


# Of a "robust" task: a new chain in every episode, 20 % about the default, with damped joints
ROBUST: dict[str, Any] = {
    "masses": [0.8, 1.2],
    "lengths": [0.8, 1.2],
    "gravity": [0.8, 1.2],
    "max_torque": [0.8, 1.2],
    "damping": {"low": 0.0, "high": 0.05},  # N m s/rad
}


_OWN: dict[str, dict[str, float]] = {  # keywords of single tasks
    # the force on the cart holds few wider starts
    "balance-4-cart": {"spread": 0.002}, "balance-5-cart": {"spread": 0.0005},
    "transition-3-cart": {"spread": 0.005},
    # plans within 10 N and 1.8 m are so sensitive that no network learned them
    "swingup-6-cart": {"max_force": 20.0, "rail": 3.0, "dt": 0.025},
}  # fmt: skip

_MACHINES = "pendubot", "acrobot", "cart"
# At the end of a task's name, in this order
_WORDS = (*_MACHINES, "robust", "recovery", "hardware", "smooth", "performance")


def _variant(word: str, n: int) -> dict[str, Any]:
    """Return the keywords of the environment that follow from one of `_WORDS`."""
    match word:
        case "robust":
            return {"randomize": ROBUST}
        case "recovery" | "hardware":  # the same environment; settings and reward differ
            return {}
        case "smooth" | "performance":  # the time between commands to RealAIGym's motors [s]
            return {"dt": 0.002}
        case "pendubot" | "acrobot":  # of RealAIGym's leaderboards: a motor at pivot or elbow
            robot = Chain.realaigym("C.1", motors=False).as_dict()
            elbow = {"actuated": (1,)} if word == "acrobot" else {}
            return {"chain": robot, "max_torque": 6.0, "dt": 0.02} | elbow  # N m, s
        case _:  # a cart; mode and observation are those of the task
            carts = "CartPole", "CartDoublePole", "CartTriplePole"
            registered = REGISTERED[f"npend/{carts[min(n, 3) - 1]}-v1"].keywords
            more = {"chain": Chain.dm_control("cartpole", n).as_dict()} if n > 3 else {}
            names = "chain", "base", "rail", "max_force"
            return {keyword: registered[keyword] for keyword in names} | more


def env_of_task(task: str) -> dict[str, Any]:
    """Return the keywords of the environment of a task such as "swingup-2" or "calm-2-robust".

    In a "robust" task every episode has a new chain. "swingup-2-pendubot" and "swingup-2-acrobot"
    use RealAIGym's pendulum, with a motor at the pivot or at the elbow. Names may end in several of
    these words, as "swingup-2-acrobot-robust" does. "recovery" and "hardware", for the two rules of
    `recovery`, change only the training. "smooth" and "performance" make steps of 0.002 s.
    "swingup-1-cart" is "npend/CartPole-v1" with mode="swingup" and observation="sincos". Two and
    three rods are on the cart of "npend/CartDoublePole-v1" and "npend/CartTriplePole-v1". More rods
    use the cart and the kind of poles of the latter. There "balance-4-cart" has spread=0.002,
    "balance-5-cart" spread=0.0005, and "transition-3-cart" spread=0.005. "swingup-6-cart" has
    20 N and 3 m to each side, and makes steps of 0.025 s.
    """
    text = task if isinstance(task, str) else ""  # pyright: ignore[reportUnnecessaryIsInstance]
    mode, n, *words = [*text.split("-"), ""][: max(2, text.count("-") + 1)]
    known = mode in MODES and n.isdecimal() and n == str(int(n)) != "0"
    if not known or words != [word for word in _WORDS if word in words]:
        raise ValueError(
            'task must be like "swingup-2" or "swingup-2-robust", with at least one rod, '
            f"got {_checks.show(task)}; words come once, in the order {', '.join(_WORDS)}"
        )
    if len(machines := [word for word in words if word in _MACHINES]) > 1:
        raise ValueError(f"task must be for one of {', '.join(machines)}, got {task!r}")
    keywords: dict[str, Any] = {}
    for word in words:
        if word in ("pendubot", "acrobot") and n != "2":
            raise ValueError(f'task must have two links, as "{mode}-2-{word}", got {task!r}')
        keywords |= _variant(word, int(n))
    own = _OWN.get(task, {})
    return {"n": int(n), "mode": mode, "observation": "sincos"} | keywords | own


def network(
    inputs: int, outputs: int, hidden: int, last_gain: float, layers: int = 2
) -> nn.Sequential:
    """Return a PyTorch network of hidden tanh layers of one width with orthogonal weights."""
    from torch import nn

    modules: list[nn.Module] = []
    for width_in, width_out in pairwise([inputs, *[hidden] * layers, outputs]):
        linear = nn.Linear(width_in, width_out)
        is_last = len(modules) == 2 * layers
        nn.init.orthogonal_(linear.weight, last_gain if is_last else 2**0.5)
        nn.init.zeros_(linear.bias)
        modules += [linear, nn.Tanh()]
    return nn.Sequential(*modules[:-1])


def observation_scale(config: EnvConfig, of_rods: tuple[float, float, float]) -> Tensor:
    """Return the scales of sines, cosines and speeds in observations; 1 for later entries."""
    import torch

    observed = of_rods if config.observe_velocities else of_rods[:2]
    scale = torch.tensor(observed).repeat_interleave(config.n)
    return torch.cat([scale, torch.ones(config.observed - len(scale))])


def policy_of(
    mean: nn.Sequential, obs_scale: Tensor, algorithm: str, settings: Any, last: dict[str, Any]
) -> Policy:
    """Return the network of the mean action as plain arrays, with its provenance.

    `last` is the last row of the learning curve.
    """
    import torch

    linear = [layer for layer in mean if isinstance(layer, torch.nn.Linear)]
    return Policy(
        scale=obs_scale.numpy(),
        weights=[layer.weight.detach().numpy() for layer in linear],
        biases=[layer.bias.detach().numpy() for layer in linear],
        env=evaluation_env({k: v for k, v in settings.env.items() if k != "torque_levels"}),
        provenance=made_by(algorithm, settings, last) | {"torch": torch.__version__},
    )


def evaluation_env(env: dict[str, Any]) -> dict[str, Any]:
    """Return the keywords for evaluation: episodes have the environment's own length, or 10 s."""
    from npend_gym.envs import EnvConfig

    own = {name: value for name, value in env.items() if name != "max_episode_steps"}
    steps = round(_LEAST_SECONDS / EnvConfig(**own).dt)
    return own | ({"max_episode_steps": steps} if steps > MAX_EPISODE_STEPS else {})


def made_by(algorithm: str, settings: Any, last: dict[str, Any]) -> dict[str, Any]:
    """Return the provenance of a policy that `algorithm` trained with `settings`, for JSON."""
    about = {"trained_by": algorithm, "clock": "processor time", "training": last}
    return plain_keywords(about | provenance(asdict(settings), settings.seed))


def env_around(path: Path, deviations: float = 2.0) -> dict[str, Any]:
    """Return the keywords of an environment of identified chains: "chain" and "randomize".

    They are from "identification.json" as `npend identify --out` writes it, or "fit.json" beside
    it. Parameters are drawn within a number of standard errors of the fit; those that cannot be
    negative are cut at zero. What the data do not determine is not drawn.
    """
    try:
        about = _files.parse_json(_files.read_text(path))
        if "chain_standard_errors" not in about:
            about = _files.parse_json(_files.read_text(path.with_name("identification.json")))
        chain, errors = Chain.from_dict(about["chain"]), about["chain_standard_errors"]
        spreads = {name: np.array(errors[name], np.float64) for name in errors}
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise ValueError(
            f"{path} must be what npend identify --out wrote, with identification.json beside it: "
            f"{error}"
        ) from error
    ranges: dict[str, Any] = {}
    for name, spread in spreads.items():
        value, away = getattr(chain, name), deviations * np.nan_to_num(spread)
        low = value - away if name == "centres" else np.maximum(value - away, 0.0)
        if away.any():
            try:
                check_parameter(f"the low end of {name}", low)
            except ValueError as error:
                raise ValueError(
                    f"{path} leaves {name} too uncertain to be drawn within {deviations:g} "
                    f"standard errors, got {_checks.show(value.tolist())} +- "
                    f"{_checks.show(spread.tolist())}: {error}; identify it from more data"
                ) from error
            ranges[name] = {"low": low.tolist(), "high": (value + away).tolist()}
    return {"chain": chain.as_dict(), "randomize": ranges}
