import pickle
from concurrent.futures import ThreadPoolExecutor

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from test_env_links import CHAIN
from test_render import TIP, where

import npend_gym
from npend_gym import Cart, Chain, pseudo_periods, simulate
from npend_gym.envs import Mode
from npend_gym.envs.modes import MODES

ALL_MODES = tuple(MODES)
INFO_KEYS = {
    "time", "energy", "energy_error", "tip_height", "theta", "omega", "diverged", "success",
}  # fmt: skip
OF_RELEASES = {
    "bobs_completed", "pseudo_period", "pseudo_periods", "pseudo_period_com", "ideal_period",
}  # fmt: skip


def make(**keywords):
    return gym.make("NPendulum-v0", **keywords)


def bare(**keywords):
    return make(**keywords).unwrapped


def rollout(env, steps, seed=0, **options):
    """Return everything an episode shows, actions drawn from the action space."""
    env.action_space.seed(seed)
    observation, info = env.reset(seed=seed, **options)
    outputs = [(observation, info)]
    for _ in range(steps):
        step = env.step(env.action_space.sample())
        outputs.append(step)
        if step[2] or step[3]:
            break
    return outputs


def digest(outputs):
    return pickle.dumps(outputs)


@pytest.mark.parametrize("observation", ["angles", "sincos"])
def test_gymnasiums_checker_accepts_observations_and_pictures_without_a_warning(observation):
    pytest.importorskip("pygame")
    check_env(bare(mode="calm", n=3, observation=observation, render_mode="rgb_array"))


@pytest.mark.parametrize("mode", ALL_MODES)
def test_infos_have_the_same_keys_and_fresh_finite_values_from_the_reset_on(mode):
    outputs = rollout(make(mode=mode, n=3), 20)
    infos = [outputs[0][1]] + [step[4] for step in outputs[1:]]
    arrays = [info[key] for info in infos for key in ("theta", "omega")]
    arrays += [info["pseudo_periods"] for info in infos if mode == "passive"]
    arrays += [outputs[0][0]] + [step[0] for step in outputs[1:]]
    arrays += [info["torque"] for info in infos if mode != "passive"]
    of_mode = {"passive": OF_RELEASES, "transition": {"goal", "torque"}}
    of_mode = of_mode.get(mode, {"torque"})
    assert all(set(info) == INFO_KEYS | of_mode for info in infos)
    assert all(np.all(np.isfinite(value)) for info in infos for value in info.values())
    for i, a in enumerate(arrays):
        assert not any(np.shares_memory(a, b) for b in arrays[:i])
    assert isinstance(infos[-1]["time"], float)
    assert mode != "passive" or isinstance(infos[-1]["bobs_completed"], int)
    assert infos[-1]["theta"].dtype == np.float64


def test_the_torque_in_the_info_is_the_limit_times_the_clipped_action_and_none_at_the_start():
    drawn = {"max_torque": (0.5, 1.0)}
    env = bare(n=3, actuated=(2, 0), max_torque=4.0, randomize=drawn)
    results = []
    for beyond in (-3.0, -1.0):
        info = env.reset(seed=0)[1]
        limit = info["context"][env.config.context_names.index("max_torque")]
        assert info["torque"].tolist() == [0.0, 0.0]
        results.append(env.step(np.array([0.5, beyond])))
        np.testing.assert_array_equal(results[-1][-1]["torque"], [0.5 * limit, -limit])
    assert digest(results[0]) == digest(results[1])


@pytest.mark.parametrize("mode", [m for m in ALL_MODES if m != "passive"])
def test_rewards_lie_between_zero_and_one(mode):
    rewards = [step[1] for step in rollout(make(mode=mode, n=2), 300)[1:]]
    assert all(type(reward) is float and 0.0 <= reward <= 1.0 for reward in rewards)
    assert max(rewards) > 0.0


