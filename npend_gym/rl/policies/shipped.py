"""A policy as commands name it: of the package, or in a file."""

from __future__ import annotations

from pathlib import Path

from npend_gym.rl.policies.files import pretrained_names
from npend_gym.rl.policies.policy import Policy


def find_policy(name: str, *, trust: bool = False) -> Policy:
    """Return a policy of the package by its name, or that in a file, with its environment."""
    names = pretrained_names()
    if name in names:
        return Policy.pretrained(name)
    if not Path(name).is_file():
        raise ValueError(f"policy must be a file or one of {', '.join(names)}; got {name}")
    policy = Policy.load(name, trust=trust)
    if not policy.env:
        raise ValueError(
            f'{name} must say for which environment it is made, as "env" in its description; '
            "Policy.save writes it"
        )
    return policy
