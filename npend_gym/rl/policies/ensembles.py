"""Several policies as one, whose network gives the mean of their outputs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._provenance import provenance
from npend_gym.rl.evaluation.settings import env_of
from npend_gym.rl.policies.policy import Policy


def ensemble(policies: Iterable[Policy], weights: Sequence[float] | None = None) -> Policy:
    """Return one policy whose network gives the mean of the outputs of several.

    Seeds of one training make different errors, which partly cancel in their mean. The networks
    stand side by side in one policy like any other: it is saved, exported and evaluated in the same
    way. The mean is taken before the output is bounded.

    Parameters
    ----------
    policies : iterable of Policy
        With the same environment, the same scale and memory, and as many layers.
    weights : sequence of float, optional
        Weights of the policies in the mean, as for `numpy.average`.

    Returns
    -------
    Policy
        Its provenance has the entries that are equal for all policies, and the sums of their steps
        and seconds of training. "members" has the provenance of each policy. An ensemble among the
        policies counts as its members.

    Raises
    ------
    ValueError
        If there is no policy, if the policies differ in one of these, or if the weights are not one
        positive number for each.

    Examples
    --------
    >>> from npend_gym.rl import Policy, ensemble
    >>> seeds = [Policy.pretrained("swingup-1"), Policy.pretrained("swingup-1")]
    >>> ensemble(seeds)
    Policy(3-128-128-1, env={'n': 1, 'mode': 'swingup', 'observation': 'sincos'})
    """
    members: list[Any] = [*policies] if hasattr(policies, "__iter__") else [None]
    if not all(isinstance(each, Policy) for each in members):
        raise TypeError(f"policies must be several `Policy`, got {_checks.show(policies)}")
    policies = members
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
    count = len(policies)
    given = np.ones(count) if weights is None else _checks.array("weights", weights)
    if given.shape != (count,):
        raise ValueError(
            f"weights must be an array of shape ({count},), one number for each policy, "
            f"got shape {given.shape}"
        )
    shares = _checks.positive("weights", given) / given.sum()
    layers = zip(*(policy.weights for policy in policies), strict=True)
    matrices: list[FloatArray] = [block_diag(*layer) for layer in layers]
    biases = [np.concatenate(layer) for layer in zip(*(p.biases for p in policies), strict=True)]
    outputs = len(policies[0].biases[-1])
    matrices[0] = matrices[0] @ np.tile(np.eye(policies[0].scale.size), (len(policies), 1))
    mean = np.repeat(shares, outputs) * np.tile(np.eye(outputs), len(policies))
    matrices[-1], biases[-1] = mean @ matrices[-1], mean @ biases[-1]
    made = _made_of([policy.provenance for policy in policies], shares)
    return replace(policies[0], weights=matrices, biases=biases, provenance=made)


def _common(policy: Policy) -> dict[str, Any]:
    """Settings that the policies of an ensemble share."""
    return {
        "env": env_of(policy.config),
        "scale": policy.scale.tolist(),
        "offset": None if policy.offset is None else policy.offset.tolist(),
        "limit": policy.limit,
        "activation": policy.activation,
        "output": policy.output,
        "number of layers": len(policy.weights),
    }


def _made_of(records: list[dict[str, Any]], shares: FloatArray) -> dict[str, Any]:
    """Return the provenance of an ensemble of policies with these."""
    members, weights = list[dict[str, Any]](), list[float]()
    for record, share in zip(records, shares.tolist(), strict=True):
        of_members = record["arguments"]["weights"] if "members" in record else [1.0]
        members += record.get("members", [record])
        weights += [share * weight for weight in of_members]
    made = provenance({"weights": weights})
    said = {k: v for k, v in members[0].items() if all(v == each.get(k) for each in members)}
    said.pop("evaluation", None)  # that is not of the ensemble
    trained = [member.get("training", {}) for member in members]
    known = [key for key in ("steps", "seconds") if all(key in each for each in trained)]
    if known:
        made["training"] = {key: sum(each[key] for each in trained) for key in known}
    return said | made | {"members": members}
