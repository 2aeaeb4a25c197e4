"""Reference controllers and evaluation against linear theory and closed forms."""

import itertools
from statistics import NormalDist

import gymnasium as gym
import numpy as np
import pytest

from npend_gym import rl, simulate
from npend_gym.envs import EnvConfig
from npend_gym.rl import (
    MPC,
    Evaluation,
    Outcome,
    Performance,
    PlannedTransition,
    Recovery,
    Robustness,
    evaluate,
)
from npend_gym.rl.controllers import regulators
from npend_gym.rl.controllers.references import reference_controller
from npend_gym.rl.controllers.transcription import NominalTrajectory


def idle(observation, info):
    return np.zeros((len(observation), info["torque"].shape[1]))


@pytest.mark.parametrize("angle", [0.0, np.pi])
@pytest.mark.parametrize("keywords", [{}, {"base": "cart", "actuated": (1,), "rail_damping": 0.2}])
def test_the_discretised_map_is_the_motion_of_the_chain_in_one_step(angle, keywords):
    config = EnvConfig(n=3, mode="balance", damping=0.3, **keywords)
    a, b = regulators.discretise(config, angle)
    rng = np.random.default_rng(0)
    small = 1e-5 * rng.normal(size=config.state_size)
    c = config.state_size // 2
    cart = {"position": small[3], "velocity": small[c + 3]} if config.has_cart else {}
    for action in np.eye(config.joints.size) * 1e-6:
        loads = action * config.action_limits
        torque, force = np.zeros(3), loads[config.joints == 3].sum()
        torque[config.joints[config.joints < 3]] = loads[config.joints < 3]
        motion = simulate(
            config.chain, angle + small[:3], small[c : c + 3], [0.0, config.dt], torque=torque,
            force=force, **cart,
        )  # fmt: skip
        parts = [motion.theta[1] - angle, motion.omega[1]]
        if config.has_cart:
            parts = [parts[0], motion.position[1:], parts[1], motion.velocity[1:]]
        after = np.concatenate(parts)
        np.testing.assert_allclose(after, a @ small + b @ action, atol=1e-9)
        assert np.abs(b @ action).max() > 1e-7


@pytest.mark.parametrize(
    ("n", "keywords"),
    [
        (1, {}),
        (2, {}),
        (3, {}),
        (1, {"base": "cart"}),
        (2, {"base": "cart"}),
        (2, {"base": "cart", "actuated": (1,)}),
        (2, {"actuated": (1,)}),
        pytest.param(2, {"chain": "realaigym C.1"}, marks=pytest.mark.long),
        (3, {"base": "cart", "max_force": 300.0}),
        (1, {"chain": "cartpole", "rail": 2.4, "max_force": 10.0}),
        (2, {"chain": "dm_control cartpole 2", "rail": 1.8, "max_force": 10.0}),
    ],
)
def test_lqr_balances_every_held_out_start(n, keywords):
    task = keywords | {"mode": "balance"} | ({} if "chain" in keywords else {"n": n})
    regulator = regulators.lqr(EnvConfig(**task))
    assert evaluate(regulator, task, episodes=20).success_rate == 1.0
    assert evaluate(idle, task, episodes=20).success_rate == 0.0


@pytest.mark.parametrize("n", [1, 2])
@pytest.mark.parametrize("make", [regulators.lqr, rl.energy_swing_up])
def test_motors_that_cannot_stabilise_the_chain_make_no_regulator(make, n):
    with pytest.raises(np.linalg.LinAlgError):
        make(EnvConfig(n=n, max_torque=0.0))
    with pytest.raises(np.linalg.LinAlgError, match=r"stabilise the equilibrium at angle 3\.14"):
        make(EnvConfig(n=1, max_torque=1e-20))


