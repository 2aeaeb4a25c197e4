import numpy as np
import pytest
from scipy.special import ellipk

from npend_gym import Chain, pseudo_periods
from paper.estimator import listing_periods
from paper.findings import outcome
from paper.measured import bob_periods, fundamental_periods, ideal_periods
from paper.readings import (
    AMPLITUDES,
    AS_PRINTED,
    AS_WRITTEN,
    ERRORS,
    Grid,
    Reading,
    all_readings,
    error,
    grid,
)
from paper.registry import Verdict

ANGLE = 0.777


def model(n):
    return 2 * np.pi * np.sqrt(n / 9.8)


@pytest.mark.parametrize("reading", ["bob", "link", "height"])
def test_periods_on_short_rods_follow_from_those_on_rods_of_a_metre(reading):
    direct = pseudo_periods(
        Chain.uniform(7, length=1 / 7), ANGLE, definition=reading, duration=10.0
    )
    np.testing.assert_allclose(bob_periods(7, ANGLE, reading, "1/n m"), direct, rtol=1e-4)


def test_the_listing_sees_ten_seconds_of_either_chain():
    for rods, length in (("1 m", 1.0), ("1/n m", 1 / 3)):
        direct = listing_periods(Chain.uniform(3, length=length), ANGLE)
        np.testing.assert_allclose(bob_periods(3, ANGLE, "listing", rods), direct, rtol=1e-3)


def test_no_pendulum_has_no_period_and_one_has_galileos():
    assert ideal_periods(2).tolist() == pytest.approx([0.0, model(1), model(2)])
    assert fundamental_periods(1)[1] == pytest.approx(2 * np.pi / np.sqrt(9.81))


def test_error_of_one_pendulum_is_that_of_the_elliptic_integral():
    exact = 4 * ellipk(np.sin(ANGLE / 2) ** 2) / np.sqrt(9.81)
    assert error(AS_WRITTEN, 1, ANGLE) == pytest.approx((exact - model(1)) / exact, abs=1e-5)


def test_cumulative_error_of_two_is_the_mean_over_both_chains():
    # means over the bobs from pi/4, found with SciPy on the dense equations
    simulated = np.array([2.08625587, 2.71648333])
    expected = np.mean(np.abs(simulated - model(np.arange(1, 3))) / simulated)
    assert error(AS_WRITTEN, 2, np.pi / 4) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({}, lambda s, t: abs(s.mean() - t) / s.mean()),
        ({"statistic": "median"}, lambda s, t: abs(np.median(s) - t) / np.median(s)),
        ({"statistic": "harmonic mean"}, lambda s, t: abs(1 - t * np.mean(1 / s))),
        ({"statistic": "mean of 1/T"}, lambda s, t: abs(np.mean(1 / s) - t) / np.mean(1 / s)),
        ({"statistic": "last"}, lambda s, t: abs(s[-1] - t) / s[-1]),
        ({"divisor": "T"}, lambda s, t: abs(s.mean() - t) / t),
        ({"model": "T0 x 1.049"}, lambda s, t: abs(s.mean() - 1.049 * t) / s.mean()),
        ({"terms": "bobs of chain N", "statistic": "each bob"},
         lambda s, t: np.mean(abs(1 - t / s))),
    ],
)  # fmt: skip
def test_each_part_of_a_reading_does_what_it_says(change, expected):
    reading = Reading(**({"terms": "chain N"} | change))
    simulated = pseudo_periods(Chain.uniform(3), ANGLE)
    assert error(reading, 3, ANGLE) == pytest.approx(expected(simulated, model(3)), abs=1e-5)


def test_averages_over_the_terms_differ_as_they_should():
    simulated = np.array([pseudo_periods(Chain.uniform(n), ANGLE).mean() for n in (1, 2, 3)])
    terms = (simulated - model(np.arange(1, 4))) / simulated
    for average, expected in (
        ("mean", np.mean(np.abs(terms))),
        ("root mean square", np.sqrt(np.mean(terms**2))),
        ("signed mean", abs(np.mean(terms))),
    ):
        assert error(Reading(average=average), 3, ANGLE) == pytest.approx(expected, abs=1e-5)


