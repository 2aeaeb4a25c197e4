"""Policies, and their files as other programs may write them: any arrays, any description."""

import json
from dataclasses import replace

import numpy as np
from safetensors.numpy import save_file

from npend_gym.rl import Policy
from npend_gym.rl.policies.files import read_policy

OWN = object()  # the description that `Policy.save` writes


def random_policy(sizes, env, seed=0, size=1.0, **more):
    """A policy of random numbers: weights of these sizes, of about this size, and biases."""
    rng = np.random.default_rng(seed)
    weights = [size * rng.normal(size=shape) for shape in sizes]
    biases = [size * rng.normal(size=shape[:1]) for shape in sizes]
    given = {"scale": np.ones(sizes[0][1]), "provenance": {"trained_by": "a test"}}
    return Policy(**given | {"weights": weights, "biases": biases, "env": env} | more)


def small_policy(**changes):
    env = {"n": 2, "mode": "calm", "observation": "sincos"}
    policy = random_policy([(4, 6), (4, 4), (1, 4)], env, scale=np.full(6, 2.0))
    return replace(policy, **changes)


def save_changed(policy, path, about=OWN, **changes):
    """Save a policy with other arrays, without those that are None, and without a checksum.

    `about` is the text that describes it; None is none.
    """
    policy.save(path)
    own, described = read_policy(path)
    arrays = {name: x for name, x in (own | changes).items() if x is not None}
    text = json.dumps(described) if about is OWN else about
    save_file(arrays, path, None if text is None else {"npend_gym": text})


def header(*, data=b"", **entries):
    """Return the bytes of a file of safetensors with this header, and with `data` as numbers."""
    text = json.dumps(entries).encode()
    return len(text).to_bytes(8, "little") + text + data
