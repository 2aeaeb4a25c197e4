"""What holds for the motion of every chain."""

import numpy as np
import pytest

from npend_gym import Chain, pseudo_periods, simulate, theory

TIGHTEST = {"rtol": 1e-14, "atol": 1e-16}


def uneven_chain(n, **others):
    return Chain(np.linspace(1.0, 0.4, n), np.linspace(0.6, 1.1, n), **others)


def test_energy_is_kept_for_twenty_seconds_and_for_an_hour():
    for n in (1, 2, 5):
        chain = uneven_chain(n)
        scale = float(chain.gravity * (chain.masses @ np.cumsum(chain.lengths)))
        tight = simulate(chain, 1.5, 0.0, np.linspace(0.0, 20.0, 201), **TIGHTEST).energy()
        assert np.ptp(tight) < 1e-9 * scale
        hour = simulate(chain, 0.8, 0.0, np.linspace(0.0, 3600.0, 361)).energy()
        assert np.ptp(hour) < 1e-6 * scale


def test_whole_turns_of_a_rod_change_nothing_but_its_angle():
    chain, start = uneven_chain(3), np.array([0.5, 1.0, -0.3])
    turns = 2.0 * np.pi * np.array([1, -2, 3])
    times = np.linspace(0.0, 3.0, 31)
    path = simulate(chain, start, 0.0, times, **TIGHTEST)
    turned = simulate(chain, start + turns, 0.0, times, **TIGHTEST)
    np.testing.assert_allclose(turned.theta - turns, path.theta, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(turned.positions(), path.positions(), rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("ratio", [1e-12, 1e-3, 1e3, pytest.param(1e12, marks=pytest.mark.long)])
@pytest.mark.parametrize("what", ["masses", "lengths"])
def test_enormous_ratios_keep_the_energy(what, ratio):
    values = {"masses": np.ones(3), "lengths": np.ones(3)}
    values[what] = np.array([1.0, 1.0, ratio])
    chain = Chain(**values)
    period = 2.0 * np.pi / theory.fastest_frequency(chain)
    times = np.linspace(0.0, 20.0 * min(period, 1.0), 21)
    energy = simulate(chain, 0.5, 0.0, times, rtol=1e-12, atol=1e-14).energy()
    assert np.ptp(energy) < 1e-8 * energy[0]


@pytest.mark.parametrize("n", [2, 3, 5])
def test_a_mode_has_the_period_of_its_frequency(n):
    chain = uneven_chain(n)
    frequencies, modes = theory.normal_modes(chain)
    for k in range(n):
        shape = 1e-4 * modes[:, k]
        periods = pseudo_periods(chain, shape, definition="link")
        # a rod's speed falls, rises and falls: in a mode, one period from rest
        known = periods[np.isfinite(periods)]
        assert known.size
        np.testing.assert_allclose(known, 2.0 * np.pi / frequencies[k], rtol=1e-6)


@pytest.mark.parametrize("definition", ["bob", "link"])
def test_a_bob_that_goes_over_the_top_for_ever_has_no_period_of_its_rod(definition):
    periods = pseudo_periods(Chain.uniform(1), 0.1, 10.0, definition=definition, duration=20.0)
    if definition == "link":  # the rod never turns back
        assert np.isnan(periods).all()
    else:  # the bob's horizontal velocity reverses twice in each turn, at the top and the sides
        path = simulate(Chain.uniform(1), 0.1, 10.0, np.linspace(0.0, 2.0, 20001))
        side = path.velocities()[:, 0, 0]
        up = np.flatnonzero((side[:-1] < 0.0) & (side[1:] >= 0.0))[0]
        down = np.flatnonzero((side[:-1] > 0.0) & (side[1:] <= 0.0))
        assert periods[0] == pytest.approx(path.times[down[down > up][0]], abs=2e-4)
