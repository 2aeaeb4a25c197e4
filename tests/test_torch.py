"""Chains as tensors: gradients against the dense system, environments against the native one."""

import math

import numpy as np
import pytest
from oracle import TINY, dense_step

from npend_gym import Cart, Chain
from npend_gym.envs import NPendulumVectorEnv, ResetNeeded
from npend_gym.physics import DifferentiableEnsemble, Ensemble

pytestmark = pytest.mark.long  # kernels of their own take long to compile

torch = pytest.importorskip("torch")

from npend_gym.torch import DifferentiableVectorEnv, DivergedError, step  # noqa: E402


def inputs(n, size, seed=0):
    """Return theta, omega and torque, (size, n), and masses, lengths, damping and gravity."""
    rng = np.random.default_rng(seed)
    state = [rng.normal(size=(size, n)) * scale for scale in (1.5, 2.0, 3.0)]
    chain = [rng.uniform(0.4, 2.0, n), rng.uniform(0.4, 1.5, n), rng.uniform(0.0, 0.3, n)]
    every = [*state, *chain, np.array(9.81)]
    return [torch.from_numpy(x).requires_grad_() for x in every]


NAMES = "masses", "lengths", "damping", "gravity"


@pytest.mark.parametrize("n", [1, 2, 5])
def test_a_step_has_the_bits_of_an_ensemble_and_the_gradient_of_its_vjp(n):
    """Torque on every joint; parameters of one chain for all lanes, which sum their gradients."""
    size, dt, joints = 20, 0.05, range(n)
    theta, omega, torque, *given = inputs(n, size)
    parameters = dict(zip(NAMES, given, strict=True))
    got = step(Chain.uniform(n), theta, omega, torque, parameters, dt=dt, joints=joints)
    chain = Chain(**{name: value.tolist() for name, value in parameters.items()})
    plain = Ensemble(chain, size, joints=joints)
    exact = DifferentiableEnsemble(chain, size, joints=joints)
    arrays = [x.detach().numpy() for x in (theta, omega, torque)]
    for ensemble in (plain, exact):
        ensemble.set_state(slice(None), *arrays[:2])
    plain.advance(arrays[2], dt)
    np.testing.assert_array_equal(got[0].detach(), plain.theta)
    np.testing.assert_array_equal(got[1].detach(), plain.omega)
    (got[0].sum() + 2.0 * got[1].sum()).backward()
    back = exact.step_vjp(arrays[2], dt, theta_bar=1.0, omega_bar=2.0, parameters=NAMES)
    np.testing.assert_array_equal(theta.grad, back.by_theta)
    np.testing.assert_array_equal(omega.grad, back.by_omega)
    np.testing.assert_array_equal(torque.grad, back.by_torque)
    for name, value in parameters.items():
        summed = back.by_parameters[name].sum(axis=0).reshape(value.shape)
        np.testing.assert_allclose(value.grad, summed, rtol=1e-12)


