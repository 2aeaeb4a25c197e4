"""The swings after the first, the share of the slowest mode, and the map of the growth."""

import math

import numpy as np
import pytest
from scipy.special import jn_zeros
from scripts import run_script

from npend_gym import Chain, pseudo_periods, theory
from paper.period import growth_map, limits, modes
from paper.swings import measured_swings, small_swings


@pytest.mark.parametrize("n", [1, 3, 20])
def test_the_first_small_swing_is_the_law_and_all_have_the_slowest_period_on_average(n):
    chain = Chain.uniform(n)
    t1, swings = theory.fundamental_period(chain), small_swings(chain, 60)
    assert swings[0] == pytest.approx(float(theory.com_period(chain)), rel=1e-9)
    ends = np.cumsum(swings) / t1
    assert np.abs(ends - np.arange(1, 61)).max() < 0.02  # never further from the slowest mode's


def test_simulated_swings_are_those_of_small_angles_and_of_the_pseudo_period():
    chain = Chain.uniform(4)
    assert measured_swings(chain, 1e-3, 6) == pytest.approx(small_swings(chain, 6), rel=1e-6)
    first = pseudo_periods(chain, 0.7, definition="com", rtol=1e-10)[0]
    assert measured_swings(chain, 0.7, 2)[0] == pytest.approx(first, rel=1e-8)


def test_a_straight_release_is_almost_all_slowest_mode():
    n = 200
    share = modes.shares(Chain.uniform(n), np.full((1, n), 0.3), np.zeros((1, n)))[0]
    assert share.sum() == pytest.approx(1.0)
    assert share[0] == pytest.approx(32.0 / jn_zeros(0, 1)[0] ** 4, abs=1e-3)


def test_shares_of_modes_have_a_row_for_each_start(tmp_path):
    out = tmp_path / "modes.csv"
    run_script(modes.FILE.with_name("modes.py"), out, "2:320", cwd=tmp_path)
    head, *rows = [line.split(",") for line in out.read_text(encoding="utf-8").splitlines()]
    assert head == modes.FILE.read_text(encoding="utf-8").splitlines()[0].split(",")
    assert [row[0] for row in rows] == ["2"] * 4
    assert all(0.95 < float(share) < 1.0 for row in rows for share in row[3:8])


@pytest.mark.parametrize(
    "shape",
    [growth_map.bent(5, 0.5), growth_map.bent(5, -0.5), np.array([1.0, 1.1, 1.2, 1.3, 1.5])],
)
def test_the_growth_of_a_bent_start_is_that_of_simulation(shape):
    chain = Chain.uniform(5)
    straight = shape / (chain.lift @ shape / chain.lift.sum())
    limit = limits.measured(chain, 1e-4 * straight)
    found = [(limits.measured(chain, a * straight) / limit - 1.0) / a**2 for a in (0.04, 0.08)]
    simulated = 16.0 * (4.0 * found[0] - found[1]) / 3.0
    assert growth_map.growth(chain, shape) == pytest.approx(simulated, abs=0.02)


def test_the_map_has_the_growth_that_is_computed_now():
    powers, bends = growth_map.POWERS.tolist(), growth_map.BENDS.tolist()
    for k, column in ((0, 4), (10, 9)):
        chain = growth_map.profile(powers[column], float(growth_map.TIPS[k]))
        shape = growth_map.slowest(chain)
        assert growth_map.kept("straight")[k, column] == pytest.approx(
            growth_map.growth(chain), abs=1e-3
        )
        assert growth_map.kept("slowest mode")[k, column] == pytest.approx(
            growth_map.growth(chain, shape), abs=1e-3
        )
    found = growth_map.growth(growth_map.profile(0.0, 0.0), growth_map.bent(30, bends[2]))
    assert growth_map.kept("bent")[0, 2] == pytest.approx(found, abs=1e-3)
    assert math.isclose(growth_map.growth(Chain.uniform(1)), 1.0, rel_tol=1e-6)