def test_passive_episode_is_the_papers_thousand_frames_without_reward():
    outputs = rollout(make(mode="passive", n=2), 2000)
    assert len(outputs) == 1001
    assert outputs[-1][3]
    assert not outputs[-1][2]
    assert outputs[-1][4]["time"] == pytest.approx(10.0)
    assert {str(step[1]) for step in outputs[1:]} == {"0.0"}  # not -0.0, which equals it


RELEASES = {f"{n} rods": ({"n": n}, {}) for n in (1, 2, 3, 5, 10, 20)} | {
    "from the other side": ({"n": 3}, {"theta": -0.7}),
    "one from beyond 90 degrees": ({"n": 1}, {"theta": -2.5}),
    "from beyond 90 degrees": ({"n": 3}, {"theta": 1.75}),
    "fast": ({"n": 3}, {"theta": [1.2, 1.0, 0.8], "omega": [-14.0, -9.0, 6.0]}),
    "links of rods": ({"chain": Chain.rods([1.0, 0.4], [0.5, 0.8])}, {}),
    "links from beyond 90 degrees": ({"chain": Chain.rods([1.0, 0.4], [0.5, 0.8])}, {"theta": 1.7}),
    "links of a robot": ({"chain": Chain.realaigym("A.0")}, {"amplitude": 0.6}),
    "links of arms": ({"chain": Chain.multiarm(3)}, {"amplitude": 0.6}),
}


@pytest.mark.parametrize(
    "kind",
    [
        # kernels of their own take long to compile
        pytest.param(
            kind,
            marks=[pytest.mark.long] * ("links" in kind)
            + [pytest.mark.nightly] * (kind == "links of rods"),
        )
        for kind in RELEASES
    ],
)
def test_passive_mode_measures_the_pseudo_periods_of_the_release(kind):
    keywords, options = RELEASES[kind]
    env = make(mode="passive", **keywords)
    _, info = env.reset(seed=2, options=options)
    chain, start = env.unwrapped.chain, (info["theta"], info["omega"])
    expected = pseudo_periods(chain, *start, duration=10.0)
    truncated = False
    while not truncated:
        _, _, _, truncated, info = env.step(0)
    done = np.isfinite(expected)
    assert done.all() if options else done.any()
    assert info["bobs_completed"] == done.sum()
    np.testing.assert_allclose(info["pseudo_periods"][done], expected[done], rtol=0, atol=1e-6)
    assert not info["pseudo_periods"][~done].any()
    assert info["pseudo_period"] == pytest.approx(expected[done].mean(), abs=1e-6)
    of_com = pseudo_periods(chain, *start, definition="com", duration=10.0)[0]
    assert info["pseudo_period_com"] == pytest.approx(of_com, abs=1e-6)


BOBS = {
    "masses": [1.0, 0.5, 2.0], "lengths": [1.0, 0.7, 0.4], "damping": 0.1,
    "drag": [0.3, 0.1, 0.2], "quadratic_drag": [0.2, 0.5, 0.1],
}  # fmt: skip


@pytest.mark.parametrize(
    ("keywords", "chain", "substeps", "tolerance"),
    [
        (BOBS, Chain(**BOBS), 20, 1e-6),
        # kernels of their own take long to compile
        pytest.param({"chain": CHAIN}, CHAIN, 100, 1e-7, marks=pytest.mark.long),
    ],
    ids=["bobs", "links"],
)
def test_the_env_moves_as_simulate_does(keywords, chain, substeps, tolerance):
    env = bare(
        **keywords, actuated=(2, 0), max_torque=1.5, dt=0.02, substeps=substeps,
        measure_periods=True,
    )  # fmt: skip
    start = {"theta": [0.4, -0.3, 1.1], "omega": [0.5, -1.0, 2.0]}
    env.reset(options=start)
    info = [env.step(np.array([-0.5, 0.9]))[4] for _ in range(25)][-1]
    exact = simulate(chain, *start.values(), [0.0, 0.5], torque=[1.35, 0.0, -0.75])
    np.testing.assert_allclose(info["theta"], exact.theta[-1], rtol=0, atol=tolerance)
    np.testing.assert_allclose(info["omega"], exact.omega[-1], rtol=0, atol=10.0 * tolerance)
    assert info["energy"] == pytest.approx(exact.energy()[-1], rel=1e-6)
    assert info["tip_height"] == pytest.approx(exact.positions()[-1, -1, 1], abs=1e-6)
    assert (info["ideal_period"] == 0.0) == (chain is CHAIN)  # the paper's T0 is not of links
    # power of torque, damping, friction, drag and rotors
    assert abs(info["energy_error"]) < 0.01 * tolerance