STRONG = {
    "action_delay": 1.4, "motor_lag": 0.03, "torque_noise": 0.4, "torque_ripple": 0.3,
    "push_rate": 4.0, "push_force": 2.0, "observation_delay": 2.6, "angle_noise": 0.05,
    "velocity_noise": 0.2, "angle_resolution": 0.01, "velocity_resolution": 0.02,
}  # fmt: skip
IDEAL = {
    "swing-up": {"mode": "swingup", "observation": "sincos"},
    "balance": {"mode": "balance", "n": 3, "observation": "scaled", "actuated": (0, 2)},
    "calm": {"mode": "calm", "randomize": {"masses": (0.8, 1.2), "gravity": (0.9, 1.1)}},
    "angles": {"mode": "balance", "spread": 0.1, "observe_velocities": False},
    "levels": {"mode": "transition", "torque_levels": 3},
}
UNIDEAL = {
    "cart": {"n": 2, "base": "cart", "mode": "balance", "observation": "scaled"},
    "elbow on a cart": {"n": 2, "base": "cart", "actuated": (1,), "rail": 0.2},
    "links on a cart": {
        "chain": Chain([1.0], [0.8], centres=0.4, inertias=0.05, base=Cart(1.5, 0.1)),
        "mode": "calm", "observe_velocities": False,
    },
    "all errors": {"n": 2, "observation": "sincos"} | STRONG,
    "all errors on a cart": {"n": 1, "base": "cart", "actuated": (0,), "rail": 1.0} | STRONG,
    "whole delays": {"n": 2, "action_delay": 2, "observation_delay": 1},
    "pushes of a passive chain": {
        "n": 3, "mode": "passive", "push_rate": 9.0, "push_force": 3.0, "velocity_noise": 0.1,
    },
    "errors that are drawn": {
        "n": 1,
        "randomize": {
            "action_delay": {"low": 0.0, "high": 3.0}, "motor_lag": {"low": 0.0, "high": 0.1},
            "observation_delay": {"low": 0.0, "high": 3.0}, "masses": (0.5, 1.5),
            "angle_noise": {"low": 0.0, "high": 0.1}, "max_torque": (0.5, 1.0),
        },
    },
    "goals": {"n": 2, "mode": "transition", "goal_env": True, "reward_type": "sparse"},
}  # fmt: skip


def flat(observation):
    """Return an observation as one array; one with goals has its parts side by side."""
    parts = observation if isinstance(observation, dict) else {"all": observation}
    return np.concatenate([np.asarray(parts[key]) for key in sorted(parts)], axis=1)


def same_infos(ours, native, lanes=..., *, exact):
    """Compare what is told of lanes; with `exact` the motion to the last bit."""
    for key in ours.keys() - {"final_obs", "final_info"}:
        np.testing.assert_allclose(ours[key][lanes], native[key][lanes], rtol=1e-7, atol=1e-8)
        if exact and key in ("theta", "omega", "success"):
            np.testing.assert_array_equal(ours[key][lanes], native[key][lanes])


@pytest.mark.parametrize(("task", "autoreset"), [
    *((task, "NEXT_STEP") for task in (IDEAL | UNIDEAL)),
    *((task, "SAME_STEP") for task in ("levels", "all errors on a cart", "goals")),
])  # fmt: skip
def test_episodes_are_those_of_the_native_environment(task, autoreset):
    """Over resets; without errors and a cart states to the last bit and rewards to rounding."""
    keywords = {"num_envs": 9, "max_episode_steps": 25, "autoreset_mode": autoreset}
    keywords |= (IDEAL | UNIDEAL)[task]
    native, ours = NPendulumVectorEnv(**keywords), DifferentiableVectorEnv(**keywords)
    assert ours.observation_space == native.observation_space
    assert ours.action_space == native.action_space
    native.action_space.seed(0)
    (expected, _), (got, _) = native.reset(seed=4), ours.reset(seed=4)
    ended, rewarded = 0, []
    for k in range(80):
        np.testing.assert_allclose(flat(got), flat(expected), rtol=1e-5, atol=2e-5)
        if task in IDEAL:
            np.testing.assert_array_equal(got.to(torch.float32), expected)
        if k == 40:  # some lanes again
            mask = {"reset_mask": np.arange(9) % 3 == 0}
            expected, got = (env.reset(options=mask)[0] for env in (native, ours))
        action = native.action_space.sample()
        tensor = torch.from_numpy(action)
        tensor = tensor.double() if tensor.is_floating_point() else tensor
        expected, reward, *flags, info = native.step(action)
        got, rewards, *ends, infos = ours.step(tensor)
        np.testing.assert_allclose(rewards, reward, rtol=1e-8, atol=1e-9)
        if task in IDEAL:
            np.testing.assert_array_equal(torch.cat(ours.state, 1), native.state)
            np.testing.assert_allclose(rewards, reward, rtol=1e-13, atol=1e-15)
        for mine, theirs in zip(ends, flags, strict=True):
            np.testing.assert_array_equal(mine, theirs)
        same_infos(infos, info, exact=task in IDEAL)
        if "final_info" in info:
            over = flags[0] | flags[1]
            same_infos(infos["final_info"], info["final_info"], over, exact=task in IDEAL)
        ended += int((flags[0] | flags[1]).sum())
        rewarded.append(reward)
    assert ended >= 18
    assert np.std(rewarded) > 0.0 or task not in IDEAL
    ours.close()


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_observed_angles_stay_within_pi_in_float32_and_keep_their_gradient(dtype):
    env = DifferentiableVectorEnv(3, n=1, dtype=dtype, mode="passive", dt=1e-9)
    env.reset(seed=0)
    below = math.pi - np.array([[1e-9], [5e-8], [1e-6]])
    angles = torch.from_numpy(below).requires_grad_()
    env.state = angles, torch.zeros_like(angles)
    observation = env.step(torch.zeros(3, dtype=torch.int64))[0]
    assert (observation[:, 0].detach().double().abs() < math.pi + 1e-6).all()
    assert (observation[:, 0].float() < np.pi).all()  # as float32, pi is more than pi
    observation[:, 0].sum().backward()
    np.testing.assert_allclose(angles.grad, 1.0, rtol=1e-6)


