"""Policies, and their files as other programs may write them: any arrays, any description."""

import json
from dataclasses import replace

import numpy as np
from safetensors.numpy import save_file

from npend_gym.rl import Policy
from npend_gym.rl.policies.files import read_policy

OWN = object()  # the description that `Policy.save` writes


def small_policy(**changes):
    rng = np.random.default_rng(0)
    sizes = [(4, 6), (4, 4), (1, 4)]
    policy = Policy(
        scale=np.full(6, 2.0, np.float32),
        weights=[rng.normal(size=size).astype(np.float32) for size in sizes],
        biases=[rng.normal(size=size[:1]).astype(np.float32) for size in sizes],
        env={"n": 2, "mode": "calm", "observation": "sincos"},
        provenance={"trained_by": "a test"},
    )
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