def test_observations_are_wrapped_angles_or_sines_and_then_velocities():
    start = {"theta": [3.5, -9.1], "omega": [0.25, -1.0]}
    angles, _ = bare(n=2).reset(options=start)
    expected = [3.5 - 2 * np.pi, -9.1 + 2 * np.pi, 0.25, -1.0]
    np.testing.assert_allclose(angles, expected, rtol=1e-6)
    sines, _ = bare(n=2, observation="sincos").reset(options=start)
    expected = [*np.sin([3.5, -9.1]), *np.cos([3.5, -9.1]), 0.25, -1.0]
    np.testing.assert_allclose(sines, expected, rtol=1e-6)
    at_pi, _ = bare(n=1).reset(options={"theta": np.nextafter(np.pi, 0.0), "omega": 0.0})
    assert at_pi[0] == -np.float32(np.pi)


def test_reset_options_last_for_one_episode():
    env = bare(n=2, mode="calm", measure_periods=True)
    _, info = env.reset(
        seed=0, options={"lengths": [0.5, 0.25], "masses": 2.0, "gravity": 5.0, "amplitude": 0.2}
    )
    chain = Chain(2.0, [0.5, 0.25], gravity=5.0)
    path = simulate(chain, info["theta"], 0.0, [0.0])
    assert info["energy"] == pytest.approx(path.energy()[0])
    assert info["ideal_period"] == pytest.approx(npend_gym.theory.ideal_period(chain))
    assert 0.2 <= info["theta"][0] < 0.217
    _, info = env.reset(seed=0)
    assert info["ideal_period"] == pytest.approx(npend_gym.theory.ideal_period(Chain.uniform(2)))


def test_balance_fails_when_the_tip_falls_below_half_its_height():
    outputs = rollout(make(mode="balance", n=2), 1000)
    assert outputs[-1][2]
    assert outputs[-1][4]["tip_height"] < 1.0
    assert all(step[4]["tip_height"] >= 1.0 for step in outputs[1:-1])


def test_a_diverged_chain_is_truncated_with_its_last_finite_state():
    env = bare(n=40, mode="passive", lengths=0.01, dt=0.5, substeps=1)
    env.reset(seed=0)
    before = None
    for _ in range(200):
        observation, _, terminated, truncated, info = env.step(0)
        assert np.isfinite(observation).all()
        assert all(np.all(np.isfinite(value)) for value in info.values())
        if truncated:
            break
        before = info
    assert truncated
    assert info["diverged"]
    assert not terminated
    if before is not None:
        np.testing.assert_array_equal(info["theta"], before["theta"])
    _, info = env.reset()
    assert not info["diverged"]


def test_a_spec_survives_json_and_pickle():
    drawn = {"lengths": (0.8, 1.2), "damping": {"low": np.zeros(3), "high": 0.1}}
    env = make(
        masses=np.array([1.0, 0.5, 2.0]), mode="calm", max_torque=2.0, actuated=(0, 2),
        randomize=drawn,
    )  # fmt: skip
    for spec in (EnvSpec.from_json(env.spec.to_json()), pickle.loads(pickle.dumps(env.spec))):
        assert digest(rollout(gym.make(spec), 20)) == digest(rollout(env, 20))