def test_what_diverges_is_named_with_its_step():
    env = DifferentiableVectorEnv(3, n=1, max_torque=1e13, dt=1.0, substeps=1)
    with pytest.raises(ResetNeeded):
        env.step(torch.zeros(3, 1, dtype=torch.float64))
    env.reset(seed=0)
    env.step(torch.zeros(3, 1, dtype=torch.float64))
    with pytest.raises(DivergedError, match=r"chains \[1\] leave all bounds in step 2") as raised:
        env.step(torch.tensor([[0.0], [1.0], [0.0]], dtype=torch.float64))
    assert (raised.value.chains, raised.value.step) == ([1], 2)
    observation, info = env.reset(seed=1)
    assert math.isfinite(observation.sum())
    assert info["time"].dtype == torch.float64


def test_gradients_through_200_environment_steps_are_those_of_the_dense_system():
    """By all actions and the start, N = 5, against complex steps along three directions."""
    n, steps, rng = 5, 200, np.random.default_rng(7)
    env = DifferentiableVectorEnv(
        1, n=n, mode="calm", actuated=range(n), max_torque=2.0, dt=0.02, substeps=4, damping=0.5
    )
    env.reset(seed=0)
    theta = torch.from_numpy(rng.normal(size=(1, n))).requires_grad_()
    omega = torch.from_numpy(rng.normal(size=(1, n))).requires_grad_()
    env.state = theta, omega
    actions = torch.from_numpy(rng.uniform(-0.9, 0.9, (steps, 1, n))).requires_grad_()
    weights = rng.normal(size=(2, n))
    for action in actions:
        env.step(action)
    reached = torch.cat(env.state)
    (torch.from_numpy(weights) * reached).sum().backward()
    gradient = np.concatenate([x.grad.numpy().ravel() for x in (theta, omega, actions)])
    assert np.all(np.isfinite(gradient))

    chain = env.config.chain
    start = np.concatenate([x.detach().numpy().ravel() for x in (theta, omega, actions)])
    for direction in rng.normal(size=(3, start.size)):
        varied = start + 1j * TINY * direction
        y = varied[: 2 * n]
        for torque in varied[2 * n :].reshape(steps, n):
            y = dense_step(chain, *np.split(y, 2), 2.0 * torque, env.config.dt, 4)
        expected = weights.ravel() @ y.imag / TINY
        np.testing.assert_allclose(reached.detach().numpy().ravel(), y.real, rtol=1e-9, atol=1e-9)
        assert gradient @ direction == pytest.approx(expected, rel=1e-9)


