"""Plans: each is a motion of the chain, and following it leads to the equilibrium planned for."""

import gymnasium as gym
import numpy as np
import pytest
from scipy.optimize import minimize

from npend_gym import Cart, Chain, simulate
from npend_gym.envs import EnvConfig
from npend_gym.rl import evaluate, planned_swing_up, planned_transition
from npend_gym.rl.controllers.planning import mpc_motions
from npend_gym.rl.controllers.references import reference_controller
from npend_gym.rl.controllers.regulators import softened
from npend_gym.rl.controllers.step_model import StepModel, state_of
from npend_gym.rl.controllers.tracking import track
from npend_gym.rl.controllers.transcription import MAX_ACTION, MAX_PLACE, Transcription, Weights


@pytest.fixture(scope="module")
def triple():
    return planned_swing_up(EnvConfig(n=3, mode="swingup"), seconds=4.5, tries=1, seed=1)


def check_motion(config, nominal):
    """Check steps of the trajectory by the adaptive method, which is not the environment's."""
    states, actions = nominal
    for k in range(0, len(actions), 7):
        motion = simulate(
            config.chain, *np.split(states[k], 2), [0.0, config.dt],
            torque=float(actions[k, 0]) * config.max_torque,
        )  # fmt: skip
        reached = np.concatenate([motion.theta[1], motion.omega[1]])
        np.testing.assert_allclose(reached, states[k + 1], atol=1e-5)


@pytest.mark.long  # derivatives of steps on a cart take long to compile
@pytest.mark.parametrize(
    ("seconds", "keywords"),
    [
        (4.0, {"n": 1, "base": "cart"}),
        (6.0, {"n": 2, "base": "cart"}),
        (4.0, {"chain": "cartpole", "rail": 2.4, "max_force": 10.0}),
    ],
)
def test_a_plan_swings_up_on_a_cart_within_its_rail_in_held_out_episodes(seconds, keywords):
    keywords = keywords | {"mode": "swingup"}
    config = EnvConfig(**keywords)
    plan = planned_swing_up(config, seconds, tries=2)
    states, actions = plan.nominal
    assert np.abs(actions).max() <= MAX_ACTION
    assert np.abs(states[:, config.n]).max() <= 1.001 * MAX_PLACE * config.rail
    np.testing.assert_array_equal(states[[0, -1]][:, config.n :: config.n + 1], 0.0)
    steps = round((seconds + 7.0) / config.dt)
    evaluation = evaluate(plan, keywords | {"max_episode_steps": steps}, episodes=20)
    assert evaluation.success_rate == 1.0


SHORT_RAIL = {"base": "cart", "rail": 1.8, "max_force": 10.0}  # of "npend/CartTriplePole-v1"


@pytest.mark.long
@pytest.mark.parametrize(
    ("n", "rail"),
    [
        (3, "default"),
        pytest.param(4, "default", marks=pytest.mark.nightly),
        pytest.param(5, "short", marks=pytest.mark.nightly),
    ],
)
def test_a_plan_swings_up_three_to_five_rods_on_a_cart_in_held_out_episodes(n, rail):
    keywords = {"n": n, "mode": "swingup", "base": "cart"}
    if rail == "short":
        keywords |= SHORT_RAIL | {"chain": Chain.dm_control("cartpole", n)}
    plan = reference_controller("plan", keywords)
    seconds = plan.settle + len(plan.gains) * 0.05
    steps = round((seconds + 7.0) / 0.05)
    evaluation = evaluate(plan, keywords | {"max_episode_steps": steps}, episodes=100)
    assert evaluation.success_rate == 1.0


def check_plan(config, controller, steps):
    """Check that a plan is a motion from hanging to upright, which chains follow in episodes."""
    states, actions = controller.nominal
    assert np.abs(actions).max() <= MAX_ACTION
    np.testing.assert_array_equal(states[0], 0.0)
    np.testing.assert_allclose(np.cos(states[-1, : config.n]), -1.0)
    np.testing.assert_array_equal(states[-1, config.n :], 0.0)
    check_motion(config, controller.nominal)
    keywords = {"n": config.n, "mode": "swingup", "max_episode_steps": steps}
    assert evaluate(controller, keywords, episodes=20).success_rate > 0.9


def test_a_motor_at_the_base_alone_swings_up_three_rods_in_held_out_episodes(triple):
    check_plan(EnvConfig(n=3, mode="swingup"), triple, 300)


