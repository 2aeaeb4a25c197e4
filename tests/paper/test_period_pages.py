"""The numbers of the pages on the released chain, against files and what is computed."""

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from npend_gym import Chain, pseudo_periods, theory
from paper.com_law import LawGrid
from paper.hesitation import heights
from paper.third_order import amplitude_growth

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "explanation" / "pseudo_period.md").read_text(encoding="utf-8")
NOTES = (DOCS / "notes" / "period_growth.md").read_text(encoding="utf-8")


def table(text, head):
    """Return the cells of the table of a page whose first line begins with `head`."""
    lines = text[text.index(head) :].split("\n\n")[0].splitlines()
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def kept_law():
    with (DOCS / "results" / "law.csv").open(newline="", encoding="utf-8") as file:
        return {(int(row["n"]), float(row["amplitude_rad"])): row for row in csv.DictReader(file)}


def test_the_table_of_errors_is_that_of_the_kept_file():
    head, _, *rows = table(NOTES, "| a [rad] |")
    counts = [int(name.removeprefix("N = ")) for name in head[1:]]
    law = kept_law()
    for angle, *shown in rows:
        a = next(a for _, a in law if abs(a - float(angle)) < 1e-4)
        errors = [100.0 * float(law[n, a]["law_error"]) for n in counts]
        assert [f"{one:+.2f}" for one in errors] == shown


def test_the_kept_file_is_what_is_measured_now():
    law = kept_law()
    for cell in LawGrid([3, 20], [0.5, 1.2]).measure(3):
        assert cell.law_error == pytest.approx(float(law[3, cell.amplitude]["law_error"]), rel=1e-4)


def test_the_third_order_has_the_growth_of_the_notes():
    head, _, row = table(NOTES, "| N | 1 | 2 | 3 |")
    for n, shown in list(zip(head, row, strict=True))[1:-1]:  # 200 rods take a second
        assert f"{16.0 * amplitude_growth(Chain.uniform(int(n))).com:.4f}" == f"{float(shown):.4f}"
    found = amplitude_growth(Chain.uniform(100))
    assert [f"{one:.4f}" for one in (found.shape, found.inertia)] == ["0.0715", "0.0101"]
    assert "0.0715" in NOTES
    assert "0.0101" in NOTES


@pytest.mark.long
def test_the_limits_of_small_angles_are_those_of_the_notes():
    slowest = {n: theory.fundamental_period(Chain.uniform(n)) for n in (2, 3, 5, 10, 100)}
    errors = [
        f"{abs(theory.large_n_period(n, terms=k) / slowest[n] - 1.0):.1e}"
        for k in (1, 2)
        for n in (5, 10, 100)
    ]
    shown = re.search(
        r"at N = 5, 10 and 100 is (.*?) without the bracket, and (.*?) with", NOTES, re.DOTALL
    )
    given = re.findall(r"[\d.]+e-\d+", " ".join(shown.groups()))
    assert [f"{float(one):.1e}" for one in given] == errors
    nodes, weights = np.polynomial.legendre.leggauss(128)
    tip, middle, pivot = theory.release_profile([0.0, 0.5, 1.0])
    mean = weights @ theory.release_profile((nodes + 1.0) / 2.0) / 2.0
    for value in (tip, middle, pivot, mean):
        assert f"{value:.6f}" in NOTES
    ratios = [float(theory.com_period(n)) / period for n, period in slowest.items()]
    assert all(f"{ratio:.6f}" in NOTES for ratio in ratios)


@pytest.mark.long
@pytest.mark.parametrize("n", [20, 100, pytest.param(1000, marks=pytest.mark.nightly)])
def test_differences_from_the_profile_are_those_of_the_notes(n):
    chain = Chain.uniform(n)
    ratio = theory.small_angle_periods(chain) / theory.fundamental_period(chain)
    early = ratio < 0.8
    off = np.abs(ratio - theory.release_profile(heights(n)))[~early]
    rms, most, worst = np.sqrt(np.mean(off**2)), np.quantile(off, 0.95), off.max()
    shown = next(row for row in table(NOTES, "| N | root mean square") if row[0] == str(n))
    assert [float(f"{one:.1e}") for one in (rms, most, worst)] == [float(x) for x in shown[1:4]]
    assert str(early.sum()) == shown[4]


def test_the_seconds_of_the_page_are_measured():
    for n, shown in ((100, "17.2 s"), (1, "2.09 s")):
        period = pseudo_periods(Chain.uniform(n), np.pi / 4, definition="com", rtol=1e-8)[0]
        assert f"{period:.3g} s" == shown
        assert shown in PAGE