def test_the_regulator_of_many_rods_is_right_or_says_that_double_precision_ends():
    for n, size in ((10, 230043.150), (12, 2972092.270)):  # by doubling, with 60 digits
        gain = regulators.lqr(EnvConfig(n=n, mode="balance")).gain
        assert np.linalg.norm(gain) == pytest.approx(size, rel=5e-5)
    message = (
        r"double precision must suffice for 20 rods .* joints \[0\]; .* fewer rods, more motors"
    )
    with pytest.raises(np.linalg.LinAlgError, match=message):
        regulators.lqr(EnvConfig(n=20, mode="balance"))


def test_a_regulator_keeps_its_angles_where_the_callers_array_changes():
    angle = np.array([0.0, np.pi])
    regulator = regulators.lqr(EnvConfig(n=2, mode="balance"), angle)
    angle[:] = 0.0
    np.testing.assert_array_equal(regulator.deviation(np.array([0.0, np.pi, 0.0, 0.0])), 0.0)


def test_the_regulators_cost_is_the_cost_of_the_linear_system():
    config = EnvConfig(n=2, mode="balance")
    gain, cost, _ = regulators.riccati(config, np.pi, action_weight=2.0)
    a, b = regulators.discretise(config, np.pi)
    x = np.array([0.1, -0.2, 0.3, 0.1])
    expected, total = x @ cost @ x, 0.0
    for _ in range(3000):
        u = -gain @ x
        total += x[:2] @ x[:2] + x[2:] @ x[2:] / 9.81 + 2.0 * u @ u
        x = a @ x + b @ u
    assert total == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("n", "least", "base"),
    [
        (1, 1.0, "pivot"),
        pytest.param(2, 0.5, "pivot", marks=pytest.mark.long),
        pytest.param(1, 1.0, "cart", marks=pytest.mark.long),
    ],
)
def test_energy_shaping_swings_up_one_rod_always_and_two_rods_mostly(n, least, base):
    keywords = {"n": n, "mode": "swingup", "base": base}
    evaluation = evaluate(rl.energy_swing_up(EnvConfig(**keywords)), keywords, episodes=20)
    assert evaluation.success_rate >= least
    assert evaluation.settling_time[evaluation.success].max() <= 50.0


@pytest.mark.parametrize(
    ("n", "keywords"), [(1, {}), (2, {}), (5, {}), (1, {"base": "cart"}), (3, {"base": "cart"})]
)
def test_modal_damping_calms_the_chain_faster_than_brakes_of_other_strength(n, keywords):
    nearly_linear = {"amplitude": 0.05, "spread": 0.0}
    keywords = {"n": n, "mode": "calm"} | nearly_linear | keywords
    config = EnvConfig(**keywords)
    best = regulators.modal_damping(config)
    assert evaluate(best, keywords, episodes=1).success_rate == 1.0
    a, b = regulators.discretise(config, 0.0)
    radius = {
        factor: np.sort(np.abs(np.linalg.eigvals(a - factor * b @ best.gain)))
        for factor in (0.5, 1.0, 2.0)
    }
    if config.has_cart:  # nothing but the brake acts on where the whole is: it stays there
        assert all(each[-1] == pytest.approx(1.0, abs=1e-9) for each in radius.values())
    slowest = {factor: each[-2 if config.has_cart else -1] for factor, each in radius.items()}
    assert slowest[1.0] < min(slowest[0.5], slowest[2.0])


@pytest.mark.parametrize("limit", [1e-3, 1e6])
def test_modal_damping_is_the_same_brake_for_motors_of_any_strength(limit):
    brakes = [
        regulators.modal_damping(EnvConfig(n=2, mode="calm", max_torque=each)).gain * each
        for each in (20.0, limit)
    ]
    np.testing.assert_allclose(*brakes, rtol=1e-3)