def test_float32_goes_in_and_comes_out_while_steps_are_of_float64():
    theta, omega, torque = (x.detach().to(torch.float32) for x in inputs(2, 4)[:3])
    theta.requires_grad_()
    chain = Chain.uniform(2)
    got = step(chain, theta, omega, torque[:, :1], dt=0.05)
    exact = step(chain, theta.double(), omega.double(), torque[:, :1].double(), dt=0.05)
    for ours, wide in zip(got, exact, strict=True):
        assert ours.dtype == torch.float32
        torch.testing.assert_close(ours, wide.to(torch.float32), rtol=0.0, atol=0.0)
    got[0].sum().backward()
    assert theta.grad.dtype == torch.float32
    env = DifferentiableVectorEnv(2, dtype=torch.float32, n=2)
    observation, _ = env.reset(seed=0)
    outputs = env.step(torch.zeros(2, 1))
    assert {observation.dtype, outputs[0].dtype, outputs[1].dtype} == {torch.float32}


@pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")
def test_torch_func_takes_steps_of_single_states_and_of_batches():
    chain = Chain.uniform(2, damping=0.1)
    theta, _, _, *parameters = (x.detach() for x in inputs(2, 3))

    def angles(theta, masses):
        return step(chain, theta, torque=0.3, parameters={"masses": masses}, dt=0.05)[0]

    jacobians = torch.func.vmap(torch.func.jacrev(angles), in_dims=(0, None))(theta, parameters[0])
    ensemble = DifferentiableEnsemble(Chain(parameters[0], 1.0, damping=0.1), 3)
    ensemble.set_state(slice(None), theta.numpy())
    exact = ensemble.step_jacobian(0.3, 0.05)
    np.testing.assert_allclose(jacobians, exact.A[:, :2, :2], rtol=1e-12, atol=1e-14)
    gradient = torch.func.grad(lambda m: angles(theta, m).sum())(parameters[0])
    each = torch.func.vmap(torch.func.grad(lambda t, m: angles(t, m).sum(), argnums=1), (0, None))
    torch.testing.assert_close(gradient, each(theta, parameters[0]).sum(0))
    torch.testing.assert_close(
        torch.func.vmap(angles)(theta, parameters[0].expand(3, 2)), angles(theta, parameters[0])
    )
    with pytest.raises(NotImplementedError, match="no forward-mode derivative"):
        torch.func.jacfwd(lambda t: angles(t, parameters[0]))(theta)


def test_a_gradient_of_a_gradient_is_refused():
    theta = inputs(2, 3)[0]
    value = step(Chain.uniform(2), theta, dt=0.05)[0].sum()
    (first,) = torch.autograd.grad(value, theta, create_graph=True)
    with pytest.raises(NotImplementedError, match="differentiated once, not twice"):
        torch.autograd.grad(first.sum(), theta)


@pytest.mark.filterwarnings("ignore:The .grad attribute of a Tensor:UserWarning")
def test_compiled_functions_take_steps_as_they_are():
    chain, theta = Chain.uniform(2), inputs(2, 3)[0]

    def value(theta):
        return (2.0 * step(chain, theta + 0.1, dt=0.05)[0]).sum()

    compiled = torch.compile(value, backend="eager")
    torch.testing.assert_close(compiled(theta), value(theta), rtol=0.0, atol=0.0)
    gradients = [torch.autograd.grad(f(theta), theta)[0] for f in (compiled, value)]
    torch.testing.assert_close(*gradients, rtol=0.0, atol=0.0)


