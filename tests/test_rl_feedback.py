"""Linear feedback: weights, gains and places of one's own, and starts from exact rest."""

import itertools

import gymnasium as gym
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from scipy.signal import cont2discrete

from npend_gym import Cart, Chain, physics, rl, simulate
from npend_gym.chain import STANDARD_GRAVITY
from npend_gym.envs import EnvConfig
from npend_gym.export import policy_of
from npend_gym.rl.controllers.step_model import joined

CART = {"n": 1, "mode": "balance", "base": "cart"}


def cart_pole(config):
    """Return A and B of an upright point mass on a cart, from Newton's equations."""
    mass, length, cart = config.chain.masses[0], config.chain.lengths[0], config.cart_mass
    g = config.chain.gravity
    a = np.zeros((4, 4))
    a[:2, 2:] = np.eye(2)
    a[3, 0] = mass * g / cart  # the cart: (F + m g delta) / M
    a[2, 0] = (1.0 + mass / cart) * g / length
    return a, np.array([[0.0], [0.0], [1.0 / (cart * length)], [1.0 / cart]])


def test_q_and_r_give_the_gain_of_scipys_riccati_equation():
    config = EnvConfig(**CART)
    rng = np.random.default_rng(0)
    root = rng.normal(size=(4, 4))
    q, of_force = root @ root.T, 0.03
    a, b, *_ = cont2discrete((*cart_pole(config), np.eye(4), np.zeros((4, 1))), config.dt)
    s = solve_discrete_are(a, b, q, np.array([[of_force]]))
    expected = np.linalg.solve(of_force + b.T @ s @ b, b.T @ s @ a)  # N
    r = of_force * np.outer(config.action_limits, config.action_limits)
    found = rl.lqr(config, Q=q, R=r).gain * config.action_limits[:, None]
    np.testing.assert_allclose(found, expected, rtol=1e-7)
    by_diagonals = rl.lqr(config, Q=np.diag(q), R=np.diag(r)).gain
    np.testing.assert_array_equal(by_diagonals, rl.lqr(config, Q=np.diag(np.diag(q)), R=r).gain)


def test_q_and_r_as_documented_are_what_is_used_without_them():
    config = EnvConfig(n=2, mode="balance", base="cart", actuated=(1,), rail=3.0)
    of_q = np.array([1.0, 1.0, 4.0 / 9.0])
    of_u = of_q * config.chain.lengths.mean() / STANDARD_GRAVITY
    found = rl.lqr(config, Q=np.concatenate([of_q, of_u]), R=np.full(2, 3.0)).gain
    np.testing.assert_allclose(found, rl.lqr(config, action_weight=3.0).gain, rtol=1e-4)


def test_a_stable_chain_needs_no_feedback_where_no_state_costs_anything():
    config = EnvConfig(n=2, mode="calm", damping=0.3)
    np.testing.assert_allclose(rl.lqr(config, 0.0, Q=np.zeros(4)).gain, 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"Q": np.eye(3)}, r"Q must have the shape \(4, 4\), or \(4,\).* the cart's position"),
        ({"Q": np.eye(4) + np.eye(4, k=1)}, r"Q must be symmetric.* \(Q \+ Q\.T\) / 2"),
        ({"Q": [1.0, -1.0, 1.0, 1.0]}, "Q must be positive semidefinite, got an eigenvalue of -1"),
        ({"R": [0.0]}, "R must be positive definite, got an eigenvalue of 0"),
        ({"R": np.eye(2)}, r"R must have the shape \(1, 1\)"),
        ({"R": [1.0], "action_weight": 2.0}, "action_weight must be left out with R"),
        ({"cart_position": 9.0}, r"cart_position must lie within \+-2 m, 1 of the rail, got 9"),
    ],
)
def test_weights_and_places_that_break_a_rule_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        rl.lqr(EnvConfig(**CART), **arguments)


@pytest.mark.parametrize("make", [rl.lqr, rl.MPC, rl.energy_swing_up, rl.planned_swing_up])
def test_a_place_without_a_cart_is_refused(make):
    with pytest.raises(ValueError, match=r'cart_position must be left out .* base="cart"'):
        make(EnvConfig(n=1, mode="swingup"), cart_position=0.5)