@pytest.mark.long
@pytest.mark.parametrize(
    ("n", "seconds", "settle", "steps"),
    [(2, 4.0, 0.0, 240), pytest.param(6, 14.0, 10.0, 640, marks=pytest.mark.nightly)],
)
def test_swing_ups_by_model_predictive_control_are_guesses_that_lead_to_plans(
    n, seconds, settle, steps
):
    config = EnvConfig(n=n, mode="swingup")
    plan = planned_swing_up(config, seconds, settle=settle, tries=1, guess="mpc")
    check_plan(config, plan, steps)


def test_a_plan_shows_itself_in_a_line(triple):
    assert repr(triple) == "PlannedTransition(3 rods, 90 steps of 0.05 s, settle=0 s)"
    assert len(repr(triple.hold_goal).splitlines()) < 5


def test_a_trajectory_planned_in_air_includes_the_drag():
    config = EnvConfig(n=1, mode="swingup", drag=0.05, quadratic_drag=0.05)
    check_motion(config, planned_swing_up(config, seconds=4.0, tries=2).nominal)


@pytest.mark.parametrize(
    "keywords",
    [
        {},
        {"substeps": 3},
        {"drag": 0.1, "max_torque": 7.0},
        *(
            pytest.param(keywords, marks=pytest.mark.long)  # these take long to compile
            for keywords in (
                {"base": "cart"},
                {"base": "cart", "cart_mass": 0.05, "rail_damping": 0.3, "actuated": (2, 0)},
                {"chain": "dm_control cartpole 3", "max_torque": 5.0},
            )
        ),
    ],
)
def test_the_planner_takes_the_environments_own_steps_bit_for_bit(keywords):
    keywords = keywords | {"mode": "swingup"} | ({} if "chain" in keywords else {"n": 3})
    config, rng = EnvConfig(**keywords), np.random.default_rng(0)
    states = rng.normal(0.0, 3.0, (50, config.state_size))
    actions = rng.uniform(-1.0, 1.0, (50, config.joints.size))
    envs, (q, u) = gym.make_vec("NPendulum-v0", 50, **keywords), np.split(states, 2, axis=1)
    start = {"theta": q[:, :3], "omega": u[:, :3]}
    if config.has_cart:
        q[:, 3] *= 0.1
        start |= {"cart_position": q[:, 3], "cart_velocity": u[:, 3]}
    envs.reset(seed=0, options=start)
    info = envs.step(actions)[4]
    stepped = StepModel(config)(states, actions)
    np.testing.assert_array_equal(stepped, state_of(config, info))


@pytest.mark.long
def test_similar_chains_have_similar_plans_where_these_are_to_be_like_one_plan(triple):
    found = {True: [triple.nominal.actions], False: [triple.nominal.actions]}
    for like, each in found.items():
        for length in (1.005, 1.01, 1.015):
            config = EnvConfig(n=3, lengths=length, mode="swingup", max_torque=29.43)
            problem = Transcription(config, len(triple.gains), np.zeros(3), np.full(3, np.pi))
            guess = problem.unknowns(*triple.nominal)
            nominal = problem.solve(*guess, like=triple.nominal if like else None)
            check_motion(config, nominal)
            each.append(nominal.actions)
    steps = {like: np.abs(np.diff(each, axis=0)).max() for like, each in found.items()}
    assert steps[True] < 0.03 < steps[False]


@pytest.mark.parametrize(
    "keywords", [{"n": 2}, pytest.param({"n": 2, "base": "cart"}, marks=pytest.mark.long)]
)
def test_the_gradient_of_a_plans_cost_is_that_of_finite_differences(keywords):
    config, rng = EnvConfig(mode="swingup", **keywords), np.random.default_rng(0)
    weights = Weights(0.3, 0.2, slow_from=2 * config.dt)
    problem = Transcription(config, 6, np.zeros(2), np.full(2, np.pi), weights=weights)
    size = 6 * (problem.size + problem.joints) - problem.size
    z, directions = rng.normal(0.0, 0.5, size), rng.normal(size=(8, size))
    _, gradient = problem.normal_equations(z, problem.defects(z), 2.0)
    for along in directions:
        ends = [z + h * along for h in (1e-5, -1e-5)]
        difference = np.diff([problem.cost(end, problem.defects(end), 2.0) for end in ends])[0]
        assert 2.0 * gradient @ along == pytest.approx(-difference / 2e-5, rel=1e-5)
    # without motion between the states, the band is the second derivative of what is left
    still = Transcription(config, 6, np.zeros(2), np.full(2, np.pi), weights=weights)
    costs = [still.cost(z + h * directions[0], 0.0 * still.defects(z), 0.0) for h in (1, 0, -1)]
    left, _ = still.normal_equations(z, 0.0 * still.defects(z), 0.0)
    matrix = sum(np.diag(left[k, : size - k], -k) for k in range(len(left)))
    matrix += np.tril(matrix, -1).T
    expected = 0.5 * (costs[0] - 2.0 * costs[1] + costs[2])
    assert directions[0] @ matrix @ directions[0] == pytest.approx(expected, rel=1e-9)


