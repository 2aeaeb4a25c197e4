"""What vector environments show beside what Gymnasium's SyncVectorEnv of single ones shows."""

import gymnasium as gym
import numpy as np

from npend_gym.envs import SwingUp


class Own(SwingUp):
    """A task of one's own, which is judged in Python."""

    def reward(self, quantities):
        """Return the height of the centre of mass."""
        return 0.0 + quantities.height


def make_vec(num_envs, vectorization_mode=None, **keywords):
    return gym.make_vec("NPendulum-v0", num_envs, vectorization_mode, **keywords)


def actions_for(env, steps, seed=0):
    env.action_space.seed(seed)
    return [env.action_space.sample() for _ in range(steps)]


def run(env, actions, seed=7):
    """Return everything that the vector env shows."""
    return [env.reset(seed=seed)] + [env.step(action) for action in actions]


def assert_same(a, b):
    """Assert equality of nested tuples, dicts and arrays, to the last bit."""
    if isinstance(a, dict):
        assert a.keys() == b.keys()
        for key in a:
            assert_same(a[key], b[key])
    elif isinstance(a, (tuple, list)):
        assert len(a) == len(b)
        for x, y in zip(a, b, strict=True):
            assert_same(x, y)
    elif isinstance(a, np.ndarray) and a.dtype == object:
        assert_same(list(a), list(b))
    elif a is None:
        assert b is None
    else:
        np.testing.assert_array_equal(a, b)


def lane(value, k):
    """Return lane `k` of something batched, infos without their masks."""
    if isinstance(value, dict):
        return {key: lane(v, k) for key, v in value.items() if not key.startswith("_")}
    return value[k]


def assert_lanes_are_singles(ours, theirs):
    """Assert that a vector env has shown, in `run`, what single ones have, to the last bit."""
    for mine, reference in zip(ours, theirs, strict=True):
        assert_same(mine[:-1], reference[:-1])
        assert_infos_are_those_of_singles(mine[-1], reference[-1])


def assert_infos_are_those_of_singles(info, expected):
    for key, value in expected.items():
        if key == "final_info":
            assert_infos_are_those_of_singles(info[key], value)
        else:
            assert_same(info[key], value)