TWO = torch.zeros(3, 2, dtype=torch.float64)
NEGATIVE = torch.tensor([[1.0, 1.0], [-0.1, 1.0], [1.0, 1.0]], dtype=torch.float64)
BAD_STEPS = [
    # a chain with springs is refused before the shapes of its states
    ((TWO,), {"chain": Chain.uniform(2, stiffness=500.0)}, ValueError, "must have rigid rods"),
    (
        (TWO,),
        {"parameters": {"masses": NEGATIVE}},
        ValueError,
        "masses of chain 1 .* greater than zero.*log_masses",
    ),
    ((TWO.int(),), {}, TypeError, "theta must be of float64 or float32, got torch.int32"),
    ((TWO, TWO.float()), {}, TypeError, "omega must have the dtype and device of theta"),
    ((TWO.numpy(),), {}, TypeError, "theta must be a tensor of torch"),
    ((TWO.to("meta"),), {}, ValueError, "theta must be on the processor or an NVIDIA GPU"),
    ((TWO[:, :1],), {}, ValueError, r"theta must have the shape \(\.\.\., 2\), got \(3, 1\)"),
    ((TWO, TWO[:2]), {}, ValueError, "leading axes must fit"),
    ((TWO, 0.0, TWO), {}, ValueError, r"torque must have the shape \(\.\.\., 1\)"),
    ((TWO[:0],), {}, ValueError, r"theta must hold at least one state, got .*\(0,\)"),
    ((TWO * np.nan,), {}, ValueError, "theta must be finite"),
    ((TWO + 1e6,), {}, ValueError, "theta must lie within"),
    ((TWO,), {"parameters": {"mass": TWO}}, ValueError, "parameter must be one of masses"),
    ((TWO,), {"parameters": {"inertias": TWO + 1.0}}, ValueError, "begin with a chain that"),
    ((TWO,), {"joints": (2,)}, ValueError, "joint must be between 0 and 1"),
    ((TWO,), {"joints": (1, 1)}, ValueError, r"joints must name each joint once, got \[1, 1\]"),
    ((TWO,), {"dt": 0.0}, ValueError, "dt must be greater than zero"),
    ((TWO,), {"joints": 0}, TypeError, r"joints must be a list such as \(0,\), got 0"),
    (
        (TWO, 0.0, [1.0]),
        {},
        TypeError,
        r"torque must be a tensor of torch or a number, got \[1.0\]",
    ),
]


@pytest.mark.parametrize(("given", "keywords", "error", "text"), BAD_STEPS)
def test_bad_tensors_are_refused_by_name(given, keywords, error, text):
    keywords = {"chain": Chain.uniform(2), "dt": 0.05} | keywords
    states = dict(zip(("theta", "omega", "torque"), given, strict=False))
    with pytest.raises(error, match=text):
        step(**keywords, **states)


def test_joints_are_refused_whatever_other_calls_came_before():
    for _ in range(2):
        with pytest.raises(TypeError, match=r"joint must be an integer, got 0\.0"):
            step(Chain.uniform(2), TWO, dt=0.05, joints=(0.0,))
        step(Chain.uniform(2), TWO, dt=0.05, joints=(0,))


def test_numbers_of_numpy_are_numbers_for_a_step():
    expected = step(Chain.uniform(2), TWO, 0.0, 1.0, dt=0.05)
    for torque in (np.float64(1.0), np.float32(1.0), np.int64(1)):
        after = step(Chain.uniform(2), TWO, np.float64(0.0), torque, dt=0.05)
        torch.testing.assert_close(after, expected, rtol=0.0, atol=0.0)


def test_single_states_take_steps_with_another_gravity_and_without_motors():
    chain, theta = Chain.uniform(2), inputs(2, 3)[0]
    gravity = torch.tensor(9.0, dtype=torch.float64, requires_grad=True)

    def angles(theta, joints):
        return step(chain, theta, parameters={"gravity": gravity}, dt=0.05, joints=joints)[0]

    batch = angles(theta, (0,))
    for joints in ((0,), ()):
        torch.testing.assert_close(angles(theta, joints), batch, rtol=0.0, atol=0.0)
        torch.testing.assert_close(angles(theta[1], joints), batch[1], rtol=0.0, atol=0.0)
    pair = batch[1], angles(theta[1], ())
    expected, found = (torch.autograd.grad(x.sum(), gravity, retain_graph=True) for x in pair)
    torch.testing.assert_close(found, expected)

    def total(theta):
        return step(chain, theta, dt=0.05, joints=())[0].sum()

    (expected,) = torch.autograd.grad(total(theta), theta)
    found = torch.func.vmap(torch.func.grad(total))(theta.detach())
    torch.testing.assert_close(found, expected, rtol=0.0, atol=0.0)


def test_gradients_that_are_nan_are_named_where_they_arrive():
    theta = inputs(2, 3)[0]
    after = step(Chain.uniform(2), theta, dt=0.05)[0]
    with pytest.raises(FloatingPointError, match=r"NaN in chains \[2\]"):
        (after[:2].sum() + np.nan * after[2].sum()).backward()


