"""Imitation: who acts when, what the student learns from, and what experts know."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest

from npend_gym import Chain
from npend_gym.envs import EnvConfig
from npend_gym.rl import evaluate
from npend_gym.rl.controllers.planning import planned_swing_up
from npend_gym.rl.controllers.tracking import Tracking
from npend_gym.rl.evaluation.settings import setting_of

pytestmark = pytest.mark.long  # plans take seconds

torch = pytest.importorskip("torch")

from npend_gym.rl.training import experts, imitation  # noqa: E402
from npend_gym.rl.training.chain_plans import ChainPlans, wrong_chains  # noqa: E402
from npend_gym.rl.training.error_lanes import ErrorLanes  # noqa: E402
from npend_gym.rl.training.experts import (  # noqa: E402
    Replanning,
    Rescued,
    _swing_up,
    astray,
    steadied,
)
from npend_gym.rl.training.imitation_settings import ERRORS  # noqa: E402
from npend_gym.rl.training.optimizers import Muon, Spring  # noqa: E402
from npend_gym.rl.training.tasks import network  # noqa: E402

TWO = {"n": 2, "mode": "swingup", "observation": "sincos"}
CHAINS = [
    {"lengths": np.array([1.0, 1.2])},
    {"masses": np.array([0.8, 1.0])},
    {"damping": np.array([0.1, 0.0])},
]


def dagger_of(**changes):
    small = {"seconds": 3.0, "num_envs": 64, "hidden": 8, "averaging": 0.0}
    settings = imitation.settings_of("swingup-1", **small | changes)
    torch.manual_seed(0)
    config = EnvConfig(**settings.env)
    return imitation.DAgger(settings, ChainPlans(config, planned_swing_up(config, 3.0, tries=2)))


@pytest.fixture(scope="module")
def dagger():
    return dagger_of()


@pytest.fixture(scope="module")
def plans():
    config = EnvConfig(**TWO)
    found = ChainPlans(config, planned_swing_up(config, 4.0, tries=2, guess="mpc"), CHAINS)
    assert len(found.chains) == 4
    return found


def test_a_share_of_the_episodes_starts_after_a_knock_down():
    dagger = dagger_of(disturbed=0.5, num_envs=256)
    _, starts = dagger.starts(np.random.default_rng(0))
    spread = dagger.lanes.config.spread
    hangs = (np.abs(starts["theta"]) <= spread) & (np.abs(starts["omega"]) <= spread)
    assert 0.35 < hangs.mean() < 0.65
    _, info = dagger.lanes.reset(0, dagger.expert.chains, np.random.default_rng(0), starts)
    np.testing.assert_array_equal(info["theta"], starts["theta"])
    np.testing.assert_array_equal(info["omega"], starts["omega"])


def test_the_expert_takes_over_from_a_student_that_knows_nothing_but_not_everywhere(dagger):
    assert dagger.play(0) == {}
    score = dagger.play(1)
    assert score["success"] == 0.0  # where the student is alone
    assert 0.1 < score["taken_over"] < 1.0


def test_the_expert_does_not_take_over_from_a_student_that_does_as_it_would(dagger, monkeypatch):
    def as_expert(info):
        told = expert_tracking(info)
        monkeypatch.setattr(dagger, "act", lambda _: told.actions)
        return told

    expert_tracking = dagger.expert.tracking
    with monkeypatch.context() as patch:
        patch.setattr(ChainPlans, "tracking", lambda _, info: as_expert(info))
        score = dagger.play(2)
    assert score["success"] == 1.0
    assert score["taken_over"] < 0.2  # starts that are farther away than others


def test_the_student_is_the_mean_of_what_the_learner_was_lately():
    dagger = dagger_of(averaging=0.9)
    dagger.play(0)
    before = dagger.student[0].weight.clone()
    dagger.learn(20)
    left = (dagger.student[0].weight - dagger.learner[0].weight) / (
        before - dagger.learner[0].weight
    )
    assert torch.allclose(left, torch.full_like(left, 0.9**20), atol=1e-2)
    latest = dagger_of()
    latest.play(0)
    latest.learn(50)
    assert all(map(torch.equal, latest.student.parameters(), latest.learner.parameters()))


def test_muon_changes_most_directions_of_a_matrix_alike_and_adam_the_rest():
    dagger = dagger_of(muon_learning_rate=0.01, learning_rate=0.0)
    before = [each.detach().clone() for each in dagger.learner.parameters()]
    dagger.play(0)
    dagger.update()
    after = zip(before, dagger.learner.parameters(), strict=True)
    changes = [(new - old).detach() for old, new in after]
    first, second, *others = (changes[k] for k in (0, 2, 1, 3, 4, 5))
    for change in (first, second):  # Newton and Schulz's iteration is rough
        values = torch.linalg.svdvals(change)
        assert values.median() > 0.5 * values.max()
    assert not any(change.any() for change in others)  # Adam's, whose rate is 0


def test_muon_is_that_of_torch():
    strong = torch.logspace(0.0, -6.0, 9)  # weak directions are digits of bfloat16
    changed = list[list[torch.Tensor]]()
    for kind, options in ((Muon, {}), (torch.optim.Muon, {"weight_decay": 0.0})):
        drawn = torch.Generator().manual_seed(0)
        matrices = [torch.nn.Parameter(torch.zeros(shape)) for shape in ((40, 9), (9, 40), (9, 9))]
        optimizer = kind(matrices, **options)
        optimizer.param_groups[0]["lr"] = 0.01
        for _ in range(10):
            for matrix in matrices:
                left, right = (torch.randn(size, 9, generator=drawn) for size in matrix.shape)
                matrix.grad = left * strong @ right.T
            optimizer.step()
        changed.append([matrix.detach() for matrix in matrices])
    for ours, theirs in zip(*changed, strict=True):
        assert torch.linalg.norm(ours - theirs) < 0.1 * torch.linalg.norm(theirs)


def test_spring_makes_the_smallest_change_from_the_last_that_takes_all_errors_away():
    torch.manual_seed(0)
    net, start = network(3, 2, 5, last_gain=1.0), network(3, 2, 5, last_gain=1.0)
    start.load_state_dict(net.state_dict())
    spring, last = Spring(net, learning_rate=0.5), torch.zeros(count_of(net), dtype=torch.float64)
    for _ in range(3):
        inputs, weights = torch.randn(4, 3), 0.5 + torch.rand(4, 2)
        targets = start(inputs).detach() + 0.05 * torch.rand(4, 2)
        before = torch.nn.utils.parameters_to_vector(net.parameters()).detach().double()
        root = (weights.sqrt() / weights.sqrt().mean()).flatten().double()
        jacobian = root[:, None] * jacobian_of(net, inputs)
        outputs = net(inputs).detach()
        errors = root * (targets - outputs).flatten()
        assert errors.abs().max() < 0.1  # larger ones are limited
        kernel = jacobian @ jacobian.T
        kernel += 1e-4 * kernel.diagonal().mean() * torch.eye(8)
        left = torch.linalg.solve(kernel, errors - 0.97 * jacobian @ last)
        last = 0.97 * last + jacobian.T @ left
        assert torch.equal(spring.step(inputs, targets, weights, share=0.4), outputs)
        after = torch.nn.utils.parameters_to_vector(net.parameters()).detach().double()
        assert torch.allclose(after - before, 0.2 * last, atol=3e-4 * float(last.abs().max()))
        start.load_state_dict(net.state_dict())


def count_of(net):
    return sum(each.numel() for each in net.parameters())


def jacobian_of(net, inputs):
    """Return the derivatives of all outputs by all parameters, from automatic differentiation."""
    rows, parameters = list[torch.Tensor](), [*net.parameters()]
    for value in net(inputs).flatten():
        gradients = torch.autograd.grad(value, parameters, retain_graph=True)
        rows.append(torch.cat([each.flatten() for each in gradients]))
    return torch.stack(rows).double()


def test_spring_learns_what_an_expert_does_to_less_than_half_the_distance_of_adam():
    distances = {}
    for rate in (0.0, 0.5):
        dagger = dagger_of(spring_learning_rate=rate, hidden=32, minibatch_size=256, rounds=2)
        dagger.play(0)
        dagger.learn(1200)
        distances[rate] = dagger.distance
    assert distances[0.5] < 0.5 * distances[0.0]


def test_spring_learns_from_states_that_are_alike_and_says_where_the_network_diverged():
    torch.manual_seed(0)
    net = network(3, 1, 8, last_gain=1.0)
    spring, inputs = Spring(net, learning_rate=0.5), torch.ones(3000, 3)
    targets, weights = torch.full((3000, 1), 0.05) + net(inputs[:1]).detach(), torch.ones(3000, 1)
    spring.step(inputs, targets, weights, share=1.0)
    assert (net(inputs) - targets).abs().max() < 0.03
    with pytest.raises(RuntimeError, match="spring_learning_rate must be smaller"):
        spring.step(inputs * torch.nan, targets, weights, share=1.0)


@pytest.mark.parametrize("length", [1, 4])
def test_the_policy_acts_as_the_student_does(length):
    dagger = dagger_of(length=length)
    dagger.play(0)
    dagger.learn(20)
    policy = dagger.policy({})
    assert policy.has_memory == (length > 1)
    envs = setting_of(policy.env).make(5)
    observation, info = envs.reset(seed=0)
    dagger.history.reset(5)
    for _ in range(8):
        action = policy(observation, info)
        expected = dagger.act(dagger.inputs(observation, info)).clip(-1.0, 1.0)
        np.testing.assert_allclose(action, expected, atol=1e-4)
        dagger.history.act(action)
        observation, *_, info = envs.step(action)


@pytest.mark.nightly
@pytest.mark.parametrize(
    "env",
    [{"mode": "calm", "n": 2}, {"mode": "balance", "base": "cart"}],
    ids=lambda env: " ".join(map(str, env.values())),
)
def test_a_student_learns_from_a_regulator_where_no_plan_is_needed(env):
    env = env | {"observation": "sincos"}
    settings = imitation.Settings(env=env, rounds=3, num_envs=64, seconds=4.0, standing=100)
    policy, curve = imitation.train(settings)
    assert curve[-1]["success"] == 1.0
    assert evaluate(policy, env, episodes=20).success_rate == 1.0


def test_the_curve_tells_the_first_of_several_episodes_as_evaluate_does():
    quick = {"rounds": 2, "num_envs": 64, "updates": 5, "first_updates": 10, "guesses": 1}
    policy, curve = imitation.train(imitation.settings_of("balance-1", learning_rate=1e-4, **quick))
    judged = evaluate(policy, policy.env | {"max_episode_steps": 345}, episodes=32)
    assert judged.success_rate == curve[-1]["success"] == 0.0
    assert judged.returns.mean() == pytest.approx(curve[-1]["return"], rel=0.2)


def test_an_expert_that_loses_every_chain_is_an_error(monkeypatch):
    dagger = dagger_of()
    own = dagger.expert.tracking

    def reversed_(info):
        tracking = own(info)
        return tracking._replace(actions=-tracking.actions)

    monkeypatch.setattr(dagger.expert, "tracking", reversed_)
    with pytest.raises(RuntimeError, match="the expert must follow its own plan, but loses"):
        dagger.play(0)


@pytest.mark.parametrize("changes", [{"kept": 1e-9}, {"lost": 1e-30}])
def test_a_round_of_which_nothing_is_kept_is_refused_by_the_settings_that_keep(changes):
    settings = imitation.settings_of("balance-1", rounds=2, num_envs=4, guesses=1, **changes)
    with pytest.raises(ValueError, match="kept, lost and num_envs must be larger"):
        imitation.train(settings)
    with pytest.raises(ValueError, match="lost must be"):
        imitation.train(dataclasses.replace(settings, lost=0.0))


@pytest.mark.nightly
def test_a_student_with_a_memory_swings_one_rod_up_with_late_sensors():
    settings = imitation.settings_of(
        "swingup-1-robust", seconds=3.0, rounds=12, num_envs=96, hidden=32, updates=200
    )
    policy, curve = imitation.train(settings)
    assert policy.has_memory
    assert policy.env == {"n": 1, "mode": "swingup", "observation": "sincos"}
    assert curve[-1]["success"] > curve[0]["success"]
    assert evaluate(policy, policy.env, episodes=20).success_rate > 0.9
    late = evaluate(policy, policy.env | {"observation_delay": 0.8}, episodes=20)
    assert late.success_rate > 0.5


def test_the_plan_of_a_chain_is_a_motion_of_this_very_chain(plans):
    for which, changes in enumerate(plans.chains):
        chain = Chain(**changes)
        limit = EnvConfig(**TWO).max_torque
        envs = gym.make_vec(
            "NPendulum-v0", num_envs=1, chain=chain, mode="swingup", max_torque=limit
        )
        _, info = envs.reset(options={"theta": 0.0, "omega": 0.0})
        plans.begin(np.array([which]))
        for _ in range(plans.steps):
            told = plans.tracking(info)
            assert told.relative_cost[0] < 1e-3
            info = envs.step(told.actions)[-1]
        assert info["tip_height"][0] > 0.999 * chain.total_length
        envs.close()


def test_what_is_left_of_a_plan_begins_near_the_state_and_ends_at_the_goal(plans):
    plans.begin(np.array([0, 1, 0]))
    turned = np.array([[2.0 * np.pi, 0.0, 0.0, 0.0], [0.0, -2.0 * np.pi, 0.0, 0.0]])
    states, actions, gains = plans.rest(turned, np.array([1, 2]), plans.steps + 10)
    assert actions.shape == (plans.steps + 10, 2, 1)
    np.testing.assert_allclose(states[0], turned, atol=1e-9)
    np.testing.assert_allclose(np.cos(states[-1, :, :2]), -1.0, atol=1e-9)
    assert (actions[plans.steps :] == 0.0).all()  # the goal is held by feedback
    assert (gains[plans.steps :] == gains[-1]).all()


def test_a_chain_that_its_plan_has_lost_stands_up_where_it_is_planned_again():
    config = EnvConfig(**TWO)
    plans = ChainPlans(config, planned_swing_up(config, 4.0, tries=1, guess="mpc"))
    expert = Rescued(plans, Replanning(config, plans), lost=100.0)
    envs = gym.make_vec("NPendulum-v0", num_envs=4, **TWO)
    kicks = np.linspace(2.0, 3.0, 4)[:, None] * [1.0, -1.0]  # rad/s
    success = []
    for round_ in (3, 4):  # in one of four it helps
        _, info = envs.reset(seed=0, options={"theta": np.full((4, 2), np.pi), "omega": kicks})
        expert.begin(np.zeros(4, np.int64), round_)
        for _ in range(200):
            tracking = expert.tracking(info)
            assert round_ == 3 or (tracking.relative_cost < 100.0).all()
            info = envs.step(np.clip(tracking.actions, -1.0, 1.0))[-1]
        success.append(info["success"].sum())
    envs.close()
    assert success[0] == 0
    assert success[1] == 4


SHARES = {"nothing": 1.0, "model": 2.0, "velocity_noise": 1.0, "delay": 1.0, "pushes": 1.0}


def test_wrong_chains_come_in_the_same_order_in_every_process():
    first_rod = [next(iter(changes)) for changes in wrong_chains(Chain.uniform(2), 0, 4)[:20]]
    assert first_rod == 8 * ["masses"] + 8 * ["lengths"] + 4 * ["damping"]


def test_lanes_with_wrong_chains_move_as_these_chains_do(plans):
    lanes = ErrorLanes(setting_of(TWO), 12, SHARES, 100)
    rng = np.random.default_rng(0)
    _, info = lanes.reset(7, plans.chains, rng)
    wrong = np.flatnonzero(lanes.group == lanes.names.index("model"))
    assert wrong.size == 4
    assert not lanes.which[np.setdiff1d(np.arange(12), wrong)].any()
    begun = {name: info[name].copy() for name in ("theta", "omega")}
    action = rng.uniform(-1.0, 1.0, (20, 12, 1))
    for each in action:
        observation, _, _, info = lanes.step(each)
    lanes.close()
    limit = EnvConfig(**TWO).max_torque
    for lane in wrong:
        chain = Chain(**plans.chains[lanes.which[lane]])
        env = gym.make("NPendulum-v0", **TWO | {"chain": chain, "max_torque": limit})
        env.reset(options={name: value[lane] for name, value in begun.items()})
        for each in action:
            alone, *_ = env.step(each[lane])
        env.close()
        np.testing.assert_allclose(observation[lane], alone, atol=1e-6)


def test_errors_are_drawn_up_to_what_robustness_tries_times_their_level():
    lanes = ErrorLanes(setting_of(TWO), 12, SHARES, 100, first_level=0.5)
    drawn = dict(zip(lanes.names, lanes.lanes.envs, strict=True))
    ends = {name: drawn[name].unwrapped.config.randomize for name in ("velocity_noise", "delay")}
    assert ends["velocity_noise"] == {"velocity_noise": {"low": 0.0, "high": 0.25}}
    assert ends["delay"]["observation_delay"]["high"] == pytest.approx(0.4)  # of 0.04 s
    assert drawn["nothing"].unwrapped.config.randomize is None
    lanes.close()


@pytest.mark.parametrize(
    ("errors", "told"),
    [
        ({"delay": "a"}, r"errors\['delay'\] must be a real number, got 'a'"),
        ({"delay": -1.0}, r"errors\['delay'\] must be zero or more, got -1.0"),
        ({"noise": 1.0}, "errors must be one of nothing, .*got 'noise'"),
        ([], r"errors must be a dict, got \[\]"),
    ],
)
def test_shares_of_errors_are_checked_before_anything_is_planned(errors, told, monkeypatch):
    monkeypatch.delattr(imitation, "begin")
    with pytest.raises((TypeError, ValueError), match=told):
        imitation.train(imitation.settings_of("swingup-1", errors=errors))


def test_pulses_push_a_chain_that_hangs_and_nothing_else_does():
    lanes = ErrorLanes(setting_of(TWO), 30, {"nothing": 1.0, "pushes": 2.0}, 100)
    lanes.reset(0, [], np.random.default_rng(0))
    for _ in range(100):
        *_, info = lanes.step(np.zeros((30, 1)))
    pushed = lanes.group == 1
    moved = np.abs(info["theta"]).max(axis=1) > 0.2  # starts within 0.05 rad and 0.05 rad/s
    assert moved[pushed].mean() > 0.5
    assert not moved[~pushed].any()
    lanes.close()


@pytest.mark.parametrize(
    "ends", [{"low": 4.99, "high": 5.01}, {"low": [4.99], "high": [5.01]}, (0.998, 1.002)]
)
def test_motors_whose_limit_is_drawn_have_all_of_it_where_pulses_push(ends):
    setting = setting_of({"n": 1, "max_torque": 5.0, "randomize": {"max_torque": ends}})
    lanes = ErrorLanes(setting, 2, {"pushes": 1.0}, 50)
    lanes.levels[:] = 0.0
    lanes.reset(0, [], np.random.default_rng(0))
    *_, info = lanes.step(np.ones((2, 1)))
    np.testing.assert_allclose(info["torque"], 5.0, rtol=0.003)
    lanes.close()


def test_an_episode_after_one_that_left_its_rail_is_between_the_same_equilibria():
    cart = {"mode": "transition", "base": "cart", "rail": 0.3, "observation": "sincos"}
    lanes = ErrorLanes(setting_of(cart | {"n": 2}), 16, {"nothing": 1.0}, 100)
    goal, ended = np.pi * (np.arange(32).reshape(16, 2) % 3 == 0), np.zeros(16, bool)
    starts = {"start": np.pi - goal, "goal": goal}
    lanes.reset(0, [], np.random.default_rng(0), starts)
    for _ in range(100):
        _, _, terminated, info = lanes.step(np.ones((16, 1)))
        ended |= terminated
        np.testing.assert_array_equal(info["goal"], goal)
    assert ended.all()
    lanes.close()


def test_errors_grow_with_which_more_than_half_of_the_episodes_were_good():
    lanes = ErrorLanes(setting_of(TWO), 48, dict.fromkeys(SHARES, 1.0), 100, first_level=0.4)
    noise, delay, pushes = (lanes.names.index(k) for k in ("velocity_noise", "delay", "pushes"))
    rows = np.flatnonzero(np.isin(lanes.group, [noise, delay, pushes]))
    kept = rows[(lanes.group[rows] != pushes) | (lanes.rank[rows] < 0.5)]
    group, rank = lanes.group[kept], lanes.rank[kept]
    good = (group == pushes) | ((group == noise) & (rank < 0.8))
    episodes = np.bincount(group)
    for _ in range(2):
        lanes.judge(kept, good)
    assert episodes[noise] < 12 <= 2 * episodes[noise]
    assert 2 * episodes[pushes] < 12
    lanes.grow()
    np.testing.assert_allclose(lanes.levels[[noise, delay, pushes]], [0.5, 0.4, 0.4])
    high = lanes.lanes.envs[noise].unwrapped.config.randomize["velocity_noise"]["high"]
    assert high == pytest.approx(0.25)
    lanes.close()


def test_errors_grow_beyond_the_largest_of_the_criteria_by_a_margin():
    lanes = ErrorLanes(setting_of(TWO), 24, {"nothing": 1.0, "delay": 1.0}, 100, 0.9, margin=0.2)
    for _ in range(3):
        lanes.judge(np.arange(24), np.ones(24, np.bool_))
        lanes.grow()
    np.testing.assert_allclose(lanes.levels, [1.0, 1.2])
    delayed = lanes.lanes.envs[1].unwrapped.config.randomize["observation_delay"]
    assert delayed["high"] == pytest.approx(1.2 * 0.8)  # of 0.04 s, in steps
    lanes.close()


def test_motors_with_a_lag_are_given_actions_whose_mean_is_that_of_the_expert():
    lanes = ErrorLanes(setting_of(TWO), 12, {"motor_lag": 1.0, "nothing": 1.0}, 100)
    rng, nominal = np.random.default_rng(0), {"masses": np.ones(2)}
    lanes.reset(0, [nominal], rng)
    for _ in range(10):
        wanted = rng.uniform(-0.3, 0.3, (12, 1))
        saying = Tracking(wanted, np.zeros((12, 4)), np.ones(12), np.ones(12))
        given = lanes.against_lag(saying).actions
        *_, info = lanes.step(given)
        np.testing.assert_allclose(info["torque"] / lanes.config.max_torque, wanted)
    assert np.all(given[6:] == wanted[6:])
    assert np.all(given[:6] != wanted[:6])
    lanes.close()


def test_of_several_tries_the_least_sensitive_trajectory_is_the_plan():
    found = []
    for tries in (1, 3):
        settings = imitation.settings_of("swingup-2", tries=tries)
        found.append(_swing_up(settings, EnvConfig(**settings.env), 0).sensitivity)
    assert found[1] < 0.9 * found[0]


def test_of_the_variants_of_a_plan_one_is_kept_from_which_noise_leads_less_astray():
    config = EnvConfig(n=3, mode="swingup")
    plan = planned_swing_up(config, 4.5, tries=1, seed=1)
    assert steadied(config, plan, 0, 0, 0.1) is plan
    better = steadied(config, plan, 12, 0, 0.1)
    assert astray(config, better, 0.1) < astray(config, plan, 0.1)
    assert astray(config, plan, 0.02) < astray(config, plan, 0.1)
    again = steadied(config, plan, 12, 0, 0.1)
    np.testing.assert_array_equal(better.gains, again.gains)
    goal = np.cos(better.nominal.states[-1, :3])
    np.testing.assert_allclose(goal, -1.0)
    assert np.abs(better.nominal.actions).max() < 0.9


def test_of_the_variants_of_a_plan_one_is_kept_that_leads_wrong_chains_less_astray():
    config = EnvConfig(n=2, mode="swingup")
    plan = planned_swing_up(config, 3.0, tries=1, seed=1)
    lengths, far = np.ones((16, 2)), []
    lengths[:8, 0] = lengths[8:, 1] = np.linspace(0.95, 1.05, 8)
    for each in (steadied(config, plan, 20, 0, 0.1, weight) for weight in (0.0, 1.0)):
        envs = setting_of({"n": 2, "mode": "swingup"}).make(16)
        _, info = envs.reset(seed=0, options={"lengths": lengths})
        plans, cost = ChainPlans(config, each), np.zeros(16)
        plans.begin(np.zeros(16, np.int64))
        for _ in range(plans.steps):
            tracking = plans.tracking(info)
            cost = np.maximum(cost, tracking.relative_cost)
            *_, info = envs.step(tracking.actions)
        far.append(np.log(cost).mean())
    assert far[1] < far[0] - 0.1


def test_lags_of_motors_count_where_variants_of_a_plan_are_compared(monkeypatch):
    config = EnvConfig(n=2, mode="swingup")
    plan = planned_swing_up(config, 3.0, tries=1, seed=1)
    whole = astray(config, plan, 0.0, 1.0)
    monkeypatch.setattr(experts, "_LAGGING", 0.0)
    without = astray(config, plan, 0.0, 1.0)
    envs = setting_of(TWO).make(32, randomize={"motor_lag": {"low": 0.0, "high": 0.02}})
    _, info = envs.reset(seed=256 + 2 * 25)  # after lanes with noise, and two for each chain
    names = envs.unwrapped.config.context_names
    rate = config.dt / info["context"][:, [names.index("motor_lag")]]
    share = -np.expm1(-rate) / rate
    plans, cost, followed = ChainPlans(config, plan), np.zeros(32), np.zeros((32, 1))
    plans.begin(np.zeros(32, np.int64))
    for _ in range(plans.steps + 10):
        tracking = plans.tracking(info)
        cost = np.maximum(cost, tracking.relative_cost)
        asked = ((tracking.actions - share * followed) / (1.0 - share)).clip(-1.0, 1.0)
        followed = asked + np.exp(-rate) * (followed - asked)
        *_, info = envs.step(asked)
    assert cost.max() < 300.0
    assert whole - without == pytest.approx(np.log(cost).mean(), abs=1e-9)


def test_what_is_wrong_follows_from_the_task():
    three = imitation.settings_of("swingup-3-robust")
    assert "randomize" not in three.env
    assert not three.env["observe_velocities"]
    assert three.errors["delay"] > 0.0
    assert imitation.settings_of("swingup-3").errors == {}
    assert imitation.settings_of("balance-2-robust").errors == ERRORS
    with pytest.raises(ValueError, match='rescuer must be left out in mode "transition"'):
        imitation.train(imitation.settings_of("transition-2", rescuer="mpc"))


@pytest.mark.parametrize(
    ("task", "rescuer"),
    [
        ("swingup-1", "no.safetensors"), ("swingup-1", "swingup-2"), ("swingup-2", "transition-2"),
        ("swingup-2", "swingup-2-acrobot"), ("swingup-2", "swingup-2-cart"),
        ("swingup-2", "swingup-2-robust"),
    ],
)  # fmt: skip
def test_a_rescuer_that_does_not_fit_is_refused_before_anything_is_planned(
    task, rescuer, monkeypatch
):
    monkeypatch.delattr(imitation, "begin")
    with pytest.raises(ValueError, match=r"(rescuer|policy) must be a") as refused:
        imitation.train(imitation.settings_of(task, rescuer=rescuer))
    assert ("--set rescuer=" in str(refused.value)) == (rescuer != "no.safetensors")
    for fitting in ("swingup-2-robust", "swingup-2-acrobot-robust", "swingup-2-pendubot-robust"):
        with pytest.raises(NameError):
            imitation.train(imitation.settings_of(fitting))
    with pytest.raises(ValueError, match="disturbed must be 0 without a rescuer"):
        imitation.train(imitation.settings_of("swingup-2", disturbed=0.5))
    for name in ("student_fraction", "kept"):
        with pytest.raises(ValueError, match=f"{name} must be"):
            imitation.train(imitation.settings_of("swingup-1", **{name: 0.0}))
    with pytest.raises(ValueError, match="observe_context must be False"):
        imitation.train(
            imitation.settings_of("swingup-1-robust", env=TWO | {"observe_context": True})
        )