def test_everyday_wrappers_work():
    env = make(mode="swingup", n=2)
    for wrap in (
        lambda e: gym.wrappers.TimeLimit(e, 30),
        gym.wrappers.RecordEpisodeStatistics,
        gym.wrappers.NormalizeObservation,
        lambda e: gym.wrappers.RescaleAction(e, np.float32(-2.0), np.float32(2.0)),
        lambda e: gym.wrappers.FrameStackObservation(e, 3),
    ):
        env = wrap(env)
    outputs = rollout(env, 100)
    assert len(outputs) == 31
    assert outputs[-1][0].shape == (3, 4)
    assert outputs[-1][4]["episode"]["l"] == 30


class Constant(Mode):
    """A mode without failure that returns a plain number."""

    def start(self, rng, n, amplitude, spread):  # noqa: ARG002
        return np.full(n, 0.1), np.zeros(n)

    def reward(self, quantities):  # noqa: ARG002
        return 1


class Still(Constant):
    """A mode of a user: stay where you are."""

    name = "still"

    def reward(self, quantities):
        return 1.0 / (1.0 + quantities.kinetic_energy)

    def failed(self, quantities):
        return quantities.height > 0.9


class Lazy(Still):
    """A mode that returns one number for all, or a quantity as it is."""

    def reward(self, quantities):
        return quantities.tip

    def failed(self, quantities):  # noqa: ARG002
        return True


@pytest.mark.parametrize("mode", [Still(), Lazy(), Constant()], ids=["Still", "Lazy", "Constant"])
def test_a_mode_of_ones_own_may_return_what_it_computes_one_number_or_a_quantity(mode):
    env = make(mode=mode, n=2)
    check_env(env.unwrapped, skip_render_check=True)
    vector = gym.make_vec("NPendulum-v0", num_envs=3, mode=mode, n=2)
    vector.reset(seed=0)
    env.reset(seed=0)
    _, reward, terminated, _, info = vector.step(np.full((3, 1), 0.5, np.float32))
    assert reward.shape == (3,)
    assert (reward.dtype, terminated.dtype) == (np.float64, np.bool_)
    assert reward[0] == env.step(np.full(1, 0.5, np.float32))[1]
    assert (reward[0] == 1.0) == (type(mode) is Constant)
    assert terminated.tolist() == [isinstance(mode, Lazy)] * 3
    if isinstance(mode, Still):
        assert info["success"].tolist() == [not isinstance(mode, Lazy)] * 3
    else:
        assert "success" not in info


class Upright(Constant):
    """A mode for vector environments alone: it takes means over the rods of each lane."""

    def reward(self, quantities):
        return np.cos(quantities.theta).mean(axis=1)


def test_a_mode_of_ones_own_is_given_arrays_in_a_vector_environment_of_one_lane_too():
    rewards = []
    for count in (1, 2):
        vector = gym.make_vec("NPendulum-v0", num_envs=count, mode=Upright(), n=2)
        vector.reset(seed=0)
        rewards.append(vector.step(np.full((count, 1), 0.5, np.float32))[1])
    assert rewards[0].tolist() == rewards[1][:1].tolist()


def test_two_threads_can_step_two_envs_at_once():
    def episode():
        return digest(rollout(make(n=5), 400, seed=1))

    with ThreadPoolExecutor(2) as pool:
        work = [pool.submit(episode) for _ in range(2)]
    assert [each.result() for each in work] == [episode()] * 2


@pytest.mark.long
def test_a_hundred_thousand_steps_do_not_grow_the_memory():
    resource = pytest.importorskip("resource")
    env = bare(n=2)
    env.reset(seed=0)
    action = np.array([0.2], np.float32)
    sizes = []
    for _ in range(5):
        for _ in range(20_000):
            env.step(action)
        env.reset()
        sizes.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    assert sizes[-1] - sizes[0] < 2_000  # kilobytes


