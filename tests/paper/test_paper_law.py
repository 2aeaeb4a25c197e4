import numpy as np
import pytest

from npend_gym import Chain, pseudo_periods, theory
from paper.findings import finding
from paper.law import (
    Scan,
    count_exponent,
    fit_law,
    scan,
)
from paper.registry import Verdict

COUNTS, ANGLES = (2, 10, 20, 50), (0.01, 0.3, np.pi / 4, 1.0, 1.2)


def test_a_scan_holds_the_statistics_of_the_bobs():
    data = scan((3,), (0.2, 0.9))
    found = pseudo_periods(Chain.uniform(3), 0.9) / theory.fundamental_period(Chain.uniform(3))
    assert data.mean[1, 0] == pytest.approx(found.mean(), abs=1e-6)
    assert data.median[1, 0] == pytest.approx(np.median(found), abs=1e-6)
    assert data.tip[1, 0] == pytest.approx(found[-1], abs=1e-6)
    assert data.completed.tolist() == [[1.0], [1.0]]


def synthetic(median):
    counts = np.array([10, 20, 50, 100])
    fundamental = np.array([theory.fundamental_period(Chain.uniform(int(n))) for n in counts])
    angles = np.linspace(0.1, 1.2, len(median))
    cells = [np.asarray(median, float)] * 4
    return Scan(counts, angles, *cells, fundamental)


def test_the_fit_finds_a_planted_law():
    angle = np.linspace(0.1, 1.2, 8)[:, None]
    limit = theory.release_profile(0.5)
    planted = limit * (1 + 0.3 * angle**2 / (1 + 0.5 * angle**2)) * np.ones(4)
    found = fit_law(synthetic(planted))
    assert found.b.value == pytest.approx(0.3, abs=1e-6)
    assert found.d.value == pytest.approx(0.5, abs=1e-6)
    assert np.abs(found.residuals).max() < 1e-7


def test_the_slowest_mode_has_the_square_root_of_n_and_a_half():
    found = count_exponent(synthetic(np.ones((3, 4))), "median", 0)
    assert found.value == pytest.approx(0.5, abs=2e-4)


def test_the_measured_law_is_neither_the_papers_nor_the_pendulums():
    options = {"n_values": COUNTS[1:], "amplitudes": ANGLES, "n": COUNTS[-1]}
    assert finding("sqrt-scaling", **options).verdict is Verdict.HOLDS
    factor = finding("factor", **options)
    assert factor.verdict is Verdict.FAILS
    assert "2 pi x 0.8317" in factor.ours
    for key in ("period-law", "coincidence", "which-average", "readings", "small-angles"):
        assert finding(key, **options).verdict is Verdict.FAILS, key


def test_the_law_meets_what_was_measured_from_ten_bobs_up():
    found = fit_law(scan(COUNTS, ANGLES))
    assert np.abs(found.residuals).max() < 0.005
    assert abs(found.b.value - 1 / 16) > 5 * found.b.error
    # at an angle and a chain that the fit has not seen
    chain = Chain.uniform(30)
    measured = np.median(pseudo_periods(chain, 0.5)) / theory.fundamental_period(chain)
    assert float(found.ratio(np.array(0.5))) == pytest.approx(measured, rel=0.005)