def test_weights_make_a_plan_slow_and_smooth():
    config = EnvConfig(n=1, mode="swingup", max_torque=5.0)
    plain, slow, smooth = (
        planned_swing_up(config, 3.0, tries=1, guess="waves", **weights).nominal
        for weights in ({}, {"speed_weight": 3.0}, {"change_weight": 1.0})
    )
    speeds = [np.square(plan.states[:, 1]).sum() for plan in (plain, slow)]
    changes = [np.square(np.diff(plan.actions, axis=0)).sum() for plan in (plain, smooth)]
    assert speeds[1] < 0.95 * speeds[0]
    assert changes[1] < 0.5 * changes[0]
    with pytest.raises(ValueError, match="change_weight must be"):
        planned_swing_up(config, 3.0, change_weight=-1.0)


def test_a_plan_that_is_to_be_slow_near_its_end_is_not_slower_before():
    config = EnvConfig(n=1, mode="swingup", max_torque=5.0)
    options, after = {"tries": 1, "guess": "waves"}, round(2.0 / config.dt)
    plain, always, late = (
        np.square(planned_swing_up(config, 3.0, **options, **weights).nominal.states[:, 1])
        for weights in ({}, {"speed_weight": 6.0}, {"speed_weight": 6.0, "slow_from": 2.0})
    )
    assert late[after:].sum() < 0.6 * plain[after:].sum()
    assert late[:after].sum() > 0.99 * plain[:after].sum() > 1.02 * always[:after].sum()
    with pytest.raises(ValueError, match="slow_from must be"):
        planned_swing_up(config, 3.0, slow_from=-1.0)


def test_feedback_with_discrete_torques_leaves_the_least_cost_after_the_step():
    keywords = {"n": 2, "mode": "swingup", "actuated": (0, 1), "torque_levels": 5}
    config, rng = EnvConfig(**keywords), np.random.default_rng(0)
    plan = planned_swing_up(config, 4.0, tries=1, guess="waves")
    states, actions = plan.nominal
    a, b = StepModel(config).derivatives(states[:-1], actions)
    for k in range(0, len(actions), 8):
        deviation = rng.normal(size=4)

        def cost_after(change, k=k, deviation=deviation):
            away = a[k] @ deviation + b[k] @ change
            return away @ plan.costs[k + 1] @ away

        best = minimize(cost_after, np.zeros(2), method="BFGS", options={"gtol": 1e-10}).x
        np.testing.assert_allclose(-plan.gains[k] @ deviation, best, rtol=1e-4, atol=1e-4)


def test_a_plan_begins_from_any_whole_turn():
    plan = planned_swing_up(EnvConfig(n=1, mode="swingup"), 3.0, tries=1, guess="mpc")
    info = {"theta": np.array([[0.02], [-0.01]]), "omega": np.zeros((2, 1)), "time": np.zeros(2)}
    turned = info | {"theta": info["theta"] + 2.0 * np.pi * np.array([[-1.0], [3.0]])}
    np.testing.assert_allclose(plan(None, turned), plan(None, info), atol=1e-12)


def test_every_step_of_a_plan_is_taken_once_wherever_the_time_to_settle_ends():
    config = EnvConfig(n=1, mode="swingup")
    for steps in (2.4, 2.5, 3.5):
        plan = planned_swing_up(config, 3.0, settle=steps * config.dt, tries=1, guess="mpc")
        wait, states = round(steps), plan.nominal.states
        info = {"theta": states[:, :1], "omega": states[:, 1:]}
        info["time"] = (wait + np.arange(len(states))) * config.dt
        assert plan.tracking(info).relative_cost.max() < 1e-9


def test_with_settle_the_chain_is_calmed_before_the_trajectory_begins():
    config = EnvConfig(n=1, mode="swingup")
    controller = planned_swing_up(config, seconds=3.0, settle=4.0, tries=1)
    info = {"theta": np.full((3, 1), 0.1), "omega": np.zeros((3, 1))}
    before = controller(None, info | {"time": np.array([0.0, 1.0, 3.9])})
    np.testing.assert_array_equal(before, controller.hold_start(None, info))
    hanging = {"theta": np.zeros((1, 1)), "omega": np.zeros((1, 1))}
    begun = controller(None, hanging | {"time": np.full(1, 4.0)})
    np.testing.assert_allclose(begun[0], controller.nominal.actions[0])


