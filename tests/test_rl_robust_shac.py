"""SHAC with memory: what its actor and critic are given is what the environment shows."""

import gymnasium as gym
import numpy as np
import pytest

from npend_gym.envs import EnvConfig

pytestmark = pytest.mark.long  # kernels of their own take long to compile

torch = pytest.importorskip("torch")


def made(**changes):
    """Return settings, task, collector and learner of a small run at the full level."""
    from npend_gym.rl.training.disturbed_horizons import DisturbedCollector
    from npend_gym.rl.training.disturbed_task import DisturbedTask
    from npend_gym.rl.training.robust_shac import RobustLearner, settings_of

    small = {"num_envs": 6, "horizon": 6, "batch_size": 8, "total_timesteps": 72, "episode": 12}
    settings = settings_of("swingup-2-robust", **(small | {"first_level": 1.0} | changes))
    torch.manual_seed(settings.seed)
    task = DisturbedTask(EnvConfig(**settings.env), settings)
    return settings, task, DisturbedCollector(task, settings), RobustLearner(task, 1, settings)


def without_noise(env):
    """Return the keywords of an environment whose sensors are late, and nothing else."""
    late = {name: env["randomize"][name] for name in ("masses", "lengths", "observation_delay")}
    late["damping"] = env["randomize"]["damping"]
    return env | {"randomize": late}


def test_what_is_observed_and_rewarded_in_torch_is_what_the_environment_shows():
    from npend_gym.rl.training.disturbed_task import DisturbedTask

    settings, _, _, _ = made()
    env = without_noise(settings.env)
    task = DisturbedTask(EnvConfig(**env), settings)
    envs = gym.make_vec("NPendulum-v0", num_envs=8, **env)
    _, info = envs.reset(seed=3)
    context = torch.from_numpy(info["context"]).float()
    rng, states = np.random.default_rng(1), []
    for _ in range(12):
        action = rng.uniform(-1.0, 1.0, (8, 1)).astype(np.float32)
        observation, reward, _, _, info = envs.step(action)
        states.append(torch.from_numpy(np.hstack([info["theta"], info["omega"]])).float())
    shown = task.sense(states, context, torch.zeros(8, 4))
    np.testing.assert_allclose(shown, observation, atol=2e-4)
    in_torch = task.reward(states[-1], torch.from_numpy(action), context)
    np.testing.assert_allclose(in_torch / (1.0 - settings.gamma), reward, rtol=1e-4)
    assert 0.0 < float(task.values("observation_delay", context).min()) < 1.0
    assert float(task.values("observation_delay", context).max()) > 1.0


def test_noise_has_the_deviation_that_was_drawn():
    _, task, collector, _ = made()
    context = collector.context_tensor()[:1].repeat(4000, 1)
    deviation = float(task.values("velocity_noise", context)[0])
    states = [torch.zeros(4000, 4)] * (task.past + 1)
    seen = task.sense(states, context, torch.randn(4000, 4))
    assert deviation > 0.0
    assert float(seen[:, 4:].std()) == pytest.approx(deviation, rel=0.05)


def test_horizons_follow_the_chain_that_was_drawn():
    """An environment with the same chains goes where the collector's lanes go."""
    settings, task, collector, learner = made(pulse_rate=0.0)
    collector.context[:, task.columns["torque_noise"]] = 0.0
    horizons = collector.collect(learner.actor, exploration=0.0)
    envs = gym.make_vec("NPendulum-v0", num_envs=6, n=2, mode="swingup")
    states = horizons.states[:, task.past :].double().numpy()
    named = {k: task.values(k, horizons.context).numpy() for k in ("masses", "lengths", "damping")}
    envs.reset(options={"theta": states[:, 0, :2], "omega": states[:, 0, 2:]} | named)
    for step in range(settings.horizon):
        info = envs.step(horizons.actions[:, task.past + step].numpy())[-1]
        reached = np.hstack([info["theta"], info["omega"]])
        np.testing.assert_allclose(reached, states[:, step + 1], atol=1e-3)