def test_as_drawn_each_chain_meets_the_model_of_one_pendulum_less():
    second = pseudo_periods(Chain.uniform(2), ANGLE).mean()
    expected = (1.0 + abs(second - model(1)) / second) / 2  # the first model period is zero
    assert error(Reading(terms="as drawn"), 1, ANGLE) == pytest.approx(expected, abs=1e-5)


def test_rods_of_a_length_to_match_take_the_square_root_out_of_the_model():
    mean = pseudo_periods(Chain.uniform(4, length=0.25), ANGLE).mean()
    reading = Reading(rods="1/n m", window="10 s", model_rods="1/n m", terms="chain N")
    assert error(reading, 4, ANGLE) == pytest.approx(abs(mean - model(1)) / mean, abs=1e-5)


def test_bobs_that_need_more_than_ten_seconds_are_left_out():
    periods = pseudo_periods(Chain.uniform(45), ANGLE)
    done = periods[periods <= 10.0]
    assert 0 < done.size < 45
    reading = Reading(window="10 s", statistic="each bob", terms="bobs of chain N")
    expected = np.mean(np.abs(done - model(45)) / done)
    assert error(reading, 45, ANGLE) == pytest.approx(expected, abs=1e-4)


def test_all_readings_are_different():
    readings = list(all_readings())
    assert len(readings) == len(set(readings)) > 1000
    assert AS_WRITTEN in readings


def planted(errors):
    errors = np.asarray(errors, float)
    readings = (AS_WRITTEN, AS_PRINTED, Reading(divisor="T"))[: len(errors)]
    return Grid((5, 10, 20, 100), readings, errors)


def test_a_grid_knows_the_worst_cell_the_nearest_reading_and_the_scatter():
    one_off = ERRORS.copy()
    one_off[1, 2] += 0.03
    missing = np.full((3, 4), np.nan)
    result = planted([ERRORS + 0.1, missing, one_off])
    assert result.distances == pytest.approx([0.1, np.inf, 0.03])
    assert result.nearest == 2
    assert result.cells_met.tolist() == [0, 0, 11]
    assert result.printed_scatter == pytest.approx([0.080, 0.041, 0.014, 0.175])
    assert [row["worst_distance"] for row in result.rows()] == pytest.approx([0.03, 0.1, np.inf])


def test_sensitivity_is_the_slope_of_the_error_in_the_angle():
    result = planted([0.2 + 3.0 * AMPLITUDES])
    assert result.sensitivity(AS_WRITTEN) == pytest.approx([3.0] * 4)


def test_had_a_reading_met_the_tables_the_audit_would_say_so():
    met = planted([ERRORS + 0.1, ERRORS])
    for key in ("tables-together", "table-3", "tables-scatter"):
        assert outcome(key, result=met).verdict is Verdict.HOLDS, key
    missed = planted([ERRORS + 0.1, ERRORS + 0.2])
    assert outcome("tables-together", result=missed).verdict is Verdict.FAILS


def test_an_exponential_grows_at_one_rate():
    e = 0.1 * np.exp(0.01 * np.array([5, 10, 20, 100]))
    numbers = outcome("e-exponential", e=e).numbers
    assert numbers["first"] == pytest.approx(0.01)
    assert numbers["last"] == pytest.approx(0.01)


@pytest.mark.long
def test_the_audit_of_the_short_columns_finds_no_reading_and_too_much_scatter():
    short = grid((5, 10))
    for key in ("table-1", "table-2", "table-3", "tables-together", "tables-scatter"):
        assert outcome(key, result=short).verdict is Verdict.FAILS, key
    assert outcome("e-at-5").verdict is Verdict.HOLDS
    assert outcome("amplitudes").numbers["inside"] == 3
    assert np.all(short.scatter[:, 0] < short.printed_scatter[0])
