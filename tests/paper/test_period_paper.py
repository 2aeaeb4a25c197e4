"""The paper on the released chain: its numbers, and that it can be set."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from scripts import run_script

from npend_gym import Chain, theory
from npend_gym.experiments.release import PAPER_N
from paper import hesitation
from paper.com_law import LawGrid
from paper.period import compute, limits, rope
from paper.readings import AMPLITUDES, ERRORS, HALF_DIGIT, all_readings, error
from paper.third_order import amplitude_growth

FOLDER = Path(compute.__file__).parent

QUICK = (
    "com-limit", "com-small", "factor", "slowest-factor", "slowest-next-order", "front-before",
    "front-core", "front-passages", "front-small", "front-smooth", "front-tip", "growth",
    "growth-range", "heavy-tip", "modes", "modes-last", "other-starts", "rope", "source-error",
    "series", "swing-bound",
)  # fmt: skip


def kept():
    return json.loads((FOLDER / "numbers.json").read_text(encoding="utf-8"))


def test_the_paper_names_numbers_that_are_kept_and_can_be_computed():
    text = "".join(path.read_text(encoding="utf-8") for path in FOLDER.glob("*.typ"))
    named = set(re.findall(r"#?\bn\.([a-z-]+[a-z])", text))
    assert named
    assert named <= set(kept())
    assert set(kept()) == set(compute.NUMBERS)
    assert set(re.findall(r'#cmd\("([a-z-]+)"\)', text)) <= set(compute.NUMBERS)


@pytest.mark.long
@pytest.mark.parametrize("key", QUICK)
def test_kept_numbers_are_those_that_are_computed_now(key):
    assert compute.NUMBERS[key](True) == kept()[key]


@pytest.mark.long
@pytest.mark.parametrize(
    "key", sorted(set(compute.NUMBERS) - {*QUICK, "early", "law-errors", "tables"})
)
def test_costly_kept_numbers_are_those_that_are_computed_now(key):
    assert compute.NUMBERS[key](False) == kept()[key]


@pytest.mark.long
def test_errors_of_the_law_are_those_that_are_computed_now():
    """Up to 20 rods. `python -m paper.period.compute law-errors` checks all: half a minute."""
    found = compute.NUMBERS["law-errors"](True)
    assert found == kept()["law-errors"][: len(found)]


@pytest.mark.long
def test_early_bobs_are_those_that_are_computed_now():
    """Up to 400 rods. `python -m paper.period.compute early` checks all: minutes, for 3200."""
    for n, *values in kept()["early"][:5]:
        (row,) = hesitation.hesitation_rows((int(n),), (compute.QUARTER,))
        form = {"share": ".3f", "lowest": ".3f", "mean": ".4f", "median": ".4f"}
        assert values == [format(row[name], each) for name, each in form.items()], n


@pytest.mark.long
def test_no_reading_of_the_error_is_nearer_to_the_tables_than_the_one_that_is_kept():
    """A reading that is farther away in one cell of the tables is not tried in the others."""
    tables, worst = kept()["tables"], dict.fromkeys(all_readings(), 0.0)
    assert tables["readings"] == str(len(worst))
    for column, n in enumerate(PAPER_N):
        for printed, angle in zip(ERRORS[:, column], AMPLITUDES[:, column], strict=True):
            off = {reading: abs(error(reading, n, angle) - printed) for reading in worst}
            worst = {reading: np.maximum(worst[reading], off[reading]) for reading in worst}
            nearest = float(tables["nearest"]) + HALF_DIGIT
            worst = {reading: each for reading, each in worst.items() if each < nearest}
    assert f"{min(worst.values()):.3f}" == tables["nearest"]
    assert tables["scatter"] == f"{np.ptp(ERRORS, axis=0).max():.3f}"


def test_the_law_meets_the_measured_period_of_two_rods():
    errors = {row[0]: row[1:] for row in kept()["law-errors"]}
    for a in (0.2, 1.0):
        off = abs(compute.com_period(2, a) / compute.law(2, a) - 1.0)
        assert 100.0 * off <= float(errors["2"][0]) + 0.005
    assert all(float(errors[n][0]) <= 0.4 for n in ("2", "3"))
    assert all(float(row[0]) <= 0.2 for n, row in errors.items() if int(n) >= 5)


def test_errors_beyond_one_radian_are_kept_with_the_sign_of_the_audit():
    beyond = {row[0]: row[1:] for row in kept()["law-beyond"]}
    (cell,) = LawGrid([5], [1.2]).measure(5)
    assert f"{100.0 * cell.law_error:+.1f}" == beyond["5"][0]
    assert all(0.0 < float(near) < float(far) for near, far in beyond.values())


def test_growth_is_the_third_orders_and_the_simulations():
    rows = {row[0]: row[1:] for row in kept()["com-growth"]}
    assert all(third == simulated for third, simulated in rows.values())
    assert rows["5"] == [f"{amplitude_growth(Chain.uniform(5)).com:.4f}"] * 2
    assert f"{compute.simulated_growth(5):.4f}" == rows["5"][1]


@pytest.mark.long
def test_random_chains_are_those_of_the_notes():
    page = (FOLDER.parents[1] / "docs" / "notes" / "period_growth.md").read_text("utf-8")
    rows = kept()["other-chains"]
    assert compute.NUMBERS["other-chains"](True) == rows[:2]
    assert all(f"| {' | '.join(row)} |" in page for row in rows)


def test_heavy_links_have_the_constant_of_the_rope():
    page = (FOLDER.parents[1] / "docs" / "notes" / "period_growth.md").read_text("utf-8")
    rows = kept()["links"]
    for n, constant, _ in rows:
        assert f"{limits.links_constant(int(n)):.6f}" == constant
        assert int(n) < 10 or float(constant) == pytest.approx(float(kept()["rope"]), abs=1e-4)
    assert f"{limits.links_error(5, compute.ANGLES):.2f}" == rows[3][2]
    assert all(" | ".join(row[k] for row in rows) in page for k in (0, 1, 2))


@pytest.mark.long
def test_bessel_integrals_have_the_growth_of_long_chains():
    found = {modes: rope.growth(modes) for modes in (10, 40)}
    rows = {int(modes): b for modes, b, _ in kept()["rope-growth"]}
    assert all(f"{b:.5f}" == rows[modes] for modes, b in found.items())
    assert found[40] == pytest.approx(amplitude_growth(Chain.uniform(150)).com, rel=1e-3)


def test_a_mass_at_the_tip_changes_the_growth_as_simulation_says():
    chain = Chain([1.0] * 9 + [4.0], [1.0] * 10)
    limit = float(theory.com_period(chain))
    small, large = ((limits.measured(chain, a) / limit - 1.0) / a**2 for a in (0.02, 0.04))
    assert (4.0 * small - large) / 3.0 == pytest.approx(limits.tip_growth(10, 0.3), abs=2e-4)


def test_the_paper_can_be_set_from_what_is_kept(tmp_path):
    typst = pytest.importorskip("typst")
    typst.compile(FOLDER / "period.typ", output=tmp_path / "paper.pdf")
    assert (tmp_path / "paper.pdf").read_bytes().startswith(b"%PDF")


def test_rates_of_growth_have_a_row_for_each_window(tmp_path):
    out = tmp_path / "growth.csv"
    run_script(FOLDER / "growth.py", out, "2:320", "3:160", cwd=tmp_path)
    rows = [line.split(",") for line in out.read_text(encoding="utf-8").splitlines()[1:]]
    assert [row[:3] for row in rows[::5]] == [["2", "10", "20"], ["3", "5", "10"]]
    assert [row[2] for row in rows[:5]] == ["20", "40", "80", "160", "320"]
    for row in rows:
        mean, error, lowest, highest = map(float, row[3:7])
        assert lowest <= mean <= highest
        assert 0.0 < error < 0.001  # such neighbours have not parted yet
    assert all(abs(float(row[3])) < 0.2 for row in rows)  # it grows with time, no faster


def test_the_paper_says_of_kept_rates_what_they_show():
    table = {}
    for n, _, _, *rates in kept()["growth"]:
        table.setdefault(int(n), []).append([float(one) for one in rates])
    last = {n: rows[-1] for n, rows in table.items()}
    assert abs(last[2][0]) < 2.0 * last[2][4]  # no faster than linear growth
    for n in (3, 4, 5):
        (before, error, *_), (rate, last_error, *_) = table[n][-2:]
        assert abs(rate - before) < 2.0 * (error + last_error)
        assert 10.0 * last[n][4] < rate < 0.003
    for n in (6, 8, 10, 20):
        means = [row[0] for row in table[n]]
        assert means == sorted(means)
        assert means[-1] > 5.0 * means[0]