def test_a_horizon_taken_again_without_noise_is_the_simulated_one():
    quiet = {"pulse_rate": 0.0, "ideal_share": 1.0}
    _, task, collector, learner = made(**quiet)
    for _ in range(3):  # across an episode's start
        horizons = collector.collect(learner.actor, exploration=0.0)
        states, outputs, near = learner.retake(horizons)
        simulated = horizons.states[:, task.past :]
        np.testing.assert_allclose(torch.stack(states, 1).detach(), simulated, atol=1e-4)
        taken = horizons.actions[:, task.past :]
        np.testing.assert_allclose(outputs.tanh().detach(), taken, atol=1e-4)
        assert near.all()


def test_a_gradient_along_the_jacobians_is_the_difference_quotient():
    """Of rewards by a weight of the actor, in horizons without noise taken again."""
    _, task, collector, learner = made(pulse_rate=0.0, ideal_share=1.0, trust=100.0)
    horizons = collector.collect(learner.actor, exploration=0.0)
    weight = learner.actor[0].weight

    def gain():
        states, outputs, _ = learner.retake(horizons)
        context = horizons.context[:, None].expand(-1, 6, -1)
        return task.reward(torch.stack(states[1:], 1), outputs.tanh(), context).double().sum()

    (slope,) = torch.autograd.grad(gain(), weight)
    place = divmod(int(slope.abs().argmax()), slope.shape[1])
    values = []
    for change in (-1e-2, 1e-2):
        with torch.no_grad():
            weight[place] += change
            values.append(float(gain()))
            weight[place] -= change
    assert (values[1] - values[0]) / 2e-2 == pytest.approx(float(slope[place]), rel=0.02)


def test_the_policy_does_in_the_environment_what_the_actor_did_in_training():
    settings, task, collector, learner = made(ideal_share=1.0, pulse_rate=0.0, starts=(1.0, 0.0))
    policy = learner.policy({})
    horizons = collector.collect(learner.actor, exploration=0.0)
    states = horizons.states[:, task.past :].double().numpy()
    envs = gym.make_vec("NPendulum-v0", num_envs=6, **policy.env)
    start = {"theta": states[:, 0, :2], "omega": states[:, 0, 2:]}
    observation, info = envs.reset(options=start)
    for step in range(settings.horizon):
        action = policy(observation, info)
        np.testing.assert_allclose(action, horizons.actions[:, task.past + step], atol=1e-3)
        observation, _, _, _, info = envs.step(action)
    assert policy.env == {"n": 2, "mode": "swingup", "observation": "sincos"}
    assert policy.has_memory


def test_disturbances_grow_during_the_training():
    settings, _, collector, learner = made(first_level=0.2, total_timesteps=6 * 36)
    levels = []
    for _ in range(6):
        levels.append(collector.level)
        collector.collect(learner.actor, exploration=0.0)
    np.testing.assert_allclose(levels, [0.2, 0.2 + 0.8 / 3, 0.2 + 1.6 / 3, 1.0, 1.0, 1.0])
    assert settings.ramp == (0.0, 0.5)


@pytest.mark.parametrize("task", ["swingup-2", "calm-2-robust"])
def test_robust_shac_refuses_what_it_cannot_learn(task):
    from npend_gym.rl.training.robust_shac import settings_of

    with pytest.raises(ValueError, match="task must be a robust swing-up"):
        settings_of(task)


def test_a_parameter_that_robust_shac_does_not_know_is_refused():
    from npend_gym.rl.training.disturbed_task import DisturbedTask

    settings, _, _, _ = made()
    env = settings.env | {"randomize": {"friction": {"low": 0.0, "high": 0.2}}}
    with pytest.raises(ValueError, match="randomize must have keys among"):
        DisturbedTask(EnvConfig(**env), settings)
