import ast
import math

import numpy as np
import pytest

from npend_gym import theory
from paper.checks import periods
from paper.checks.procedure import figure2, series
from paper.findings import finding, outcome
from paper.printed import listings
from paper.registry import Verdict


@pytest.mark.parametrize(
    ("printed", "value", "how"),
    [
        ("4.487", 4.48799, "cut"),
        ("6.347", 6.34698, "rounded"),
        ("8.570", 8.57027, "either"),
        ("1.385", 1.39576, "neither"),
        ("20", 19.6, "rounded"),
        ("0.3", 0.25, "rounded"),
    ],
)
def test_digits_are_told_from_rounding_and_cutting(printed, value, how):
    assert periods.digits(printed, value) == how


def test_ideal_periods_are_the_formula_with_the_papers_gravity():
    n = np.array([5, 10, 20, 100])
    assert periods.ideal() == pytest.approx(2 * np.pi * np.sqrt(n / 9.8), rel=1e-14)
    hows = periods.digits_of(periods.IDEAL, periods.ideal())
    assert hows == ["cut", "rounded", "rounded", "rounded"]
    assert set(periods.digits_of(periods.IDEAL, periods.ideal(9.81))) == {"neither"}


def test_one_uncertainty_is_no_rounding_of_its_formula():
    rows = [row for row in periods.digit_rows() if row["quantity"] == "Delta T"]
    assert len(rows) == 12
    assert [(row["table"], row["n"]) for row in rows if row["digits"] == "neither"] == [(1, 5)]
    assert rows[0]["formula_s"] == pytest.approx(0.311 * 4.48799, rel=1e-6)


def test_the_printed_digits_fix_the_fraction_that_made_them():
    for table, fraction in ((1, 0.311), (2, 0.427), (3, 0.293)):
        numbers = outcome(f"dt-table-{table}").numbers
        assert numbers["low"] <= fraction <= numbers["high"] < numbers["low"] + 1e-4
        assert bool(numbers["wrong"]) is (table == 1)


def test_error_bars_are_the_sum_that_the_listing_spells_out():
    lines = map(ast.unparse, listings()[3].tree.body)
    (bar,) = (line for line in lines if line.startswith("yerr_val = "))
    names = {"np": np, "math": math, "x": 5}
    exec(bar, names)
    expected = periods.listing_bars() * periods.ideal()[0]
    assert names["yerr_val"] == pytest.approx(expected, rel=1e-12)


def test_the_maximum_of_a_trial_would_be_the_model_had_the_slowest_bob_its_period(monkeypatch):
    assert outcome("maximum").verdict is Verdict.FAILS
    ideal = dict(zip((5, 10, 20, 100), periods.ideal(), strict=True))
    monkeypatch.setattr(periods, "bob_periods", lambda n, _: np.array([0.5, 1.0]) * ideal[n])
    assert outcome("maximum").verdict is Verdict.HOLDS


def test_only_the_first_fraction_has_an_origin_in_the_paper():
    first, *others = (outcome(f"dt-fraction-{table}").numbers["origin"] for table in (1, 2, 3))
    assert first == "The printed value is sum of 2k/135, k = 1..6."
    assert all(text.startswith("No form of the paper's series") for text in others)


def test_uncertainty_of_the_angle_propagates_by_the_derivative_of_the_period():
    angle, spread = 0.3, 1e-4
    slope = angle / 8 + 11 * angle**3 / 768  # of theta^2/16 + 11 theta^4/3072
    expected = slope * spread / (1 + theory.amplitude_correction(angle))
    found = outcome("dt-random", theta0=angle, error=spread).numbers["spread"]
    assert found == pytest.approx(expected, rel=2e-3)


def test_the_audit_of_the_tables_of_periods():
    assert finding("t-digits").verdict is Verdict.HOLDS
    assert finding("t0-digits").verdict is Verdict.SLIP
    assert "1.3958 (neither)" in finding("dt-table-1").ours
    assert "neither" not in finding("dt-table-2").ours
    assert finding("dt-fraction-1").verdict is Verdict.FAILS
    assert len(periods.digit_rows()) == 16


def test_figures_show_the_mean_over_the_bobs_with_the_papers_bars():
    data = series(5)
    assert data.measured.shape == (3, 5)
    assert data.measured[:, 0] == pytest.approx(theory.pendulum_period(data.starts), abs=1e-4)
    assert data.bars == pytest.approx(0.41731 * 2 * np.pi * np.sqrt(data.counts / 9.8), rel=1e-4)
    assert data.outside(0.0) == 15
    assert data.outside(1.0) == 0


def test_neighbours_of_three_pendulums_from_45_degrees_part_no_faster_than_time():
    data = figure2(duration=60.0)
    assert np.all(np.diff(data.growth) >= 0.0)
    assert data.exponent == pytest.approx(1.0, abs=0.3)
    assert data.motion.positions()[0, -1] == pytest.approx([np.sqrt(0.5), -np.sqrt(0.5)])


def test_one_pendulum_has_the_same_period_by_link_and_bob_and_half_of_it_by_height():
    found = outcome("pseudo-complete", n=1, theta0=0.5).numbers
    period = float(theory.pendulum_period(0.5))
    assert found == pytest.approx({"link": period, "bob": period, "height": period / 2})


def test_ten_seconds_are_too_short_for_a_hundred_bobs():
    shown = outcome("window").numbers["completed"]
    assert shown == ["5 of 5", "10 of 10", "20 of 20", "21 of 100"]


def test_the_audit_of_the_procedure():
    assert finding("figure-2").verdict is Verdict.UNDECIDABLE
    assert finding("sigma").verdict is Verdict.FAILS
    assert finding("one-point", n_values=(5, 10)).verdict is Verdict.FAILS
    assert finding("central-mean", n=10).ours.startswith("below T0 in every trial for 9 of 10")
    assert finding("listing-4").ours.startswith("1 of its lines")
