"""The policies that come with the package, by their names."""

from __future__ import annotations

from pathlib import Path

from npend_gym.rl.policies.policy import Policy

PRETRAINED = Path(__file__).parent / "pretrained"


def pretrained_names() -> tuple[str, ...]:
    """Return the names of the policies that come with the package.

    Examples
    --------
    >>> from npend_gym import rl
    >>> "swingup-4" in rl.pretrained_names()
    True
    """
    return tuple(sorted(path.stem for path in PRETRAINED.glob("*.npz")))


def find_policy(name: str, *, trust: bool = False) -> Policy:
    """Return a policy of the package by its name, or that in a file, with its environment.

    `trust` is that of `Policy.load`.

    Raises
    ------
    ValueError
        If there is neither, or the file does not say which environment the policy is made for.
    """
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