@pytest.mark.parametrize(
    "lag",
    # the kernels of motors take long to compile
    [0.0, pytest.param(0.3, marks=pytest.mark.long)],
)
def test_the_work_of_a_motor_is_that_of_the_torque_that_acted_not_of_the_command(lag):
    # without gravity, all that such a motor does becomes kinetic energy
    keywords = {"n": 1, "mode": "swingup", "gravity": 0.0, "max_episode_steps": 40}
    lagging = keywords | {"motor_lag": lag}
    evaluation = evaluate(lambda o, _: np.full((len(o), 1), 0.5), lagging, episodes=3)
    assert evaluation.as_row()["success"] == 0.0
    assert np.isnan(evaluation.settling_time).all()
    envs = gym.make_vec("NPendulum-v0", num_envs=3, **lagging)
    infos = [envs.reset(seed=1_000_000)[1]]
    infos += [envs.step(np.full((3, 1), 0.5))[-1] for _ in range(40)]
    gained = infos[-1]["energy"] - infos[0]["energy"]
    # the start turns the chain a little the other way, or the motor's way, which counts either way
    np.testing.assert_allclose(evaluation.motor_work, gained, rtol=0.03)
    limit = EnvConfig(n=1, gravity=0.0).max_torque
    t = 0.05 * np.arange(41)
    acted = np.full(40, 0.5 * limit)  # means over the steps of 1 - exp(-t / lag)
    if lag > 0.0:
        acted *= 1.0 + lag / 0.05 * np.diff(np.exp(-t / lag))
    for info, torque in zip(infos[1:], acted, strict=True):
        np.testing.assert_allclose(info["torque"], np.full((3, 1), torque), rtol=1e-9)


def test_evaluation_agrees_with_single_environments():
    keywords = {"n": 1, "mode": "balance", "max_episode_steps": 300}
    evaluation = evaluate(idle, keywords, episodes=30)
    env = gym.make("NPendulum-v0", **keywords)
    for k in range(30):
        env.reset(seed=1_000_000 + k)
        total, over = 0.0, False
        while not over:
            _, reward, terminated, truncated, info = env.step(np.zeros(1))
            total, over = total + reward, terminated or truncated
        assert evaluation.returns[k] == pytest.approx(total, rel=1e-12)
        assert evaluation.success[k] == info["success"]


def test_results_and_controllers_can_be_compared_and_found_in_lists():
    balance = EnvConfig(n=1, mode="balance")
    ones = np.ones(3)
    makers = (
        lambda: Evaluation(ones, ones > 0.0, ones, ones),
        lambda: Performance(ones > 0.0, *[ones] * 8),
        lambda: Recovery(ones),
        lambda: Robustness({"model": Outcome(["a", "b", "c"], ones, ones > 0.0)}, {}),
        lambda: regulators.lqr(balance),
        lambda: rl.energy_swing_up(balance),
        lambda: PlannedTransition(None, ones, ones, ones, idle, idle, 0.0),
    )
    for make in makers:
        one, other = make(), make()
        assert one == one  # noqa: PLR0124 - which raised once
        assert one in [other, one]
        assert one != other  # as arrays of NumPy, they are compared entry by entry or not at all


def planned(config):
    """Return a controller that tracks a motion which is none, by gains and costs of all kinds."""
    rng, size = np.random.default_rng(0), config.state_size
    joints = config.joints.size
    nominal = NominalTrajectory(rng.normal(size=(11, size)), rng.normal(size=(10, joints)))
    gains, costs = rng.normal(size=(10, joints, size)), rng.normal(size=(11, size, size))
    hold = regulators.lqr(config, 0.0), regulators.lqr(config)
    return PlannedTransition(nominal, gains, costs, gains[:, :, 0], *hold, 0.1)


def predictive(config):
    return MPC(config, horizon=0.25, first_iterations=2)


MOTORS = [{}, {"base": "cart", "actuated": (1,)}, {"actuated": (1,)}]
MAKERS = [regulators.lqr, regulators.modal_damping, rl.energy_swing_up, planned, predictive]
NO_PUMP = rl.energy_swing_up, MOTORS[2]  # it is refused


