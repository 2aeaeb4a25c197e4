import csv
import json

import numpy as np
import pytest

from npend_gym import Chain, pseudo_periods, theory
from paper.__main__ import main
from paper.com_law import LawGrid, limit_rows
from paper.hesitation import EARLY
from paper.swings import reversals
from paper.third_order import amplitude_growth


@pytest.mark.long
def test_the_law_holds_to_what_is_promised():
    grid = LawGrid((2, 3, 5, 20), (0.1, 0.4, 0.75, 0.9, 1.0))
    for n in grid.n_values:
        for cell in grid.measure(n):
            assert abs(cell.law_error) < (0.004 if n < 5 else 0.002)
            expected = pseudo_periods(Chain.uniform(n), cell.amplitude, definition="com")[0]
            assert cell.com == pytest.approx(expected, rel=1e-8)
            expected = pseudo_periods(Chain.uniform(n), cell.amplitude) / cell.fundamental
            assert cell.mean == pytest.approx(expected.mean(), rel=1e-7)
            assert cell.early == pytest.approx(np.mean(expected < EARLY))


@pytest.mark.nightly
@pytest.mark.long
def test_the_law_holds_for_long_chains():
    grid = LawGrid((50, 200), np.linspace(0.1, 1.0, 4))
    errors = [cell.law_error for n in grid.n_values for cell in grid.measure(n)]
    assert np.abs(errors).max() < 0.0021


def test_the_command_prints_and_writes_the_same_table(tmp_path, capsys):
    law = ["--only", "com-law", "--amplitudes", "0.3,1"]
    assert main([*law, "--n", "2,5", "--out", str(tmp_path), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    with (tmp_path / "com-law" / "law.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["n"], row["amplitude_rad"]) for row in printed["law"]] == [
        (2, 0.3), (2, 1.0), (5, 0.3), (5, 1.0)
    ]  # fmt: skip
    for row, again in zip(rows, printed["law"], strict=True):
        assert {name: float(value) for name, value in row.items()} == again
        assert again["law_error"] == again["law_s"] / again["com_s"] - 1.0
    assert main([*law, "--n", "2,4"]) == 0
    text = capsys.readouterr().out
    assert "largest error up to 1 rad, N = 2, 4: 0.39" in text
    assert f"before {EARLY} T1" in text


@pytest.mark.parametrize(
    ("n_values", "amplitudes", "error", "message"),
    [
        (20, 0.1, TypeError, "n_values must be a list such as"),
        ([], 0.1, ValueError, "n_values must hold at least one number"),
        ([5], [], ValueError, "amplitudes must hold at least one number"),
    ],
)
def test_a_grid_holds_numbers_and_becomes_json(n_values, amplitudes, error, message):
    with pytest.raises(error, match=message):
        LawGrid(n_values, amplitudes)
    plain = json.dumps(LawGrid(np.array([2, 5]), 0.3).as_dict())
    assert plain == '{"n_values": [2, 5], "amplitudes": [0.3]}'


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        (0.0, "shape must give the chain a momentum"),
        ([np.nan] * 2, "shape must be finite"),
        ([1.0, 1.0, 1.0], "shape must be one number or an array of shape"),
    ],
)
def test_a_start_that_cannot_be_released_is_refused(shape, message):
    with pytest.raises(ValueError, match=message):
        amplitude_growth(Chain.uniform(2), shape)
    with pytest.raises(ValueError, match="must reverse 2 times, got 0"):
        reversals(np.ones(1), np.zeros(1), 2)


@pytest.mark.parametrize(
    "chain",
    [
        Chain.uniform(1), Chain.uniform(4), Chain([1.0, 0.5, 2.0], [1.0, 0.3, 0.7]),
        pytest.param(Chain.rods([1.0, 0.5], [0.5, 0.8]), marks=pytest.mark.long, id="links"),
    ],
)  # fmt: skip
def test_periods_begin_to_grow_as_the_third_order_says(chain):
    angles = np.array([0.02, 0.04])
    starts = np.repeat(angles[:, None], chain.n, axis=1)
    measured = pseudo_periods(chain, starts, definition="com", rtol=1e-12)[:, 0]
    b = (measured / theory.com_period(chain) - 1.0) / angles**2
    growth = amplitude_growth(chain)
    assert growth.com == pytest.approx((4.0 * b[0] - b[1]) / 3.0, abs=2e-5)


def test_small_angles_have_a_row_for_every_chain():
    rows = limit_rows([10, 500])
    assert rows[0]["t1_error_two_terms"] == pytest.approx(2.8e-7, abs=2e-8)
    assert rows[0]["com_growth"] == amplitude_growth(Chain.uniform(10)).com
    assert np.isnan(rows[1]["com_growth"])
    with pytest.raises(ValueError, match="n must be between 1 and 400"):
        amplitude_growth(Chain.uniform(500))
    with pytest.raises(ValueError, match="chain must hang straight"):
        amplitude_growth(Chain.uniform(2, gravity=0.0))
    with pytest.raises(ValueError, match="rigid rods on a pivot at rest"):
        amplitude_growth(Chain.uniform(2, stiffness=1e3))
