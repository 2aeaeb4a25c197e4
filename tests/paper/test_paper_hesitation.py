"""Bobs that complete early: the module's numbers against closed forms and the plain measurement."""

import numpy as np
import pytest
from scipy.special import jn_zeros

from npend_gym import Chain, Event, pseudo_periods, simulate, theory
from paper import hesitation
from paper.findings import outcome
from paper.registry import Verdict


def test_a_small_front_moves_as_waves_on_a_hanging_rope():
    # sqrt(tension/density) = sqrt(g s): down in 2 sqrt(L/g), T1 being 4 pi sqrt(L/g)/j01
    down = jn_zeros(0, 1)[0] / (2.0 * np.pi)
    for n in (20, 200):
        tip, back = hesitation.front_times(n, 0.01)
        assert tip == pytest.approx(down, abs=3e-4 + 0.02 / n)
        assert back == pytest.approx(2.0 * tip, abs=1e-3)
    low, high = hesitation.front_passes(200, 0.01, [0.25, 0.81])  # at sqrt(s) of the way back
    assert [low, high] == pytest.approx([1.5 * down, 1.9 * down], abs=1e-3)


def test_a_front_of_a_large_release_is_faster():
    assert hesitation.front_times(100, np.pi / 4)[1] < hesitation.front_times(100, 0.01)[1] - 0.07


def test_the_table_counts_the_bobs_that_complete_early():
    (row,) = hesitation.hesitation_rows([20], [np.pi / 4])
    ratio = pseudo_periods(Chain.uniform(20), np.pi / 4) / theory.fundamental_period(
        Chain.uniform(20)
    )
    assert row["share"] == np.mean(ratio < 0.8)
    assert row["mean"] == pytest.approx(ratio.mean(), abs=1e-6)
    early = hesitation.heights(20)[ratio < 0.8]
    assert row["lowest"] == early.min()


@pytest.mark.parametrize("n", [5, 10])
def test_short_chains_have_no_onset(n):
    with pytest.raises(ValueError, match=f"n must be a number of rods .* got {n}"):
        hesitation.onset(n)


def test_hesitating_bobs_have_a_second_reversal_before_the_front_returns():
    found = hesitation.velocities(100, np.pi / 4, [0.9, 0.5])
    assert found.heights == pytest.approx([0.9, 0.5], abs=0.01)
    assert np.abs(found.values).max() == 1.0  # by the greatest speed so far
    before = (found.times > 0.5) & (found.times < 0.95 * found.passes[0])
    turns = np.count_nonzero(np.diff(np.sign(found.values[:, before])), axis=1)
    assert turns.tolist() == [2, 1]
    assert 0.001 < found.values[0, before].max() < 0.05  # of the greatest speed
    later = found.times > found.times[before][-1]
    swung = found.times[later][np.argmax(found.values[0, later] > 0.0)]  # the front throws it on
    assert swung == pytest.approx(found.passes[0], abs=0.015)
    assert found.passes[1] < found.passes[0] < found.front


@pytest.mark.long
def test_a_bob_reverses_twice_at_the_front_from_its_onset_on():
    n, chain = 50, Chain.uniform(50)
    bob = int(np.abs(hesitation.heights(n) - 0.9).argmin())
    onset = hesitation.onset(n, float(hesitation.heights(n)[bob]))
    t1 = theory.fundamental_period(chain)

    def reversals(amplitude):
        motion = simulate(chain, amplitude, 0.0, [0.0, 0.72 * t1], events=Event("velocity", bob))
        return int(np.sum(motion.t_events[0] > 0.58 * t1))

    assert reversals(onset - 0.01) == 0
    assert reversals(onset + 0.01) == 2


@pytest.mark.long
def test_the_audit_finds_early_bobs_at_the_papers_angle_alone():
    verdict, numbers = outcome("hesitation", n_values=(50, 100, 200))
    assert verdict is Verdict.HOLDS
    assert min(numbers["shares"]) > 0.15