def test_weights_that_leave_a_growing_state_free_are_refused_with_the_way_out():
    with pytest.raises(np.linalg.LinAlgError, match="or with weights in Q of all"):
        rl.lqr(EnvConfig(n=2, mode="calm"), 0.0, Q=np.zeros(4))


def last_state(controller, keywords, options, seconds):
    """Return the states (q, u), (2, 2c), in which a controller leaves two environments."""
    envs = gym.make_vec("NPendulum-v0", 2, **keywords)
    observation, info = envs.reset(seed=0, options=options)
    for _ in range(round(seconds / envs.unwrapped.config.dt)):
        observation, _, over, _, info = envs.step(controller(observation, info))
        assert not over.any()
    cart = (info["cart_position"], info["cart_velocity"]) if "cart_position" in info else ()
    return joined(info["theta"], info["omega"], cart)


UPRIGHT = {"theta": np.pi, "omega": 0.0, "cart_position": 0.0, "cart_velocity": 0.0}
HANGING = UPRIGHT | {"theta": 0.0}


def resting(config, rest, lanes=2):
    """Return `rest` with arrays for all lanes, without a cart where there is none."""
    sized = {name: (lanes, config.n) if name in ("theta", "omega") else lanes for name in rest}
    own = [name for name in rest if config.has_cart or "cart" not in name]
    return {name: np.broadcast_to(rest[name], sized[name]).copy() for name in own}


@pytest.mark.parametrize("make", [rl.lqr, pytest.param(rl.MPC, marks=pytest.mark.long)])
def test_a_cart_comes_to_stand_where_it_is_to_stand(make):
    config = EnvConfig(**CART)
    controller = make(config, cart_position=-0.4)
    at_last = last_state(controller, CART, resting(config, UPRIGHT), 9.0)
    np.testing.assert_allclose(at_last, np.tile([np.pi, -0.4, 0.0, 0.0], (2, 1)), atol=0.02)


@pytest.mark.long
@pytest.mark.parametrize("guess", ["waves", "mpc"])
def test_a_plan_ends_with_the_cart_where_it_is_to_end(guess, tmp_path):
    keywords = CART | {"mode": "swingup"}
    config = EnvConfig(**keywords)
    plan = rl.planned_swing_up(config, 5.0, tries=2, guess=guess, cart_position=0.7)
    assert plan.nominal.states[0, 1] == 0.0
    assert plan.nominal.states[-1, 1] == 0.7
    at_last = last_state(plan, keywords, resting(config, HANGING), 15.0)
    np.testing.assert_allclose(np.cos(at_last[:, 0]), -1.0, atol=1e-3)
    np.testing.assert_allclose(at_last[:, 1], 0.7, atol=0.02)
    crane = rl.planned_transition(config, 0.0, 0.0, 5.0, tries=2, guess=guess, cart_position=0.7)
    at_last = last_state(crane, keywords, resting(config, HANGING), 15.0)
    np.testing.assert_allclose(at_last, np.tile([0.0, 0.7, 0.0, 0.0], (2, 1)), atol=0.02)
    rl.PlannedTransitions({((False,), (True,)): plan}).save(tmp_path / "plans.npz")
    (again,) = rl.PlannedTransitions.load(tmp_path / "plans.npz", config).plans.values()
    assert again.hold_goal.cart_position == 0.7
    with pytest.raises(ValueError, match=r"cart_position must lie within \+-1\.7 m, 0\.85 of the"):
        rl.planned_swing_up(config, 5.0, cart_position=1.9)


@pytest.mark.long
def test_energy_shaping_swings_up_to_where_the_cart_is_to_stand():
    keywords = CART | {"mode": "swingup"}
    config = EnvConfig(**keywords)
    controller = rl.energy_swing_up(config, cart_position=0.3)
    at_last = last_state(controller, keywords, resting(config, HANGING), 40.0)
    np.testing.assert_allclose(np.cos(at_last[:, 0]), -1.0, atol=1e-3)
    np.testing.assert_allclose(at_last[:, 1], 0.3, atol=0.02)


