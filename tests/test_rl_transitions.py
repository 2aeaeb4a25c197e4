"""Planned transitions between equilibria: one pair, and a controller for all of them."""

import json
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from test_rl_planning import check_motion

from npend_gym import _progress
from npend_gym.envs import EnvConfig
from npend_gym.rl import (
    PlannedTransitions,
    evaluate,
    lqr,
    planned_transition,
    planned_transitions,
)
from npend_gym.rl.controllers import transitions
from npend_gym.rl.controllers.regulators import state_weights
from npend_gym.rl.controllers.step_model import StepModel

pytestmark = pytest.mark.long  # plans take seconds

FOLDED, UNFOLDED = np.array([np.pi, 0.0]), np.array([0.0, np.pi])
ONE_ROD = {"n": 1, "mode": "transition"}


@pytest.fixture(scope="module")
def pair():
    return planned_transition(EnvConfig(n=2, mode="transition"), FOLDED, UNFOLDED, 4.0, tries=1)


@pytest.fixture(scope="module")
def both():
    return planned_transitions(EnvConfig(**ONE_ROD), 3.0, tries=1)


def test_a_plan_leads_from_one_equilibrium_to_the_other_by_the_equations_of_motion(pair):
    states, _ = pair.nominal
    np.testing.assert_array_equal(states[0], [np.pi, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(np.cos(states[-1, :2]), [1.0, -1.0])
    np.testing.assert_array_equal(states[-1, 2:], 0.0)
    check_motion(EnvConfig(n=2, mode="transition"), pair.nominal)


def test_a_chain_that_stands_folded_is_led_to_the_other_fold(pair):
    envs = gym.make_vec("NPendulum-v0", num_envs=20, n=2, mode="transition", max_episode_steps=220)
    ends = {"start": np.tile(FOLDED, (20, 1)), "goal": np.tile(UNFOLDED, (20, 1))}
    info = envs.reset(seed=0, options=ends)[1]
    for _ in range(220):
        info = envs.step(pair(None, info))[4]
    assert info["success"].mean() > 0.9


def test_the_cost_of_deviations_is_what_tracking_them_costs(pair):
    config = EnvConfig(n=2, mode="transition")
    states, actions = pair.nominal
    model, weights = StepModel(config), state_weights(config)

    def cost_of(deviation, wrong, first):
        """Sum what the deviation costs that the steps themselves make of it."""
        x, total = deviation, 0.0
        for k in range(first, len(actions)):
            change = -pair.gains[k] @ x + (wrong if k == first else 0.0)
            total += x @ weights @ x + change @ change
            x = model((states[k] + x)[None], (actions[k] + change)[None])[0] - states[k + 1]
        return total + x @ pair.costs[-1] @ x

    for first in (0, 30, 60):
        x = 1e-4 * np.random.default_rng(first).normal(size=4)
        expected = x @ pair.costs[first] @ x
        assert cost_of(x, 0.0, first) == pytest.approx(expected, rel=1e-2)
        at_rest = np.zeros(4)
        assert cost_of(at_rest, 1e-4, first) == pytest.approx(
            1e-8 * pair.action_weights[first, 0], rel=1e-2
        )


def test_every_environment_is_led_from_its_own_start_to_its_own_goal(both):
    assert set(both.plans) == {((False,), (True,)), ((True,), (False,))}
    evaluation = evaluate(both, ONE_ROD | {"max_episode_steps": 200}, episodes=40)
    assert evaluation.success_rate == 1.0


def test_a_single_environment_is_led_as_one_of_many(both):
    env = gym.make("NPendulum-v0", **ONE_ROD)
    envs = gym.make_vec("NPendulum-v0", 1, **ONE_ROD)
    info, infos, one, many = env.reset(seed=4)[1], envs.reset(seed=4)[1], [], []
    for _ in range(3):
        one.append(both(None, info))
        info = env.step(one[-1])[-1]
    both.reset()
    for _ in range(3):
        many.append(both(None, infos)[0])
        infos = envs.step(many[-1][None])[-1]
    np.testing.assert_array_equal(one, many)


@pytest.fixture
def begun(both):
    """The infos of two environments at rest, the same two in the other order, the first actions."""
    goal, omega = np.array([[np.pi], [0.0]]), np.zeros((2, 1))
    info = {"theta": np.pi - goal + 0.01, "omega": omega, "time": np.zeros(2), "goal": goal}
    both.reset()
    return info, {name: value[::-1] for name, value in info.items()}, both(None, info)


def test_episodes_begin_anew_where_time_goes_back(both, begun):
    info, swapped, first = begun
    both(None, info | {"time": np.full(2, 0.05)})
    np.testing.assert_array_equal(both(None, swapped), first[::-1])


def test_an_episode_that_was_only_looked_at_leaves_nothing_behind(both, begun):
    info, swapped, first = begun
    np.testing.assert_array_equal(both(None, swapped), first[::-1])
    both(None, info | {"time": np.full(2, 0.05)})  # and a goal that changes begins an episode
    late = swapped | {"time": np.full(2, 0.1)}
    again = both(None, late)
    both.reset()
    np.testing.assert_array_equal(again, both(None, late))


def test_the_expert_of_goals_goes_by_the_state_and_not_by_the_clock(both):
    from npend_gym.rl.training.chain_plans import PlanTracker

    config = EnvConfig(**ONE_ROD)
    expert = PlanTracker(config, list(both.plans.values()), pairs=list(both.plans))
    hangs = {"theta": np.zeros((3, 1)), "omega": np.zeros((3, 1)), "goal": np.full((3, 1), np.pi)}
    expert.begin(np.zeros(3, np.int64))
    expert.tracking(hangs | {"time": np.zeros(3)})
    states, actions = both.plans[(False,), (True,)].nominal
    for k in range(1, 30):  # twice as late as the plan
        late = {"theta": np.tile(states[k, :1], (3, 1)), "omega": np.tile(states[k, 1:], (3, 1))}
        said = expert.tracking(late | {"time": np.full(3, 2 * k * config.dt)})
        np.testing.assert_allclose(said.actions, np.tile(actions[k], (3, 1)), atol=1e-6)
        assert said.relative_cost.max() < 1e-9


def test_the_expert_of_goals_takes_the_other_kind_of_guess_where_one_leads_nowhere(
    monkeypatch, capsys
):
    imitation = pytest.importorskip("npend_gym.rl.training.imitation")
    from npend_gym.rl.training import experts

    settings = imitation.settings_of("transition-1", seconds=3.0, guesses=2, plan_guess="waves")
    config, asked = EnvConfig(**settings.env), []

    def by_mpc_alone(*pair, guess, **options):
        asked.append(guess)
        if guess == "waves":
            raise RuntimeError("no guess led to a trajectory")
        return planned_transition(*pair, guess=guess, **options)

    monkeypatch.setattr(experts, "planned_transition", by_mpc_alone)
    monkeypatch.setattr(_progress, "SECONDS", 0.0)
    expert = experts.expert_of(settings, config, 0, "planning")
    assert asked == ["waves", "waves", "mpc"] * 2
    assert "planning: 1 of 2 pairs" in capsys.readouterr().err
    again = experts.expert_of(settings, config, 0, kept=expert.trajectories)
    assert len(asked) == 6
    for ours, theirs in zip(again.trajectories, expert.trajectories, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_variants_of_a_plan_between_equilibria_lead_less_astray():
    imitation = pytest.importorskip("npend_gym.rl.training.imitation")
    from npend_gym.rl.training import experts

    found = []
    for variants in (0, 12):
        settings = imitation.settings_of("transition-1", seconds=3.0, guesses=1, variants=variants)
        config = EnvConfig(**settings.env)
        plan = experts._transition(settings, config, ((0,), (1,)))
        found.append(experts.astray(config, plan, settings.noise_std))
    assert found[1] < found[0]


def test_pairs_of_which_a_student_failed_are_played_more_often(both):
    imitation = pytest.importorskip("npend_gym.rl.training.imitation")
    from npend_gym.rl.training.chain_plans import PlanTracker

    small = {"seconds": 3.0, "num_envs": 400, "hidden": 8}
    settings = imitation.settings_of("transition-1", **small)
    plans, pairs = list(both.plans.values()), list(both.plans)
    dagger = imitation.DAgger(settings, PlanTracker(EnvConfig(**ONE_ROD), plans, pairs=pairs))
    up = list(both.plans).index(((False,), (True,)))
    everyone = np.zeros(40, np.int64)
    dagger.count(everyone + up, everyone > 0)  # all failed
    dagger.count(everyone + 1 - up, everyone == 0)  # all were good
    drawn, starts = dagger.starts(np.random.default_rng(0))
    assert 0.8 < np.mean(drawn == up) < 0.9  # 0.3 of the lanes are drawn alike
    info = dagger.lanes.reset(0, [], np.random.default_rng(0), starts)[1]
    np.testing.assert_array_equal(info["goal"][:, 0] > 1.0, drawn == up)
    np.testing.assert_allclose(np.cos(info["theta"]), -np.cos(info["goal"]), atol=0.02)
    dagger.lanes.close()


@pytest.mark.parametrize("layers", [2, 3, 4])
@pytest.mark.parametrize(
    ("slope", "apart", "merged"),
    [(1.0, 1e-5, 1e-4), (1000.0, 2e-4, 2e-4)],  # units that begin as feedback are as steep
)
def test_of_networks_for_each_goal_that_of_the_goal_acts_also_when_they_are_merged(
    layers, slope, apart, merged
):
    torch = pytest.importorskip("torch")
    from npend_gym.rl.training.goal_networks import GoalNetworks
    from npend_gym.rl.training.tasks import network

    torch.manual_seed(0)
    networks = [network(12, 2, 16, last_gain=1.0, layers=layers) for _ in range(8)]
    for parameter in (each for one in networks for each in one.parameters()):
        parameter.data += 0.3 * torch.randn_like(parameter)
    for one in networks:
        one[0].weight.data[:4] *= slope
    together = GoalNetworks(networks)
    inputs = 3.0 * torch.randn(400, 12)
    inputs[:, -3:] = inputs[:, -3:].sign()
    stands = [tuple((row < 0.0).tolist()) for row in inputs[:, -3:]]
    of_goal = {goal: together.networks[sum(2**i for i in range(3) if goal[i])] for goal in stands}
    expected = torch.stack([of_goal[goal](row) for goal, row in zip(stands, inputs, strict=True)])
    assert len(of_goal) == 8
    torch.testing.assert_close(together(inputs), expected, atol=apart, rtol=1.3e-6)
    torch.testing.assert_close(together.merged()(inputs), expected, atol=merged, rtol=0.0)


@pytest.mark.nightly
def test_a_network_for_each_goal_is_trained_and_becomes_one_policy():
    imitation = pytest.importorskip("npend_gym.rl.training.imitation")
    small = {"seconds": 3.0, "guesses": 1, "num_envs": 128, "hidden": 24, "rounds": 8}
    settings = imitation.settings_of("transition-1", by_goal=True, **small)
    policy, _ = imitation.train(settings)
    assert [weight.shape for weight in policy.weights] == [(50, 4), (50, 50), (1, 50)]
    assert evaluate(policy, policy.env, episodes=40).success_rate > 0.8
    with pytest.raises(ValueError, match="by_goal must be False in a mode without goals"):
        imitation.train(imitation.settings_of("swingup-1", by_goal=True))
    seen = {"observe_context": True, "randomize": {"lengths": [0.9, 1.1]}}
    with pytest.raises(ValueError, match=r"by_goal must be False .* observe_context=True"):
        imitation.train(replace(settings, env=settings.env | seen))
    with pytest.raises(ValueError, match=r"spring_learning_rate must be 0 with by_goal, got 0\.5"):
        imitation.train(replace(settings, spring_learning_rate=0.5))
    with pytest.raises(TypeError, match="by_goal must be True or False, got 'yes'"):
        imitation.train(imitation.settings_of("transition-1", by_goal="yes"))


def test_rods_may_have_turned_before_an_episode_begins(both, begun):
    info, _, expected = begun
    turned = info | {"theta": info["theta"] + 2.0 * np.pi * np.array([[3.0], [-2.0]])}
    both.reset()
    np.testing.assert_allclose(both(None, turned), expected, atol=1e-12)


def test_plans_that_were_saved_give_the_same_actions(both, tmp_path):
    made = PlannedTransitions(both.plans, both.arguments | {"seed": np.int64(0)})
    made.save(tmp_path / "plans.npz")
    assert [file.name for file in tmp_path.iterdir()] == ["plans.npz"]
    with np.load(tmp_path / "plans.npz") as file:
        made_with = json.loads(str(file["about"]))["arguments"]
    assert (made_with["tries"], made_with["env"]) == (1, ONE_ROD)
    again = PlannedTransitions.load(tmp_path / "plans.npz", EnvConfig(**ONE_ROD))
    assert again.arguments == both.arguments
    rng = np.random.default_rng(0)
    info = {"theta": rng.normal(0.0, 0.3, (6, 1)), "omega": rng.normal(0.0, 0.3, (6, 1))}
    info |= {"goal": np.full((6, 1), np.pi), "time": np.linspace(0.0, 4.0, 6)}
    both.reset()
    np.testing.assert_array_equal(again(None, info), both(None, info))


def test_plans_that_are_too_large_to_be_read_again_are_not_written(both, tmp_path, monkeypatch):
    both.save(tmp_path / "plans.npz")
    with np.load(tmp_path / "plans.npz") as file:
        size = sum(file[name].nbytes for name in file)
    (tmp_path / "plans.npz").unlink()
    monkeypatch.setattr(transitions, "MAX_BYTES", size)
    with pytest.raises(ValueError, match=f"must take at most {size} bytes, got .* several files"):
        both.save(tmp_path / "plans.npz")
    assert not list(tmp_path.iterdir())


def test_files_that_hold_no_plans_for_the_environment_are_refused(both, tmp_path):
    path = tmp_path / "plans.npz"
    both.save(path)
    with pytest.raises(ValueError, match="plans of another environment: a step misses"):
        PlannedTransitions.load(path, EnvConfig(**ONE_ROD, damping=0.1))
    with pytest.raises(ValueError, match="no plans for 2 rods and 1 motors"):
        PlannedTransitions.load(path, EnvConfig(n=2, mode="transition"))
    with pytest.raises(TypeError, match="config must be the settings"):
        PlannedTransitions.load(path, "x")
    with np.load(path) as file:
        arrays = dict(file)
    for name, wrong, message in (
        ("actions", arrays["actions"] + 2.0, r"actions must lie within \+-1"),
        ("states", arrays["states"] + 1e-3, "do not lead where they say"),
        ("states", arrays["states"][:, :, :1], "no plans for 1 rods"),
    ):
        np.savez(path, **(arrays | {name: wrong}))
        with pytest.raises(ValueError, match=message):
            PlannedTransitions.load(path, EnvConfig(**ONE_ROD))
    np.savez(path, states=np.zeros(3))
    with pytest.raises(ValueError, match="holds no plans"):
        PlannedTransitions.load(path, EnvConfig(**ONE_ROD))


def test_what_are_no_plans_for_one_file_is_refused(both, tmp_path):
    pair, plan = next(iter(both.plans.items()))
    for wrong in ({}, {pair: 5}):
        with pytest.raises(TypeError, match="plans must be PlannedTransitions, got"):
            PlannedTransitions(wrong)
    shorter = PlannedTransitions(both.plans | {pair: replace(plan, gains=plan.gains[:9])})
    with pytest.raises(ValueError, match=r"seconds must be the same .* plans of 9, 60 steps"):
        shorter.save(tmp_path / "plans.npz")


def test_the_regulator_holds_a_chain_whose_rods_hang_and_stand():
    envs = gym.make_vec("NPendulum-v0", num_envs=10, n=2, mode="transition", max_episode_steps=200)
    hold = lqr(envs.unwrapped.config, UNFOLDED)
    near = np.random.default_rng(0).uniform(-0.02, 0.02, (10, 2))
    info = envs.reset(seed=0, options={"theta": UNFOLDED + near, "omega": 0.0})[1]
    for _ in range(200):
        info = envs.step(hold(None, info))[4]
    np.testing.assert_allclose(info["theta"], np.tile(UNFOLDED, (10, 1)), atol=1e-3)


@pytest.mark.parametrize(
    ("start", "goal", "message"),
    [
        (0.0, 0.0, "goal must be another equilibrium than start"),
        (0.1, np.pi, "start must be an equilibrium"),
        (0.0, [0.0, 2.0], "goal must be an equilibrium"),
    ],
)
def test_what_is_no_pair_of_equilibria_is_an_error(start, goal, message):
    with pytest.raises(ValueError, match=message):
        planned_transition(EnvConfig(n=2, mode="transition"), start, goal)


def test_a_pair_without_a_plan_is_an_error(both):
    only_up = PlannedTransitions({pair: both.plans[pair] for pair in [((False,), (True,))]})
    info = {"theta": np.array([[np.pi]]), "omega": np.zeros((1, 1)), "time": np.zeros(1)}
    with pytest.raises(ValueError, match=r"no plan from \(True,\) to \(False,\)"):
        only_up(None, info | {"goal": np.zeros((1, 1))})


def test_the_environments_keep_their_plans_where_one_has_none(both):
    only_up = PlannedTransitions({pair: both.plans[pair] for pair in [((False,), (True,))]})
    omega, goal = np.zeros((2, 1)), np.full((2, 1), np.pi)
    info = {"theta": omega + 0.01, "omega": omega, "time": np.full(2, 0.05), "goal": goal}
    expected = only_up(None, info)
    other = {"theta": info["theta"] + [[2.0 * np.pi], [0.0]], "time": np.zeros(2)}
    with pytest.raises(ValueError, match="there is no plan"):
        only_up(None, info | other | {"goal": goal * [[1.0], [0.0]]})
    np.testing.assert_array_equal(only_up(None, info), expected)


def test_an_evaluation_takes_options_of_reset():
    keywords = {"n": 1, "mode": "transition"}
    plan = planned_transition(EnvConfig(**keywords), 0.0, np.pi, 3.0, tries=1)
    hangs, stands = np.zeros((8, 1)), np.full((8, 1), np.pi)
    there, back = (
        evaluate(plan, keywords, episodes=8, options={"start": start, "goal": goal})
        for start, goal in ((hangs, stands), (stands, hangs))
    )
    assert there.success_rate == 1.0
    assert back.success_rate == 0.0