@pytest.mark.parametrize(
    ("made", "keywords"),
    [
        pytest.param(*each, marks=[pytest.mark.long] * (each[0] is predictive))
        for each in itertools.product(MAKERS, MOTORS)
        if each != NO_PUMP
    ],
)
def test_controllers_take_the_info_of_a_single_environment(made, keywords):
    keywords = keywords | {"n": 2, "mode": "calm"}
    config, infos = EnvConfig(**keywords), []
    controller, beside = made(config), made(config)
    env, envs = gym.make("NPendulum-v0", **keywords), gym.make_vec("NPendulum-v0", 3, **keywords)
    info, infos = env.reset(seed=1)[1], envs.reset(seed=0)[1]
    for _ in range(3 if made is predictive else 14):
        action, actions = controller(None, info), beside(None, infos)
        assert action.shape == config.joints.shape
        np.testing.assert_allclose(action, actions[1], rtol=1e-9, atol=1e-12)
        info, infos = env.step(action)[-1], envs.step(actions)[-1]
    if made is planned:
        assert controller.tracking(info).deviation.shape == (config.state_size,)
        assert controller.tracking(info).relative_cost.shape == ()


@pytest.mark.parametrize(
    "make",
    [
        rl.lqr,
        rl.energy_swing_up,
        rl.modal_damping,
        MPC,
        rl.planned_swing_up,
        rl.planned_transitions,
    ],
)
def test_a_controller_that_is_given_the_environment_asks_for_its_settings(make):
    with pytest.raises(TypeError, match=r"config must be .*env\.unwrapped\.config"):
        make(gym.make("npend/SwingUp-v1"))


def test_results_are_printed_as_one_line_of_means():
    ones = np.ones(300)
    found = Evaluation(2.0 * ones, np.arange(300) < 150, 3.0 * ones, 4.0 * ones)
    assert str(found) == (
        "Evaluation(300 episodes: success 50.0% from 3.00 s on, 95 % confidence 44.4% to 55.6%; "
        "mean return 2.00, motor work 4.00 J)"
    )
    assert "success 0.0%, 95 %" in str(Evaluation(ones, ones > 2.0, np.nan * ones, ones))
    robustness = Robustness({"model": Outcome(["a"] * 300, ones, ones > 0.0)}, {})
    assert str(robustness) == "Robustness(score=1, model=1)"
    assert str(Recovery(ones)) == "Recovery(score=1, least=1, largest=1)"
    assert str(Performance(ones > 0.0, *[ones] * 8)).count("\n") == 0


def test_the_interval_of_the_success_rate_is_wilsons():
    nothing = np.zeros(100)
    evaluation = Evaluation(nothing, np.arange(100) < 97, nothing, nothing)
    p, z, (low, high) = 0.97, NormalDist().inv_cdf(0.975), evaluation.success_interval
    for bound in (low, high):  # both solve |p - bound| = z sqrt(bound (1 - bound) / 100)
        assert abs(p - bound) == pytest.approx(z * np.sqrt(bound * (1.0 - bound) / 100), rel=1e-9)
    assert low < p < high
    assert evaluation.as_row()["success_low"] == round(low, 4)


def test_evaluation_takes_models_with_predict():
    class Still:
        def predict(self, observation, *, deterministic):
            assert deterministic
            return np.zeros((len(observation), 1), np.float32), None

    task = {"n": 1, "mode": "balance", "max_episode_steps": 20}
    assert np.array_equal(*(evaluate(each, task, episodes=3).returns for each in (Still(), idle)))


def test_evaluate_takes_the_names_of_evaluate_policy():
    class Drawing:
        def predict(self, observation, *, deterministic):
            return np.full((len(observation), 1), 0.0 if deterministic else 1.0), None

    def full(observation, _):
        return np.ones((len(observation), 1))

    task = {"n": 1, "mode": "balance", "max_episode_steps": 20}
    drawn = evaluate(Drawing(), task, n_eval_episodes=3, deterministic=False).returns
    np.testing.assert_array_equal(drawn, evaluate(full, task, episodes=3).returns)
    still = evaluate(Drawing(), task, n_eval_episodes=3, deterministic=True).returns
    np.testing.assert_array_equal(still, evaluate(idle, task, episodes=3).returns)
    with pytest.raises(ValueError, match="n_eval_episodes must be left out where episodes"):
        evaluate(idle, task, n_eval_episodes=3, episodes=4)
    with pytest.raises(TypeError, match="deterministic must be True or False, got 1"):
        evaluate(idle, task, deterministic=1)
    for model in (idle, rl.Policy.pretrained("balance-1")):
        with pytest.raises(ValueError, match="deterministic must be True for a model without"):
            evaluate(model, task | {"observation": "sincos"}, deterministic=False)