# -- the force on a cart has one number ----------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("joints", [(2, 0), (0, 2, 1), (1, 2), (2,)])
def test_joints_name_the_force_on_a_cart_as_the_settings_of_environments_do(joints):
    chain = Chain.uniform(2, base=Cart(1.5, 0.1))
    state = {"theta": [0.3, -0.7], "omega": [0.2, 0.4]}
    loads = dict(zip([0, 1, 2], np.eye(3), strict=True))
    for function, more in ((physics.linearise, {}), (physics.step_jacobian, {"dt": 0.02})):
        given = state | more
        plain = function(chain, **given, joints=[0, 1]).B  # the force is last
        found = function(chain, **given, joints=joints).B
        np.testing.assert_allclose(found, plain @ np.array([loads[j] for j in joints]).T)
    rates = physics.linearise(chain, **state, joints=joints).B[3:]
    rest = physics.accelerations(chain, **state)
    for column, joint in zip(rates.T, joints, strict=True):
        load = {"force": 1.0} if joint == 2 else {"torque": np.eye(2)[joint]}
        np.testing.assert_allclose(physics.accelerations(chain, **state, **load) - rest, column)
    motion = simulate(chain, **state, times=[0.0, 0.1])
    both = motion.sensitivities(joints=[0, 1]).B[-1], motion.sensitivities(joints=joints).B[-1]
    np.testing.assert_allclose(both[1], both[0] @ np.array([loads[j] for j in joints]).T)


def test_the_joints_of_an_environment_are_those_of_its_linearisation():
    config = EnvConfig(n=2, mode="balance", base="cart", actuated=(1,))
    assert config.joints.tolist() == [2, 1]
    found = physics.linearise(config.chain, np.pi, joints=config.joints).B
    force_last = physics.linearise(config.chain, np.pi, joints=[1]).B
    np.testing.assert_array_equal(found, force_last[:, ::-1])


@pytest.mark.parametrize(
    "make",
    [
        lambda: physics.linearise(Chain.uniform(2), 0.0, joints=(2,)),
        lambda: physics.Ensemble(Chain.uniform(2, base=Cart(1.0)), joints=(0, 2)),
    ],
)
def test_the_force_on_a_cart_among_joints_that_lack_it_is_refused(make):
    with pytest.raises(
        ValueError, match=r"joint must be between 0 and 1.* 2 would be the force on"
    ):
        make()


# -- a gain of one's own -------------------------------------------------------------------------


def test_a_gain_of_another_tool_acts_in_newton_metres():
    config = EnvConfig(n=2, mode="balance", base="cart", actuated=(1,), max_torque=3.0)
    gain = np.random.default_rng(0).normal(size=(2, 6))
    angle = np.array([0.4, np.pi])
    controller = rl.state_feedback(config, gain, angle, cart_position=0.2)
    state = np.array([0.5 - 4.0 * np.pi, 3.0, 0.1, 0.2, -0.3, 0.4])
    loads = -gain @ [0.1, 3.0 - np.pi, -0.1, 0.2, -0.3, 0.4]
    info = {"theta": state[:2], "omega": state[3:5], "cart_position": 0.1, "cart_velocity": 0.4}
    np.testing.assert_allclose(controller(None, info) * config.action_limits, loads)
    own = rl.lqr(config)
    again = rl.state_feedback(config, own.gain * config.action_limits[:, None])
    np.testing.assert_allclose(again.gain, own.gain)
    assert "cart_position=0.2" in repr(controller)


@pytest.mark.parametrize(
    ("keywords", "gain", "error", "message"),
    [
        ({}, np.ones((4, 1)), ValueError, r"gain must have the shape \(1, 4\).*2 angular velocit"),
        ({}, [1.0, 2.0, np.nan, 0.0], ValueError, "gain must be finite"),
        ({"max_torque": 0.0}, np.ones(4), ValueError, "must be greater than zero for a feedback"),
        ({}, "K", TypeError, "gain must hold real numbers"),
    ],
)
def test_a_gain_that_is_none_is_refused(keywords, gain, error, message):
    with pytest.raises(error, match=message):
        rl.state_feedback(EnvConfig(n=2, mode="balance", **keywords), gain)


