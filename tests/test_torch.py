"""Chains as tensors: gradients against a dense model in torch, environments against the native."""

import math

import numpy as np
import pytest

from npend_gym import Chain
from npend_gym.envs import NPendulumVectorEnv, ResetNeeded
from npend_gym.physics import DifferentiableEnsemble, Ensemble

torch = pytest.importorskip("torch")

from npend_gym.torch import DifferentiableVectorEnv, DivergedError, step  # noqa: E402


def dense_step(parameters, theta, omega, torque, dt, substeps):
    """Return the state (n,) after Runge-Kutta steps of M alpha = f, the mass matrix solved."""
    masses, lengths, damping, gravity = parameters

    def rates(theta, omega):
        carried = masses.flip(0).cumsum(0).flip(0)
        both = torch.minimum(carried[:, None], carried[None, :]) * lengths[:, None] * lengths
        away = theta[:, None] - theta[None, :]
        matrix = both * torch.cos(away)
        force = -(both * torch.sin(away)) @ omega**2 - gravity * carried * lengths * theta.sin()
        at_joints = torque - damping * torch.diff(omega, prepend=omega[:1] * 0.0)
        force = force + at_joints - torch.cat([at_joints[1:], at_joints[:1] * 0.0])
        return omega, torch.linalg.solve(matrix, force)

    h = dt / substeps
    for _ in range(substeps):
        a = rates(theta, omega)
        b = rates(theta + 0.5 * h * a[0], omega + 0.5 * h * a[1])
        c = rates(theta + 0.5 * h * b[0], omega + 0.5 * h * b[1])
        d = rates(theta + h * c[0], omega + h * c[1])
        theta = theta + h / 6.0 * (a[0] + 2.0 * b[0] + 2.0 * c[0] + d[0])
        omega = omega + h / 6.0 * (a[1] + 2.0 * b[1] + 2.0 * c[1] + d[1])
    return theta, omega


def inputs(n, size, seed=0):
    """Return theta, omega and torque, (size, n), and masses, lengths, damping and gravity."""
    rng = np.random.default_rng(seed)
    state = [rng.normal(size=(size, n)) * scale for scale in (1.5, 2.0, 3.0)]
    chain = [rng.uniform(0.4, 2.0, n), rng.uniform(0.4, 1.5, n), rng.uniform(0.0, 0.3, n)]
    every = [*state, *chain, np.array(9.81)]
    return [torch.from_numpy(x).requires_grad_() for x in every]


NAMES = "masses", "lengths", "damping", "gravity"


@pytest.mark.parametrize("n", [1, 2, 5])
def test_gradients_of_a_step_are_those_of_a_dense_model_in_torch(n):
    """Torque on every joint; parameters of one chain for all lanes, which sum their gradients."""
    size, dt, substeps = 3, 0.04, 3
    given = inputs(n, size)
    weights = torch.from_numpy(np.random.default_rng(1).normal(size=(2, size, n)))
    chain = Chain.uniform(n)
    parameters = dict(zip(NAMES, given[3:], strict=True))
    got = step(chain, *given[:3], parameters, dt=dt, substeps=substeps, joints=range(n))
    expected = [
        torch.stack(x)
        for x in zip(
            *(dense_step(given[3:], *lane, dt, substeps) for lane in zip(*given[:3], strict=True)),
            strict=True,
        )
    ]
    gradients = [
        torch.autograd.grad(sum((w * x).sum() for w, x in zip(weights, y, strict=True)), given)
        for y in (got, expected)
    ]
    for ours, dense in zip(got, expected, strict=True):
        torch.testing.assert_close(ours, dense, rtol=1e-12, atol=1e-13)
    for name, ours, dense in zip(("theta", "omega", "torque", *NAMES), *gradients, strict=True):
        assert ours.shape == dense.shape
        assert (ours - dense).abs().max() <= 1e-12 * dense.abs().max(), name