def test_evaluate_takes_a_module_of_pytorch_and_leaves_it_as_it_was():
    torch = pytest.importorskip("torch")
    layer = torch.nn.Linear(3, 1)
    weight, bias = (each.detach().numpy() for each in layer.parameters())
    module = torch.nn.Sequential(layer, torch.nn.Dropout(0.5))
    task = {"n": 1, "mode": "balance", "observation": "sincos", "max_episode_steps": 20}
    found = evaluate(module, task, episodes=3).returns
    own = evaluate(lambda seen, _: seen @ weight.T + bias, task, episodes=3).returns
    np.testing.assert_allclose(found, own, rtol=1e-5)
    np.testing.assert_allclose(evaluate(module.double(), task, episodes=3).returns, own, rtol=1e-5)
    assert module.training
    assert module[1].training
    with pytest.raises(ValueError, match=r"model must take observations .*\(3, 6\).*cannot be mul"):
        evaluate(module, task | {"n": 2}, episodes=3)
    with pytest.raises(TypeError, match="model must return a tensor of actions, got"):
        evaluate(torch.nn.LSTM(3, 1), task, episodes=3)
    with pytest.raises(ValueError, match="deterministic must be True"):
        evaluate(module, task, deterministic=False)

    class Controller(torch.nn.Module):
        def forward(self, _, info):
            return 0.0 * info["theta"]

    still = evaluate(Controller(), task, episodes=3).returns
    np.testing.assert_array_equal(still, evaluate(idle, task, episodes=3).returns)


CALM = {"mode": "calm"}
LANES = {"theta": np.zeros((2, 1)), "omega": np.zeros((2, 1))}
ON_CART = LANES | {"cart_position": np.zeros(2), "cart_velocity": np.zeros(2)}


@pytest.mark.parametrize(
    ("keywords", "info", "message"),
    [
        ({}, LANES | {"omega": np.zeros((1, 1))}, r'"omega"\] must have the shape \(2, 1\)'),
        ({"base": "cart"}, ON_CART | {"cart_velocity": np.zeros(1)}, r'velocity"\] .* \(2,\)'),
        ({"torque_levels": 3}, LANES | {"theta": np.full((2, 1), np.nan)}, "action must be finite"),
    ],
)
def test_a_state_from_which_no_action_follows_is_refused(keywords, info, message):
    controller = rl.lqr(EnvConfig(n=1, **keywords))
    with pytest.raises(ValueError, match=message):
        controller(None, info)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda config: rl.lqr(config, action_weight=0.0), "action_weight must be"),
        (lambda config: rl.lqr(config, angle=1.0), "angle must be an equilibrium"),
        (lambda config: rl.energy_swing_up(config, pump_gain=np.nan), "pump_gain must be"),
        (lambda _: rl.energy_swing_up(EnvConfig(n=2, actuated=(1,))), "actuated must have the fir"),
        *[
            (lambda _, make=make: make(EnvConfig(n=2, mode="passive")), "must have motors")
            for make in (rl.lqr, rl.modal_damping, rl.energy_swing_up, rl.planned_swing_up, rl.MPC)
        ],
        (lambda _: reference_controller("LQR", {"mode": "transition"}), 'must be "plan" in mode'),
        *[
            (lambda _, each=each: reference_controller(*each), 'must not swing up in mode "')
            for each in (("plan", {"mode": "balance"}), ("plan", CALM), ("energy", CALM))
        ],
        (lambda _: rl.modal_damping(EnvConfig(gravity=0.0)), "gravity must be greater than zero"),
    ],
)
def test_what_makes_no_controller_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make(EnvConfig(n=1))