FEEDBACK = {
    "two rods": ({"n": 2, "mode": "balance"}, np.pi, 0.0),
    "folded": ({"n": 2, "mode": "balance", "actuated": (0, 1)}, np.array([0.0, np.pi]), 0.0),
    "inclined": ({"n": 2, "mode": "calm", "observation": "scaled"}, np.array([-0.8, 1.3]), 0.0),
    "cart": ({"n": 2, "mode": "balance", "base": "cart", "actuated": (1,)}, np.pi, 0.3),
    "goals": ({"n": 2, "mode": "transition", "observe_velocities": False}, -3.0, 0.0),
}


@pytest.mark.parametrize("name", FEEDBACK)
def test_the_policy_of_a_feedback_is_minus_k_times_the_wrapped_deviation(name, tmp_path):
    keywords, angle, place = FEEDBACK[name]
    config, rng = EnvConfig(**keywords), np.random.default_rng(1)
    gain = rng.normal(size=(config.joints.size, config.state_size))
    loads = gain * 0.1 * config.action_limits[:, None]
    policy = policy_of(rl.state_feedback(config, loads, angle, cart_position=place))
    policy.save(tmp_path / "own.safetensors")
    policy = rl.Policy.load(tmp_path / "own.safetensors")
    n, near = config.n, rng.random(5000) < 0.5
    theta = np.where(
        near[:, None], angle + rng.normal(0.0, 0.1, (5000, n)), rng.uniform(-9, 9, (5000, n))
    )
    omega, cart = rng.normal(0.0, 2.0, (5000, n)), rng.normal(0.0, 0.3, (2, 5000))
    given = {"cart_position": cart[0], "cart_velocity": cart[1]} if config.has_cart else {}
    given |= {"goal": np.zeros(n)} if config.observes_goals else {}
    found = policy.act(theta, omega, **given)
    away = (theta - angle + np.pi) % (2.0 * np.pi) - np.pi
    parts = [away, cart[:1].T - place, omega, cart[1:].T] if config.has_cart else [away, omega]
    expected = np.clip(-0.1 * np.hstack(parts) @ gain.T, -1.0, 1.0)
    beside = np.all(np.abs(away) < np.pi - 1.1e-3, axis=1)
    assert beside.mean() > 0.99
    # float32 shows an angle near pi to 2.4e-7 rad
    np.testing.assert_allclose(found[beside], expected[beside], rtol=0.0, atol=2e-6)
    assert (np.abs(found) <= 1.0).all()


def test_the_policy_of_a_regulator_balances_as_it_does():
    for keywords in ({"n": 2, "mode": "balance"}, CART):
        policy = policy_of(rl.lqr(EnvConfig(**keywords)))
        assert rl.evaluate(policy, policy.env, episodes=20).success_rate == 1.0


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: rl.MPC(EnvConfig(n=1, mode="balance")), TypeError, "controller must be what rl.l"),
        (lambda: rl.lqr(EnvConfig(n=1, torque_levels=3)), ValueError, "torque_levels must be left"),
    ],
)
def test_what_is_no_continuous_linear_feedback_has_no_policy(make, error, message):
    with pytest.raises(error, match=message):
        policy_of(make())


# -- exact rest ----------------------------------------------------------------------------------

KINDS = {
    "point": {"n": 1},
    "two points": {"n": 2},
    "two motors": {"n": 2, "actuated": (0, 1)},
    "drag": {"n": 1, "drag": 0.1},
    "link": {"chain": Chain([1.0], [0.8], centres=0.4, inertias=0.05)},
    "friction": {"chain": Chain([1.0], [0.8], centres=0.4, inertias=0.05, friction=0.1)},
    "rotor": {"chain": Chain([1.0], [0.8], centres=0.4, inertias=0.05, armature=0.01, gear=6.0)},
    "discrete": {"n": 1, "torque_levels": 3},
    "cart": {"n": 1, "base": "cart"},
    "two on a cart": {"n": 2, "base": "cart"},
    "link on a cart": {"chain": Chain([1.0], [0.8], centres=0.4, inertias=0.05, base=Cart(1.5))},
}
RESTS = {"hanging": 0.0, "folded": np.array([0.0, np.pi]), "turned": 2.0 * np.pi}