@pytest.mark.parametrize(
    ("env", "arguments", "error", "message"),
    [
        ({"n": 1}, {"guess": "luck"}, ValueError, "guess must be one of waves, mpc; got 'luck'"),
        ({"n": 1}, {"seconds": 1e12}, ValueError, "seconds must be at most 50000 s"),
        (
            {"n": 1, "gravity": 0.0, "max_torque": 1.0}, {"guess": "mpc"},
            ValueError, 'guess must be "waves" without gravity',
        ),
        ({"n": 1}, {"seed": -1}, ValueError, "seed must be at least 0, got -1"),
        ({"n": 1}, {"seed": 1.5}, TypeError, "seed must be an integer, got 1.5"),
        (
            {"n": 1, "max_torque": 0.05}, {"seconds": 1.0, "tries": 1},
            RuntimeError, "no trajectory of 1 s was found in 1 tries",
        ),
        (
            {"n": 3, "dt": 1.0, "substeps": 1}, {"seconds": 10.0, "tries": 2},
            RuntimeError, "no trajectory of 10 s was found in 2 tries",
        ),
    ],
    ids=[
        "no such guess", "too long", "no horizon", "a negative seed", "half a seed", "a weak motor",
        "coarse steps",
    ],
)  # fmt: skip
def test_a_plan_that_is_not_found_is_an_error(env, arguments, error, message):
    with pytest.raises(error, match=message):
        planned_swing_up(EnvConfig(**env, mode="swingup"), **arguments)


@pytest.mark.parametrize(
    ("mode", "way_out"), [("balance", r"lqr\(config\) or MPC"), ("calm", "modal_damping")]
)
def test_a_swing_up_in_a_mode_that_begins_elsewhere_is_refused_with_the_way_out(mode, way_out):
    message = (
        rf'begin hanging, .* got "{mode}": {way_out}.*planned_transition\(config, 0\.0, np\.pi'
    )
    with pytest.raises(ValueError, match=message):
        planned_swing_up(EnvConfig(n=1, mode=mode))


RODS = {"masses": [1.0] * 3, "lengths": [1.0] * 3, "centres": 0.5, "inertias": 1.0 / 12.0}


@pytest.mark.long
@pytest.mark.parametrize(
    "keywords",
    [
        {"chain": Chain(**RODS)},
        {
            "chain": Chain(**RODS, base=Cart(3.0))
        },  # where no guess of the first kind leads to a plan
        {"chain": Chain([1.0], [0.8], centres=0.4, inertias=0.05, base=Cart(1.5))},
    ],
    ids=["rods", "rods on a cart", "link on a cart"],
)
def test_links_swing_up_by_a_plan_without_further_arguments(keywords):
    keywords = keywords | {"mode": "swingup"}
    plan = planned_swing_up(EnvConfig(**keywords))
    assert evaluate(plan, keywords | {"max_episode_steps": 400}, episodes=20).success_rate == 1.0


@pytest.mark.long
@pytest.mark.nightly
@pytest.mark.parametrize("mode", ["balance", "calm"])
def test_a_plan_swings_up_in_the_steps_of_any_mode_where_that_takes_longer_too(mode):
    config = EnvConfig(n=2, mode=mode)
    plan = planned_transition(config, 0.0, np.pi)
    assert len(plan.gains) * config.dt >= 6.0
    states, actions = plan.nominal
    reached = StepModel(config)(states[:-1], actions)
    np.testing.assert_allclose(reached, states[1:], atol=1e-6)
    np.testing.assert_allclose(np.cos(states[-1, :2]), -1.0)


def test_without_gravity_a_transition_is_planned_from_random_paths():
    config = EnvConfig(n=1, mode="transition", gravity=0.0, max_torque=1.0)
    plan = planned_transition(config, 0.0, np.pi, tries=2)
    np.testing.assert_allclose(np.cos(plan.nominal.states[-1, 0]), -1.0)


def test_a_plan_that_is_not_found_says_what_was_tried_and_the_limits():
    with pytest.raises(
        RuntimeError, match=r"no trajectory of 1 s .* more seconds.*limits are \[0\."
    ):
        planned_swing_up(EnvConfig(n=1, mode="swingup", max_torque=0.05), 1.0, tries=1)


def test_a_guess_that_diverges_leaves_the_others():
    states = np.array([[0.02, 0.0], [0.0, 1e6]])
    (motion,) = mpc_motions(EnvConfig(n=1, mode="swingup"), states, np.full(1, np.pi), 5)
    np.testing.assert_array_equal(motion.states[0], states[0])