def test_a_horizon_that_is_detached_has_no_gradient_by_what_came_before():
    env = DifferentiableVectorEnv(2, n=2)
    env.reset(seed=0)
    actions = torch.zeros(4, 2, 1, dtype=torch.float64, requires_grad=True)
    for k, action in enumerate(actions):
        if k == 2:
            env.detach()
        reward = env.step(action)[1]
    reward.sum().backward()
    assert torch.all(actions.grad[:2] == 0.0)
    assert torch.all(actions.grad[2:] != 0.0)


@pytest.mark.parametrize("task", ["elbow on a cart", "all errors", "all errors on a cart"])
def test_gradients_through_motors_and_sensors_are_those_of_differences(task):
    """Rounding is left out: it has the gradient of the identity, which differences have not."""
    smooth = {"angle_resolution": 0.0, "velocity_resolution": 0.0, "push_force": 0.5}
    chosen = {key: value for key, value in smooth.items() if key in UNIDEAL[task]}
    env = DifferentiableVectorEnv(2, **UNIDEAL[task] | chosen)

    def total(actions):
        env.reset(seed=2)
        value = 0.0
        for k, action in enumerate(actions):
            observation, reward, *_ = env.step(action)
            value = value + reward.sum() + (0.1 + 0.01 * k) * observation.sum()
        return value

    rng = np.random.default_rng(0)
    given = rng.uniform(-0.5, 0.5, (6, 2, env.action_size))
    actions = torch.from_numpy(given).requires_grad_()
    (gradient,) = torch.autograd.grad(total(actions), actions)
    h = 1e-5
    for place in ((0, 0, 0), (2, 1, env.action_size - 1), (4, 0, 0)):
        ends = []
        for sign in (h, -h):
            moved = torch.from_numpy(given.copy())
            moved[place] += sign
            with torch.no_grad():
                ends.append(float(total(moved)))
        slope = (ends[0] - ends[1]) / (2.0 * h)
        assert abs(slope - float(gradient[place])) < 1e-6 * max(1.0, abs(slope))


@pytest.mark.parametrize("autoreset", ["DISABLED", "SAME_STEP"])
@pytest.mark.parametrize("task", ["elbow on a cart", "all errors", "all errors on a cart"])
def test_where_all_lanes_begin_a_new_graph_begins_too(task, autoreset):
    more = {"max_episode_steps": 3, "autoreset_mode": autoreset}
    env = DifferentiableVectorEnv(2, **UNIDEAL[task] | more)
    action = torch.zeros(2, env.action_size, dtype=torch.float64, requires_grad=True)
    env.reset(seed=0)
    for _ in range(3):
        total = 0.0
        for _ in range(3):
            observation, reward, *_ = env.step(action)
            total = total + reward.sum() + observation.sum()
        total.backward()  # fails where part of the graph before is gone
        if autoreset == "DISABLED":
            env.reset()


def test_what_tensors_cannot_be_is_refused_by_the_environment():
    with pytest.raises(ValueError, match="randomize must leave cart_mass out"):
        DifferentiableVectorEnv(2, base="cart", randomize={"cart_mass": (0.5, 1.5)})
    for unknown in ({"render_size": 64}, {"render_plain": True}, {"measure_periods": True}):
        with pytest.raises(ValueError, match=f"{min(unknown)} must be left out .* of tensors"):
            DifferentiableVectorEnv(2, **unknown)
    with pytest.raises(ValueError, match="device must be one of cpu, cuda; got 'foo'"):
        DifferentiableVectorEnv(2, device="foo")
    pytest.importorskip("torchrl")
    from npend_gym.torch import TorchRLEnv

    with pytest.raises(ValueError, match="goal_env must be False for TorchRLEnv"):
        TorchRLEnv(2, **UNIDEAL["goals"])
    with pytest.raises(TypeError, match="TorchRLEnv takes no keyword 'autoreset_mode'"):
        TorchRLEnv(2, autoreset_mode="DISABLED")


