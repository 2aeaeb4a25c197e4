"""Pseudo-periods of environments: measured in mode "passive" and where `measure_periods` asks."""

import gymnasium as gym
import numpy as np
import pytest
from lanes import assert_same
from test_env_links import CHAIN

from npend_gym import Cart, Chain, pseudo_periods
from npend_gym.envs import EnvConfig, Mode
from npend_gym.envs.modes import MODES, Passive, SwingUp
from npend_gym.physics.kernels.link_terms import Rotor

ID = "NPendulum-v0"
OF_PERIODS = {
    "bobs_completed", "pseudo_period", "pseudo_periods", "pseudo_period_com", "ideal_period",
}  # fmt: skip


class LongRelease(Passive):
    """A release in steps of 0.05 s."""

    dt = 0.05


class Lift(SwingUp):
    """A swing-up judged by Python."""


class Timed(SwingUp):
    """A task of the user's own that measures by default."""

    measures_periods = True


def made(lanes, **keywords):
    if lanes == 1:
        return gym.make(ID, **keywords)
    return gym.make_vec(ID, num_envs=lanes, **keywords)


def shown(env, steps, **options):
    """Return all that an environment shows under the same actions."""
    env.action_space.seed(3)
    results = [env.reset(seed=3, **options)]
    results += [env.step(env.action_space.sample()) for _ in range(steps)]
    return results


@pytest.mark.parametrize("lanes", [1, 3])
@pytest.mark.parametrize("mode", [*MODES, LongRelease(), Lift(), Timed()], ids=str)
def test_periods_are_in_the_info_of_releases_and_where_they_are_asked_for(mode, lanes):
    usual = mode == "passive" or isinstance(mode, Passive | Timed)
    for given, measured in ((None, usual), (True, True), (False, False)):
        env = made(lanes, mode=mode, n=2, measure_periods=given)
        assert env.unwrapped.config.measure_periods is measured
        for result in shown(env, 2):
            keys = {key for key in result[-1] if not key.startswith("_")}
            assert keys & OF_PERIODS == (OF_PERIODS if measured else set())
            assert {"energy", "energy_error", "time", "diverged", "theta"} <= keys


KINDS = {
    "bobs": {"n": 3},
    "a cart": {"n": 2, "base": "cart"},
    "links": {"chain": CHAIN},
    "pieces of a step": {"n": 2, "motor_lag": 0.03, "action_delay": 0.5, "angle_noise": 0.1},
    "a drawn chain": {"n": 2, "randomize": {"masses": (0.5, 2.0)}},
    "a mode of one's own": {"n": 2, "mode": Lift()},
    "a release": {"n": 3, "mode": "passive"},
}
SLOW = {  # to compile
    "links": [pytest.mark.long],
    "a cart": [pytest.mark.long],
    "pieces of a step": [pytest.mark.long, pytest.mark.nightly],
}


@pytest.mark.parametrize("lanes", [1, 3])
@pytest.mark.parametrize(
    "kind",
    [pytest.param(k, marks=SLOW.get(k, [])) for k in KINDS],
)
def test_to_measure_changes_no_bit_of_what_is_shown(kind, lanes):
    with_periods, without = (
        shown(made(lanes, **KINDS[kind], measure_periods=given), 60) for given in (True, False)
    )
    for one, other in zip(with_periods, without, strict=True):
        assert_same(list(one[:-1]), list(other[:-1]))
        assert one[-1].keys() - other[-1].keys() >= OF_PERIODS
        assert_same({key: one[-1][key] for key in other[-1]}, other[-1])


@pytest.mark.parametrize("lanes", [1, 3])
@pytest.mark.parametrize("base", [None, pytest.param(Cart(2.0), marks=pytest.mark.long)])
def test_a_task_with_motors_that_do_nothing_measures_the_periods_of_a_release(base, lanes):
    chain = Chain.uniform(2, base=base) if base else Chain.uniform(2)
    env = made(
        lanes, mode="calm", chain=chain, measure_periods=True, rail=50.0 if base else None,
        substeps=20, max_episode_steps=400,
    )  # fmt: skip
    env.reset(seed=0, options={"theta": 0.5})
    for _ in range(390):
        info = env.step(np.zeros(env.action_space.shape, np.float32))[-1]
    for key, definition in (("pseudo_periods", "bob"), ("pseudo_period_com", "com")):
        expected = pseudo_periods(chain, 0.5, definition=definition)
        expected = expected if definition == "bob" else expected[0]
        np.testing.assert_allclose(info[key] - expected, 0.0, rtol=0.0, atol=1e-6)
    assert np.all(info["bobs_completed"] == 2)


def test_a_reset_by_autoreset_begins_to_measure_again():
    envs = made(3, mode="passive", n=1, amplitude=0.5, spread=0.0, dt=0.05, max_episode_steps=70)
    envs.reset(seed=0)
    infos = [envs.step(np.zeros(3, np.int64))[-1] for _ in range(142)]
    expected = pseudo_periods(Chain.uniform(1), 0.5)[0]
    for info in (infos[69], infos[140]):
        np.testing.assert_allclose(info["pseudo_period"], expected, rtol=0.0, atol=1e-5)
    assert not infos[70]["bobs_completed"].any()


@pytest.mark.parametrize("measured", [True, False])
def test_a_state_goes_on_measuring_and_is_only_for_an_environment_that_measures_the_same(measured):
    env, other = (
        made(1, mode="calm", n=2, measure_periods=each).unwrapped
        for each in (measured, not measured)
    )
    shown(env, 50)
    state = env.get_state()
    assert ("record" in state.dtype.names) is measured  # what is not measured takes no memory
    rest = [env.step(np.zeros(1)) for _ in range(200)]
    env.set_state(state)
    assert_same([list(env.step(np.zeros(1))) for _ in range(200)], [list(each) for each in rest])
    other.reset(seed=0)
    with pytest.raises(ValueError, match="state must come from an environment with the same"):
        other.set_state(state)


def test_the_keyword_is_a_truth_and_a_mode_of_ones_own_names_its_default():
    with pytest.raises(TypeError, match="measure_periods must be True or False, got 'yes'"):
        EnvConfig(measure_periods="yes")

    class Old(Mode):
        measures_com = True

    with pytest.raises(TypeError, match="measures_com of mode 'custom' must be named measures_per"):
        EnvConfig(mode=Old())
    env = gym.make(gym.spec(ID), measure_periods=True)
    assert '"measure_periods": true' in env.spec.to_json()


def test_periods_leave_a_task_as_hard_as_it_is():
    assert gym.make("npend/SwingUp-v1", measure_periods=True).unwrapped.spec.reward_threshold == 900


@pytest.mark.long
def test_a_chain_with_rotors_goes_on_from_its_state():
    env = gym.make(ID, chain=Chain.rods([1.0, 0.5], [1.0, 0.7], armature=0.1)).unwrapped
    shown(env, 10)
    state = env.get_state()
    assert np.all(state["rotors"][Rotor.ARMATURE] == 0.1)
    after = env.step(np.ones(1))
    env.set_state(state)
    assert_same(list(env.step(np.ones(1))), list(after))