def test_progress_wraps_the_iteration_over_the_guesses():
    counted = []

    def count(guesses):
        for guess in guesses:
            counted.append(guess)
            yield guess

    planned_swing_up(EnvConfig(n=1, mode="swingup"), seconds=3.0, tries=2, progress=count)
    assert counted == [0, 1]


# Friction at rest grows with speed as a damper of 0.58 N m s/rad does
RUBBING = {
    "chain": Chain.rods([0.3, 0.3], [0.3, 0.3], friction=[0.029, 0.0058]),
    "mode": "swingup", "max_torque": 2.0, "dt": 0.02,
}  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("joint", [0, 1])
def test_friction_for_feedback_predicts_a_step_from_rest_to_the_speed_of_a_swing(joint):
    config = EnvConfig(**RUBBING)
    chain, rest, idle = config.chain, np.zeros((1, 4)), np.zeros((1, 1))
    speed = 0.03 * np.sqrt(chain.gravity / 0.3)  # of a swing of 0.03 rad
    push = np.zeros((1, 4))
    push[:, 2 + joint :] = speed  # this joint alone turns
    reached, free = (
        simulate(each, *np.split(push[0], 2), [0.0, config.dt]).omega[1]
        for each in (chain, Chain.from_dict(chain.as_dict() | {"friction": 0.0}))
    )
    errors = [
        np.abs(StepModel(config, each).derivatives(rest, idle)[0][0, 2:] @ push[0] - reached).max()
        for each in (softened(config), chain)
    ]
    braked = np.abs(reached - free).max()  # by friction
    assert errors[0] < 0.3 * braked
    assert errors[1] > braked


@pytest.mark.long
def test_gains_near_the_end_of_a_plan_are_nearly_those_without_the_friction_of_its_motor():
    chain = RUBBING["chain"]
    configs = [
        EnvConfig(**RUBBING | {"chain": Chain.from_dict(chain.as_dict() | {"friction": friction})})
        for friction in (chain.friction.tolist(), 0.0)
    ]
    plan = planned_swing_up(configs[0], 3.0, tries=1)
    own, free = (track(config, plan.nominal, 0.0).gains for config in configs)
    np.testing.assert_allclose(own, free, atol=0.01 * np.abs(free).max())


class Encoders:
    """A controller that is given angles of 2048 counts, and velocities from their differences."""

    def __init__(self, controller, dt):
        self.controller, self.dt, self.last = controller, dt, None

    def __call__(self, observation, info):
        """Return the actions."""
        theta = np.rint(info["theta"] / (2 * np.pi / 2048)) * (2 * np.pi / 2048)
        omega = 0.0 * theta if self.last is None else (theta - self.last) / self.dt
        self.last = theta
        return self.controller(observation, info | {"theta": theta, "omega": omega})


ROBOT = {"chain": "realaigym C.1", "mode": "swingup", "max_torque": 6.0, "dt": 0.02}


@pytest.mark.long
@pytest.mark.parametrize(
    ("changes", "seconds"),
    [
        ({}, 3.0),
        (
            {"chain": Chain.rods([0.3] * 3, [0.3] * 3, friction=[0.029, 0.0058, 0.0058]),
             "max_torque": 3.0},
            4.0,
        ),
        ({"chain": Chain.rods([0.3] * 2, [0.3] * 2, friction=[0.0058, 0.029]), "actuated": (1,)},
         3.0),
        ({"chain": Chain.rods([0.3] * 2, [0.3] * 2, friction=[0.029, 0.0058], armature=0.002,
                              gear=[6.0, -6.0])}, 3.0),
        pytest.param(ROBOT | {"actuated": (0,)}, 3.0, marks=pytest.mark.nightly),
        (ROBOT | {"actuated": (1,)}, 3.0),
    ],
)  # fmt: skip
def test_a_plan_for_a_chain_with_dry_friction_swings_up_under_noise_of_the_torque(changes, seconds):
    keywords = RUBBING | changes
    plan = planned_swing_up(EnvConfig(**keywords), seconds)
    keywords["max_episode_steps"] = round((seconds + 8.0) / keywords["dt"])
    for noise in (0.025, 0.01, 0.005, 0.0):
        noisy = keywords | {"torque_noise": noise * keywords["max_torque"]}
        assert evaluate(plan, noisy, episodes=100).success_rate >= 0.95
    if not changes:
        sensed = Encoders(plan, keywords["dt"])
        assert evaluate(sensed, noisy, episodes=100).success_rate >= 0.95