def moved(controller, keywords, rest, seconds):
    """Return how far each rod gets from rest, (2,), and compare a single environment."""
    config = EnvConfig(**keywords)
    env, envs = gym.make("NPendulum-v0", **keywords), gym.make_vec("NPendulum-v0", 2, **keywords)
    observation, info = envs.reset(seed=0, options=resting(config, HANGING | {"theta": rest}))
    alone = {name: value[0] for name, value in resting(config, HANGING | {"theta": rest}).items()}
    shown, of_one = env.reset(seed=0, options=alone)
    np.testing.assert_allclose(controller(observation, info)[0], controller(shown, of_one))
    farthest = np.zeros(2)
    for _ in range(round(seconds / config.dt)):
        observation, _, _, _, info = envs.step(controller(observation, info))
        farthest = np.maximum(farthest, np.abs(info["theta"] - rest).max(axis=1))
    return farthest


@pytest.mark.parametrize(
    ("kind", "rest"),
    [
        *(
            pytest.param(kind, rest, marks=[pytest.mark.long] * (kind == "rotor"))
            for kind in KINDS
            for rest in ("hanging", "turned")
        ),
        *((kind, "folded") for kind in ("two points", "two motors", "two on a cart")),
    ],
)
def test_energy_shaping_leaves_exact_rest(kind, rest):
    keywords = KINDS[kind] | {"mode": "swingup"}
    config = EnvConfig(**keywords)
    controller = rl.energy_swing_up(config)
    assert (moved(controller, keywords, RESTS[rest], 8.0) > 0.5).all()


@pytest.mark.parametrize(
    "keywords", [{"n": 1}, pytest.param({"n": 1, "base": "cart"}, marks=pytest.mark.long)]
)
def test_energy_shaping_swings_up_from_exact_rest(keywords):
    keywords = keywords | {"mode": "swingup"}
    config = EnvConfig(**keywords)
    at_last = last_state(rl.energy_swing_up(config), keywords, resting(config, HANGING), 40.0)
    np.testing.assert_allclose(np.cos(at_last[:, 0]), -1.0, atol=1e-3)


@pytest.mark.long
@pytest.mark.parametrize(
    ("make", "kind"),
    [
        (make, kind)
        for make, kind in itertools.product((rl.MPC, rl.planned_swing_up, rl.lqr), KINDS)
        if (make, kind) != (rl.MPC, "discrete")  # three levels are too coarse for it
    ],
)
def test_all_that_swings_up_leaves_exact_rest(make, kind):
    keywords = KINDS[kind] | {"mode": "swingup"}
    config = EnvConfig(**keywords)
    assert (moved(make(config), keywords, 0.0, 4.0) > 0.3).all()


@pytest.mark.long
@pytest.mark.parametrize("kind", ["point", "friction", "cart"])
def test_planned_transitions_leave_exact_rest(kind):
    keywords = KINDS[kind] | {"mode": "transition"}
    config = EnvConfig(**keywords)
    plans = rl.planned_transitions(config, 5.0, tries=2)
    envs = gym.make_vec("NPendulum-v0", 2, **keywords)
    ends = {"start": np.zeros((2, 1)), "goal": np.full((2, 1), np.pi)}
    observation, info = envs.reset(seed=0, options=ends)
    envs.reset(seed=0, options=ends | resting(config, HANGING))
    for _ in range(round(8.0 / config.dt)):
        observation, _, _, _, info = envs.step(plans(observation, info))
    np.testing.assert_allclose(np.cos(info["theta"]), -1.0, atol=1e-2)


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(kind, marks=[pytest.mark.long] * (kind == "rotor"))
        for kind in KINDS
        if kind != "discrete"
    ],
)
def test_what_holds_an_equilibrium_does_nothing_in_it(kind):
    config = EnvConfig(**KINDS[kind], mode="swingup")
    hanging, upright = (np.zeros(config.state_size) for _ in range(2))
    upright[: config.n] = np.pi
    np.testing.assert_array_equal(rl.lqr(config).actions(upright), 0.0)
    np.testing.assert_array_equal(rl.modal_damping(config).actions(hanging), 0.0)