def test_pictures_have_the_size_asked_for_the_rate_of_steps_and_if_plain_hide_the_action():
    pytest.importorskip("pygame")
    frames = []
    for torque in (0.0, 1.0):
        env = make(n=2, render_mode="rgb_array", render_size=84, render_plain=True, dt=1e-9)
        env.reset(seed=0)
        env.step(np.array([torque], np.float32))
        frames.append(env.render())
    assert frames[0].shape == (84, 84, 3)
    np.testing.assert_array_equal(*frames)
    assert env.metadata["render_fps"] == 1e9
    assert make(mode="passive", n=3).metadata["render_fps"] == 100
    assert make(mode="swingup", n=2).metadata["render_fps"] == 20


def test_a_chain_beside_the_end_of_its_rail_is_in_the_picture():
    pytest.importorskip("pygame")
    env = make(chain=Chain([1.0], [1.0], base=Cart(1.0)), mode="swingup", render_mode="rgb_array")
    for cart in (0.5, -1.9):
        turned = np.copysign(np.pi / 2, cart)
        env.reset(seed=0, options={"theta": [turned], "cart_position": cart})
        reach = max(2.0, abs(cart) + 1.0)  # the rail fills the picture until the tip is beyond it
        x = 240.0 + 0.44 * 480 * (cart + np.sign(cart)) / reach
        assert where(env.render(), TIP)[0] == pytest.approx(x, abs=1.0)


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_gymnasiums_wrapper_makes_pictures_the_observation_of_many_environments(mode):
    pytest.importorskip("pygame")
    from gymnasium.wrappers import AddRenderObservation

    keywords = {"n": 2, "render_mode": "rgb_array", "render_size": 64, "render_plain": True}
    envs = gym.make_vec("npend/SwingUp-v1", 2, mode, wrappers=[AddRenderObservation], **keywords)
    native = gym.make_vec("npend/SwingUp-v1", 2, **keywords)
    for each in (envs, native):
        each.action_space.seed(3)
    pictures, _ = envs.reset(seed=5)
    native.reset(seed=[5, 6])
    np.testing.assert_array_equal(pictures, np.stack(native.render()))
    actions = envs.action_space.sample()
    pictures, *_ = envs.step(actions)
    native.step(actions)
    np.testing.assert_array_equal(pictures, np.stack(native.render()))
    envs.close()


@pytest.mark.parametrize(
    ("n", "bound"),
    [(1, 3e-5), (2, 1e-4), (5, 1e-4), pytest.param(10, 3e-4, marks=pytest.mark.long)],
)
def test_the_energy_of_chains_under_random_torques_is_kept(n, bound):
    envs = gym.make_vec("NPendulum-v0", num_envs=32, n=n, mode="swingup")
    envs.reset(seed=0)
    draw = np.random.default_rng(0)
    fastest = 0.0
    for _ in range(1000):
        info = envs.step(draw.uniform(-1.0, 1.0, (32, 1)))[-1]
        fastest = max(fastest, np.abs(info["omega"]).max())
    assert np.abs(info["energy_error"]).max() < bound
    assert fastest > {1: 5.0, 2: 15.0, 5: 60.0, 10: 150.0}[n]


def test_a_given_number_of_substeps_holds_however_fast_the_chain_moves():
    chain = Chain.uniform(2)
    start = np.array([1.0, -0.5]), np.array([40.0, -30.0])
    exact = simulate(chain, *start, [0.0, 0.05], method="rk4", dt=0.01)
    coarse = bare(n=2, mode="calm", substeps=5, max_torque=0.0)
    fine = bare(n=2, mode="calm", max_torque=0.0)
    ends = []
    for env in (coarse, fine):
        env.reset(options={"theta": start[0], "omega": start[1]})
        ends.append(env.step(np.zeros(1, np.float32))[-1]["theta"])
    np.testing.assert_allclose(ends[0], exact.theta[-1], rtol=0, atol=1e-12)
    truth = simulate(chain, *start, [0.0, 0.05], rtol=1e-12, atol=1e-13).theta[-1]
    assert np.abs(ends[1] - truth).max() < 1e-2 * np.abs(ends[0] - truth).max()
