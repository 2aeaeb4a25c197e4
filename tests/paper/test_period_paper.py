"""The paper on the released chain: its numbers, and that it can be set."""

import json
import math
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from scripts import run_script

from npend_gym import Chain, theory
from npend_gym.experiments.release import PAPER_N
from paper import hesitation
from paper.com_law import LawGrid
from paper.period import compute, files, limits
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
@pytest.mark.parametrize("key", sorted(set(compute.NUMBERS) - {"early", "law-errors", "tables"}))
def test_kept_numbers_are_those_that_are_computed_now(key):
    assert compute.NUMBERS[key](key in QUICK) == kept()[key]


@pytest.mark.long
def test_errors_of_the_law_are_those_that_are_computed_now():
    """Up to 20 rods. `python -m paper.period.compute law-errors` checks all: half a minute."""
    found = compute.NUMBERS["law-errors"](True)
    assert found == kept()["law-errors"][: len(found)]


@pytest.mark.long
def test_early_bobs_are_those_that_are_computed_now():
    """Up to 400 rods. `python -m paper.period.compute early` checks all: minutes, for 3200."""
    for n, *values in kept()["early"][:5]:
        (row,) = hesitation.hesitation_rows((int(n),), (compute.PAPER_AMPLITUDE,))
        form = {"share": ".3f", "lowest": ".3f", "mean": ".4f", "median": ".4f"}
        assert values == [format(row[name], each) for name, each in form.items()], n


@pytest.mark.nightly
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


def test_the_law_meets_the_measured_periods_as_the_paper_says():
    errors = {int(n): float(error) for n, error, _ in kept()["law-errors"]}
    assert max(errors[2], errors[3]) <= 0.4
    assert all(error <= 0.2 for n, error in errors.items() if n >= 5)


def test_errors_beyond_one_radian_are_kept_with_the_sign_of_the_audit():
    beyond = {row[0]: row[1:] for row in kept()["law-beyond"]}
    (cell,) = LawGrid([5], [1.2]).measure(5)
    assert f"{100.0 * cell.law_error:+.1f}" == beyond["5"][0]
    assert all(0.0 < float(near) < float(far) for near, far in beyond.values())


def test_growth_by_the_third_order_is_that_of_simulations():
    assert all(third == simulated for _, third, simulated in kept()["com-growth"])


def test_random_chains_and_heavy_links_are_those_of_the_notes():
    page = (FOLDER.parents[1] / "docs" / "notes" / "period_growth.md").read_text("utf-8")
    assert all(f"| {' | '.join(row)} |" in page for row in kept()["other-chains"])
    assert all(" | ".join(values) in page for values in zip(*kept()["links"], strict=True))


def test_heavy_links_have_the_constant_of_the_rope():
    constants = [float(constant) for n, constant, _ in kept()["links"] if int(n) >= 10]
    assert constants == pytest.approx([float(kept()["rope"])] * 4, abs=1e-4)


@pytest.mark.long
def test_bessel_integrals_have_the_growth_of_long_chains():
    (kept_growth,) = [float(b) for modes, b, _ in kept()["rope-growth"] if modes == "40"]
    assert kept_growth == pytest.approx(amplitude_growth(Chain.uniform(150)).com, rel=1e-3)


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


def test_an_interrupted_script_leaves_its_table_and_an_empty_one_is_refused(tmp_path, monkeypatch):
    def stopped(n, _seconds):
        yield {"n": n}
        raise KeyboardInterrupt

    out = tmp_path / "growth.csv"
    out.write_text("n\n5\n")
    monkeypatch.setattr(sys, "argv", ["growth", str(out), "2:10"])
    with pytest.raises(SystemExit, match="130"):
        files.write_rows("", out, (), stopped, "SECONDS")
    assert files.read_rows(out) == [{"n": "5"}]
    out.write_text("n\n")
    for module, key in (("growth", "growth"), ("modes", "modes")):
        monkeypatch.setattr(f"paper.period.{module}.FILE", out)
        with pytest.raises(ValueError, match="has no rows"):
            compute.NUMBERS[key](True)


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("growth --help", 0), ("growth 2:640", 2), ("modes x.csv 2:a", 2), ("front x.csv 2:0.4", 2),
        ("growth_map x.csv 0:1", 2), ("figures nope", 2), ("build --help", 0),
    ],
)  # fmt: skip
def test_scripts_help_and_refuse_bad_arguments_before_they_write(line, code, tmp_path):
    script, *arguments = line.split()
    with pytest.raises(SystemExit, match=str(code)):
        run_script(FOLDER / f"{script}.py", *arguments, cwd=tmp_path)
    assert not list(tmp_path.iterdir())


def test_other_starts_have_the_greatest_angle_that_is_said():
    assert all(shape.max() == 1.0 for shape in limits.starts().values())


def test_the_paper_says_of_kept_rates_what_they_show():
    table = {}
    for n, _, _, *rates in kept()["growth"]:
        table.setdefault(int(n), []).append([float(one) for one in rates])
    last = {n: rows[-1] for n, rows in table.items()}
    two = [map(float, row[1:4]) for row in kept()["growth"] if row[0] == "2"]
    grown = sum((end - start) * rate for start, end, rate in two)
    assert grown < len(two) * math.log(2.0)  # no faster than linear growth, ln 2 in a window
    assert "Over the whole run two rods" in (FOLDER / "long_times.typ").read_text("utf-8")
    for n in (3, 4, 5):
        (before, error, *_), (rate, last_error, *_) = table[n][-2:]
        assert abs(rate - before) < 2.0 * (error + last_error)
        assert 10.0 * last[n][4] < rate < 0.003
    for n in (6, 8, 10, 20):
        means = [row[0] for row in table[n]]
        assert means == sorted(means)
        assert means[-1] > 5.0 * means[0]
