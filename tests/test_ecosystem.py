"""Other packages' own checks of an environment."""

import warnings

import gymnasium as gym
import pytest

import npend_gym  # noqa: F401 - registers the environments
from npend_gym.envs.modes import MODES


@pytest.mark.parametrize("mode", list(MODES))
def test_stable_baselines3_checker_is_content_without_a_warning(mode):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    env = gym.make("NPendulum-v0", n=2, mode=mode, observation="sincos").unwrapped
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(env, warn=True)


@pytest.mark.parametrize("mode", ["swingup", "balance", "calm"])
def test_torchrl_spec_check_is_content(mode):
    pytest.importorskip("torchrl")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # TorchRL warns of itself
        from torchrl.envs import GymEnv
        from torchrl.envs.utils import check_env_specs

        check_env_specs(GymEnv("NPendulum-v0", n=2, mode=mode, device="cpu"))


@pytest.mark.parametrize("autoreset", ["DISABLED", "SAME_STEP"])
def test_torchrl_spec_check_is_content_with_the_vector_environment(autoreset):
    pytest.importorskip("torchrl")
    envs = gym.make_vec("NPendulum-v0", num_envs=3, n=2, mode="balance", autoreset_mode=autoreset)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # TorchRL warns of itself
        from torchrl.envs import GymWrapper
        from torchrl.envs.utils import check_env_specs

        check_env_specs(GymWrapper(envs, device="cpu"))
