"""A policy as commands name it: of the package, or in a file."""

from __future__ import annotations

from pathlib import Path

from npend_gym import _checks
from npend_gym.rl.policies.files import pretrained_names, pretrained_path
from npend_gym.rl.policies.policy import Policy


def policy_path(name: str) -> Path:
    """Return the file of a policy of the package, by its name, or the file of this name."""
    names = pretrained_names()
    path = pretrained_path(name) if name in names else Path(name)
    if not path.is_file():
        near = _checks.nearest(name, names).rstrip(";")
        raise ValueError(f"policy must be a file or one of {', '.join(names)}; got {name}{near}")
    return path


def find_policy(name: str, *, trust: bool = False) -> Policy:
    """Return a policy of the package by its name, or a policy from a file, with its environment.

    Parameters
    ----------
    name : str
        A name of `pretrained_names`, or the path of a file that `Policy.save` wrote.
    trust : bool
        Whether to import what the file names, as for `Policy.load`.

    Returns
    -------
    Policy

    Raises
    ------
    ValueError
        If there is no such policy, or the file names no environment.

    Examples
    --------
    >>> from npend_gym import rl
    >>> rl.find_policy("swingup-2").env["n"]
    2
    """
    policy = Policy.load(policy_path(name), trust=trust)
    if not policy.env:
        raise ValueError(
            f'{name} must say for which environment it is made, as "env" in its description; '
            "Policy.save writes it"
        )
    return policy
