"""SB3VecEnv with Gymnasium's own environments: the tests that go with it into sb3-contrib.

There the import in `adapted` is the only line to change, and the last test falls away.
"""

from importlib.util import find_spec

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from scripts import run_python

pytestmark = pytest.mark.skipif(
    find_spec("stable_baselines3") is None, reason="stable_baselines3 is not installed"
)
COUNT = 3
SAME_STEP = {"autoreset_mode": AutoresetMode.SAME_STEP}


def adapted(name="CartPole-v1", mode="sync", **keywords):
    from npend_gym.rl.gymnasium_vec_env import SB3VecEnv

    venv = gym.make_vec(name, COUNT, vectorization_mode=mode, vector_kwargs=SAME_STEP, **keywords)
    return SB3VecEnv(venv)


def dummy(name="CartPole-v1", **keywords):
    from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

    return VecMonitor(DummyVecEnv([lambda: gym.make(name, **keywords)] * COUNT))


@pytest.mark.parametrize("keywords", [{}, {"max_episode_steps": 15}])
def test_steps_and_ends_of_episodes_are_those_of_dummyvecenv(keywords):
    ours, theirs = adapted(**keywords), dummy(**keywords)
    for env in (ours, theirs):
        env.seed(7)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    rng, ends = np.random.default_rng(0), {True: 0, False: 0}
    for _ in range(120):
        actions = rng.integers(0, 2, COUNT)
        mine, reference = ours.step(actions), theirs.step(actions)
        for a, b in zip(mine[:3], reference[:3], strict=True):
            np.testing.assert_array_equal(a, b)
            assert a.dtype == b.dtype
        assert ["terminal_observation" in info for info in mine[3]] == mine[2].tolist()
        for lane in np.flatnonzero(mine[2]):
            a, b = mine[3][lane], reference[3][lane]
            np.testing.assert_array_equal(a["terminal_observation"], b["terminal_observation"])
            assert a["TimeLimit.truncated"] is b["TimeLimit.truncated"]
            assert (a["episode"]["r"], a["episode"]["l"]) == (b["episode"]["r"], b["episode"]["l"])
            ends[a["TimeLimit.truncated"]] += 1
    assert ends[bool(keywords)] >= COUNT


@pytest.mark.long
def test_environments_in_processes_of_their_own_are_adapted_too():
    ours, theirs = adapted("Pendulum-v1", mode="async"), dummy("Pendulum-v1")
    for env in (ours, theirs):
        env.seed(1)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    for k in range(5):
        actions = np.full((COUNT, 1), 0.3 * k, np.float32)
        for a, b in zip(ours.step(actions)[:3], theirs.step(actions)[:3], strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-6)
    ours.close()


def test_other_autoreset_modes_are_refused():
    from npend_gym.rl.gymnasium_vec_env import SB3VecEnv

    with pytest.raises(ValueError, match="autoreset_mode SAME_STEP"):
        SB3VecEnv(gym.make_vec("CartPole-v1", 2, vectorization_mode="sync"))


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_options_are_those_of_every_environment_where_all_get_the_same(mode):
    class Told(gym.Wrapper):
        def reset(self, *, seed=None, options=None):
            observation, info = self.env.reset(seed=seed)
            return observation, info | {"told": np.shape(options["at"])}

    venv = adapted(mode=mode, wrappers=[Told])
    venv.set_options([{"at": np.array([1.0, 2.0])} for _ in range(COUNT)])
    venv.reset()
    assert np.ravel(venv.reset_infos[1]["told"]).tolist() == [2]
    venv.set_options([{"at": k} for k in range(COUNT)])
    with pytest.raises(ValueError, match=r"options\['at'\] must be the same for every env"):
        venv.reset()
    venv.close()


def test_infos_that_a_wrapper_makes_lists_are_refused_by_its_name():
    from gymnasium.wrappers.vector import DictInfoToList

    from npend_gym.rl.gymnasium_vec_env import SB3VecEnv

    with pytest.raises(TypeError, match="leave out the wrapper DictInfoToList"):
        SB3VecEnv(DictInfoToList(adapted().venv)).reset()


def test_keys_that_no_info_has_are_refused_by_name():
    from npend_gym.rl.gymnasium_vec_env import SB3VecEnv

    venv = gym.make_vec("CartPole-v1", COUNT, vectorization_mode="sync", vector_kwargs=SAME_STEP)
    with pytest.raises(TypeError, match=r"info_keys must be a sequence .*, got the text 'time'"):
        SB3VecEnv(venv, info_keys="time")
    ours = SB3VecEnv(gym.wrappers.vector.RecordEpisodeStatistics(venv), info_keys=("foo",))
    ours.reset()
    with pytest.raises(ValueError, match=r"info_keys must be keys of the info: .*; got 'foo'"):
        ours.step(np.zeros(COUNT, int))


ALONE = """
import importlib.abc, importlib.util, sys

class Blocked(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "npend_gym":
            raise ImportError(f"{name} is blocked")

sys.meta_path.insert(0, Blocked())
source = importlib.util.spec_from_file_location("gymnasium_vec_env", sys.argv[1])
module = importlib.util.module_from_spec(source)
source.loader.exec_module(module)

import doctest
print(doctest.testmod(module))
assert not any(name.startswith("npend_gym") for name in sys.modules)
"""


@pytest.mark.long
def test_the_file_works_and_trains_without_the_package():
    import npend_gym.rl.gymnasium_vec_env as adapter

    assert run_python("-c", ALONE, adapter.__file__) == "TestResults(failed=0, attempted=7)\n"