def test_what_is_done_to_the_info_does_not_change_the_environment():
    env = DifferentiableVectorEnv(2, n=2, base="cart")
    _, info = env.reset(seed=0)
    action = torch.zeros(2, env.action_size, dtype=torch.float64, requires_grad=True)
    for _ in range(2):
        before = torch.cat(env.state).clone()
        for name in ("theta", "omega", "cart_position", "cart_velocity"):
            info[name].detach().add_(1.0)
        torch.testing.assert_close(torch.cat(env.state), before, rtol=0.0, atol=0.0)
        info = env.step(action)[-1]
    assert torch.autograd.grad(info["theta"].sum(), action)[0].abs().min() > 0.0


@pytest.mark.parametrize(
    ("theta", "omega", "message"),
    [
        ([np.nan, 0.0, 0.0], [0.0] * 3, "state must be finite"),
        ([2e5, 0.0, 0.0], [0.0] * 3, "the angles of state must lie within"),
        ([0.0] * 3, [0.0, 2e6, 0.0], "the velocities of state must lie within"),
        ([0.0, 0.0, 2e5], [0.0] * 3, "the cart of state must lie within"),
        ([0.0] * 3, None, "state must be two tensors"),
    ],
)
def test_a_state_out_of_bounds_is_refused_and_the_environment_remains(theta, omega, message):
    env = DifferentiableVectorEnv(2, n=2, base="cart")
    env.reset(seed=0)
    before = torch.cat(env.state)
    given = [torch.tensor([x] * 2, dtype=torch.float64) for x in (theta, omega) if x is not None]
    with pytest.raises(ValueError, match=message):
        env.state = given
    torch.testing.assert_close(torch.cat(env.state), before, rtol=0.0, atol=0.0)
    env.step(torch.zeros(2, env.action_size, dtype=torch.float64))


def test_bad_actions_change_nothing():
    env = DifferentiableVectorEnv(2, n=2)
    env.reset(seed=0)
    before = torch.cat(env.state)
    for action, error in (
        (torch.zeros(2, 1), TypeError),
        (torch.zeros(2, dtype=torch.float64), ValueError),
        (torch.full((2, 1), np.nan, dtype=torch.float64), ValueError),
        (np.zeros((2, 1)), TypeError),
    ):
        with pytest.raises(error, match="action must"):
            env.step(action)
    torch.testing.assert_close(torch.cat(env.state), before, rtol=0.0, atol=0.0)


@pytest.mark.parametrize("task", [{"observation": "sincos"}, {"mode": "passive"}])
def test_torchrl_takes_the_environment_with_gradients_through_rollouts(task):
    pytest.importorskip("torchrl")
    from torchrl.envs.utils import check_env_specs

    from npend_gym.torch import TorchRLEnv

    env = TorchRLEnv(4, max_episode_steps=15, **task)
    with torch.enable_grad():
        check_env_specs(env)
    env.set_seed(3)
    rollout = env.rollout(40, break_when_any_done=False)
    assert rollout["next", "truncated"].sum() == 8
    native = NPendulumVectorEnv(4, max_episode_steps=15, autoreset_mode="DISABLED", **task)
    np.testing.assert_array_equal(
        rollout["observation"][:, 0].to(torch.float32), native.reset(seed=3)[0]
    )
    if "mode" in task:
        return
    gain = torch.full((6, 1), 0.5, dtype=torch.float64, requires_grad=True)

    def policy(tensordict):
        return tensordict.set("action", torch.tanh(tensordict["observation"] @ gain))

    env.set_seed(3)
    env.rollout(10, policy)["next", "reward"].sum().backward()
    direct = DifferentiableVectorEnv(4, **task)
    observation, total = direct.reset(seed=3)[0], 0.0
    for _ in range(10):
        observation, reward, *_ = direct.step(torch.tanh(observation @ gain))
        total = total + reward.sum()
    (expected,) = torch.autograd.grad(total, gain)
    torch.testing.assert_close(gain.grad, expected)
