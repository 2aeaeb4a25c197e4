"""What a repository of the Hugging Face Hub holds: a policy, and a card that says what it does."""

from __future__ import annotations

import json
from os import PathLike
from typing import Any

from npend_gym import _checks
from npend_gym._extras import require
from npend_gym._files import replacing
from npend_gym._version import __version__
from npend_gym.chain import plain_keywords
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.registration import ENV_ID, TASKS
from npend_gym.rl.evaluation.episodes import Evaluation, evaluate
from npend_gym.rl.evaluation.seeds import HELD_OUT, MAX_SEED
from npend_gym.rl.policies.checks import names_code
from npend_gym.rl.policies.files import POLICY_FILE
from npend_gym.rl.policies.policy import Policy

_CARD = """---
{about}
---

# {name}

A policy for `{task}` of npend_gym {version}: {layers} {activation} layers, {numbers} numbers, in
one file of safetensors, which holds numbers and text alone.

```python
from npend_gym.rl import Policy, evaluate

policy = Policy.from_hub("{repository}"{trust})
print(evaluate(policy, policy.env, episodes=20).success_rate)
```

It was made for the environment `gym.make("{env_id}", **policy.env)` with these keywords:

```json
{env}
```

## Evaluation

{episodes} whole episodes, with the seeds from {seed} on{held_out}.

| | |
|---|---|
| success | {success} |
| return | {mean:.1f}, standard deviation {deviation:.1f} |
| settling time | {settling} |

## What made it

```json
{provenance}
```
"""


def write_repository(
    policy: Policy,
    folder: str | PathLike[str],
    name: str,
    *,
    episodes: int = 100,
    seed: int = HELD_OUT,
) -> Evaluation:
    """Evaluate a policy, and write its file and its model card into a folder.

    ``hf upload USER/NAME FOLDER``, a command of the Hub's library, makes a repository of the
    folder, from which `Policy.from_hub` loads the policy.

    Parameters
    ----------
    policy : Policy
    folder : path-like
        Created if it does not exist. "policy.safetensors" and "README.md" are written.
    name : str
        Name of the repository, "user/name". Without the user, the card's example has ``USER/name``,
        to be filled in.
    episodes, seed : int
        As for `evaluate`.

    Returns
    -------
    Evaluation
        The ``model-index`` of the card gives its results and the policy's task to the Hub.

    Raises
    ------
    ImportError
        If the extra "hub" is not installed.

    Examples
    --------
    >>> from pathlib import Path
    >>> from npend_gym.rl import Policy, write_repository
    >>> policy = Policy.pretrained("swingup-1")
    >>> write_repository(policy, "mine", "me/swing-up", episodes=4).success_rate
    1.0
    >>> sorted(path.name for path in Path("mine").iterdir())
    ['README.md', 'policy.safetensors']
    """
    hub = require("huggingface_hub", "hub", "model cards")
    if not isinstance(policy, Policy):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise TypeError(f"policy must be a Policy, got {_checks.show(policy)}")
    if not isinstance(name, str):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise TypeError(f"name must be a text, got {_checks.show(name)}")
    folder = _checks.path("folder", folder)
    folder.mkdir(parents=True, exist_ok=True)  # fails before the episodes, which take long
    found = evaluate(policy, policy.env, episodes=episodes, seed=seed)
    policy.save(folder / POLICY_FILE)
    with replacing(folder / "README.md") as file:
        file.write(_card(hub, policy, name, found, seed))
    return found


def _card(hub: Any, policy: Policy, name: str, found: Evaluation, seed: int) -> str:
    """Return the text of the card."""
    task, row = task_of(policy.env), found.as_row()
    success = "none: the mode defines neither achieved nor failed"
    if row["success"] is not None:
        low, high = found.success_interval
        success = f"{row['success']:.1%}, 95 % confidence interval {low:.1%} to {high:.1%}"
    mean, deviation = float(found.returns.mean()), float(found.returns.std())
    settling, count = row["settling_time"], found.returns.size
    held_out = seed >= HELD_OUT and seed + count - 1 <= MAX_SEED
    return _CARD.format(
        about=_metadata(hub, task, name, mean, deviation, row["success"]),
        name=name.rpartition("/")[2], repository=name if "/" in name else f"USER/{name}",
        trust=", trust=True" if names_code(policy.env.get("mode")) else "",
        task=task, env_id=ENV_ID, version=__version__, layers=len(policy.weights),
        activation=policy.activation,
        numbers=sum(a.size for a in (*policy.weights, *policy.biases)),
        env=json.dumps(plain_keywords(policy.env), indent=2),
        episodes=count, seed=seed, held_out=", which no training takes" if held_out else "",
        success=success, mean=mean, deviation=deviation,
        settling="none" if settling is None else f"{settling:.1f} s in successful episodes",
        provenance=json.dumps(policy.provenance, indent=2),
    )  # fmt: skip


def _metadata(
    hub: Any, task: str, name: str, mean: float, deviation: float, success: float | None
) -> str:
    """Metadata for the Hub, as YAML: the ``model-index`` has a result for each metric."""
    of_task = {
        "task_type": "reinforcement-learning", "task_name": "reinforcement-learning",
        "dataset_type": task, "dataset_name": task,
    }  # fmt: skip
    metrics: dict[str, Any] = {"mean_reward": f"{mean:.2f} +/- {deviation:.2f}"}
    if success is not None:
        metrics["success_rate"] = round(success, 4)
    results = [
        hub.EvalResult(metric_type=metric, metric_name=metric, metric_value=value, **of_task)
        for metric, value in metrics.items()
    ]
    return hub.ModelCardData(
        library_name="npend-gym",
        license="mit",
        pipeline_tag="reinforcement-learning",
        tags=["reinforcement-learning", "deep-reinforcement-learning", "gymnasium", task],
        model_name=name.rpartition("/")[2],
        eval_results=results,
    ).to_yaml()


def task_of(env: dict[str, Any]) -> str:
    """Return the id of the named task that an environment of these keywords is closest to."""
    config = EnvConfig(**env)
    own = {"mode": env.get("mode", "swingup"), "base": config.base}  # a chain may have the cart
    like: dict[str, EnvConfig] = {}
    for env_id, task in TASKS.items():
        named = {"base": "pivot", **task.keywords}
        if own == {name: named[name] for name in own}:
            like[env_id] = EnvConfig(**task.keywords)
    return min(like, key=lambda env_id: abs(like[env_id].n - config.n), default=ENV_ID)