def test_a_step_has_the_bits_of_an_ensemble_and_the_gradient_of_its_vjp():
    n, size = 3, 20
    theta, omega, torque = inputs(n, size)[:3]
    chain = Chain.uniform(n, damping=0.1)
    got = step(chain, theta, omega, torque[:, :1], dt=0.05)
    plain, exact = Ensemble(chain, size), DifferentiableEnsemble(chain, size)
    arrays = [x.detach().numpy() for x in (theta, omega, torque[:, :1])]
    for ensemble in (plain, exact):
        ensemble.set_state(slice(None), *arrays[:2])
    plain.advance(arrays[2], 0.05)
    np.testing.assert_array_equal(got[0].detach(), plain.theta)
    np.testing.assert_array_equal(got[1].detach(), plain.omega)
    (got[0].sum() + 2.0 * got[1].sum()).backward()
    back = exact.step_vjp(arrays[2], 0.05, theta_bar=1.0, omega_bar=2.0)
    np.testing.assert_array_equal(theta.grad, back.by_theta)
    np.testing.assert_array_equal(omega.grad, back.by_omega)
    np.testing.assert_array_equal(torque.grad[:, :1], back.by_torque)


TASKS = [
    {"mode": "swingup", "observation": "sincos"},
    {"mode": "balance", "n": 3, "observation": "scaled", "actuated": (0, 2)},
    {"mode": "calm", "randomize": {"masses": (0.8, 1.2), "gravity": (0.9, 1.1)}},
    {"mode": "transition", "torque_levels": 3},
]


@pytest.mark.parametrize("autoreset", ["NEXT_STEP", "SAME_STEP"])
@pytest.mark.parametrize("task", TASKS, ids=lambda task: task["mode"])
def test_episodes_are_those_of_the_native_environment(task, autoreset):
    """States to the last bit, observations in float32 too, rewards to rounding, over resets."""
    keywords = {"num_envs": 9, "max_episode_steps": 70, "autoreset_mode": autoreset} | task
    native, ours = NPendulumVectorEnv(**keywords), DifferentiableVectorEnv(**keywords)
    native.action_space.seed(0)
    observations = [native.reset(seed=4)[0], ours.reset(seed=4)[0]]
    ended, rewards = 0, []
    for _ in range(200):
        np.testing.assert_array_equal(observations[1].to(torch.float32), observations[0])
        action = native.action_space.sample()
        tensor = torch.from_numpy(action)
        tensor = tensor.double() if tensor.is_floating_point() else tensor
        expected, got = native.step(action), ours.step(tensor)
        observations = [expected[0], got[0]]
        np.testing.assert_array_equal(torch.cat(ours.state, 1), native.state)
        np.testing.assert_allclose(got[1], expected[1], rtol=1e-13, atol=1e-15)
        for k in (2, 3):
            np.testing.assert_array_equal(got[k], expected[k])
        for key in ("theta", "omega", "success") if autoreset == "NEXT_STEP" else ():
            np.testing.assert_array_equal(got[4][key], expected[4][key])
        ended += int((expected[2] | expected[3]).sum())
        rewards.append(expected[1])
    assert ended >= 18
    assert np.std(rewards) > 0.0


def test_a_policy_is_trained_through_the_simulation():
    env = DifferentiableVectorEnv(16, n=1, observation="sincos", autoreset_mode="SAME_STEP")
    gain = torch.zeros(3, 1, dtype=torch.float64, requires_grad=True)
    optimizer = torch.optim.Adam([gain], lr=0.05)
    returns = []
    for _ in range(8):
        observation, total = env.reset(seed=0)[0], 0.0
        for _ in range(40):
            observation, reward, *_ = env.step(torch.tanh(observation @ gain))
            total = total + reward.mean()
        optimizer.zero_grad()
        (-total).backward()
        optimizer.step()
        returns.append(float(total.detach()))
    assert returns[-1] > 5.0 * returns[0]


def test_what_diverges_is_named_with_its_step():
    env = DifferentiableVectorEnv(3, n=1, max_torque=1e13, dt=1.0, substeps=1)
    with pytest.raises(ResetNeeded):
        env.step(torch.zeros(3, 1, dtype=torch.float64))
    env.reset(seed=0)
    env.step(torch.zeros(3, 1, dtype=torch.float64))
    with pytest.raises(DivergedError, match=r"lanes \[1\] leave all bounds in step 2") as raised:
        env.step(torch.tensor([[0.0], [1.0], [0.0]], dtype=torch.float64))
    assert (raised.value.lanes, raised.value.step) == ([1], 2)
    assert math.isfinite(env.reset(seed=1)[0].sum())
