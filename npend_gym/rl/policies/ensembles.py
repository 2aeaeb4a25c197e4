"""Several policies as one, whose network gives the mean of their outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._provenance import provenance
from npend_gym.rl.policies.from_sb3 import env_of
from npend_gym.rl.policies.policy import Policy


def ensemble(policies: Sequence[Policy]) -> Policy:
    """Return one policy whose network gives the mean of the outputs of several.

    Seeds of one training make different errors, which partly cancel in their mean. The networks
    stand side by side in one policy like any other: it is saved, exported and judged in the same
    way. The mean is taken before the output is bounded.

    Parameters
    ----------
    policies : sequence of Policy
        With the same environment, the same scale and memory, and as many layers.

    Returns
    -------
    Policy
        Its provenance has that of each policy, as "members".

    Raises
    ------
    ValueError
        If there is none, or if they differ in one of these.

    Examples
    --------
    >>> from npend_gym.rl import Policy, ensemble
    >>> seeds = [Policy.pretrained("swingup-1"), Policy.pretrained("swingup-1")]
    >>> ensemble(seeds)
    Policy(3-128-128-1, env={'n': 1, 'mode': 'swingup', 'observation': 'sincos'})
    """
    if not policies:
        raise ValueError("policies must be one or more, got none")
    common = _common(policies[0])
    for k, policy in enumerate(policies):
        found = _common(policy)
        for name, value in common.items():
            if found[name] != value:
                raise ValueError(
                    f"policies must have the same {name}, got {_checks.show(value)} in policies[0] "
                    f"and {_checks.show(found[name])} in policies[{k}]: train them for the same "
                    "task, with other seeds"
                )
    layers = zip(*(policy.weights for policy in policies), strict=True)
    weights: list[FloatArray] = [block_diag(*layer) for layer in layers]
    biases = [np.concatenate(layer) for layer in zip(*(p.biases for p in policies), strict=True)]
    count, outputs = len(policies), len(policies[0].biases[-1])
    weights[0] = weights[0] @ np.tile(np.eye(policies[0].scale.size), (count, 1))
    mean = np.tile(np.eye(outputs), count) / count
    weights[-1], biases[-1] = mean @ weights[-1], mean @ biases[-1]
    members = {"members": [policy.provenance for policy in policies]}
    made = {"trained_by": "ensemble"} | members | provenance({"policies": count})
    return replace(policies[0], weights=weights, biases=biases, provenance=made)


def _common(policy: Policy) -> dict[str, Any]:
    """Return what the policies of an ensemble share."""
    return {
        "env": env_of(policy.config),
        "scale": policy.scale.tolist(),
        "offset": None if policy.offset is None else policy.offset.tolist(),
        "limit": policy.limit,
        "activation": policy.activation,
        "output": policy.output,
        "number of layers": len(policy.weights),
    }
