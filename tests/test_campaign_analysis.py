"""`npend analyse`: planted laws are found, planted outliers are listed, everything is escaped."""

import csv
import errno
import json
import re
import signal
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from campaign_tables import completed, read_table
from disks import FaultyDisk
from scripts import run_script

from npend_gym import Cart, Chain, _files, theory
from npend_gym.cli import main
from npend_gym.experiments import Campaign, CampaignPlan, analyse
from npend_gym.report import campaign_report as report
from npend_gym.report import player

EXAMPLE = Path(__file__).parent.parent / "examples" / "passive_campaign.py"
AMPLITUDES = [0.05, 0.3, 0.6, 0.9, 1.1]


def planted(chain, theta, **_options):
    """Periods that follow a law exactly: c = 0.95, b = 0.2, d = 1, over T1 = sqrt(n + 1/2)."""
    a2 = theta[:, :1] ** 2
    periods = 0.95 * np.sqrt(chain.n + 0.5) * (1.0 + 0.2 * a2 / (1.0 + a2))
    return np.repeat(periods, chain.n, axis=1)


def analysed(plan, out, monkeypatch, measure):
    monkeypatch.setattr("npend_gym.experiments.studies.release_tables.pseudo_periods", measure)
    monkeypatch.setattr("npend_gym.theory.fundamental_period", lambda chain: np.sqrt(chain.n + 0.5))
    completed(plan, out)
    return analyse(out)


def test_a_planted_law_is_found_with_all_its_numbers(tmp_path, monkeypatch):
    plan = CampaignPlan(n=[10, 20, 40], amplitude=AMPLITUDES, spread=0.0, trials=1)
    (group,) = analysed(plan, tmp_path, monkeypatch, planted).groups
    assert [law.n_values for law in group.laws] == [(10, 20, 40), (10,), (20,), (40,)]
    for law in group.laws:
        found = [law.c.value, law.b.value, law.d.value]
        np.testing.assert_allclose(found, [0.95, 0.2, 1.0], rtol=1e-6)
        assert np.abs(law.residuals).max() < 1e-9
    assert len(group.powers) == len(AMPLITUDES)
    for exponent in group.powers:
        assert exponent.p.value == pytest.approx(0.5, abs=1e-12)


def test_intervals_hold_the_planted_numbers_of_scattered_data(tmp_path, monkeypatch):
    def noisy(chain, theta, **options):
        rng = np.random.default_rng([chain.n, int(1e9 * theta[0, 0])])
        return planted(chain, theta, **options) * (1.0 + 1e-3 * rng.normal())

    plan = CampaignPlan(n=[10, 15, 20, 30, 40], amplitude=AMPLITUDES, spread=0.0, trials=1, batch=1)
    (group,) = analysed(plan, tmp_path, monkeypatch, noisy).groups
    law = group.laws[0]
    for estimate, truth in ((law.c, 0.95), (law.b, 0.2), (law.d, 1.0)):
        assert estimate.error > 0.0
        assert abs(estimate.value - truth) < 2.0 * estimate.error
    assert 3e-4 < law.residuals.std() < 3e-3


def test_cells_whose_median_is_unknown_are_left_out_of_the_fits(tmp_path, monkeypatch):
    def unfinished(chain, theta, **options):
        periods = planted(chain, theta, **options) * np.linspace(0.5, 1.5, chain.n)
        slow = np.linspace(0.0, 1.0, chain.n) > (0.62 if chain.n < 50 else 0.47)
        return np.where(slow, np.nan, periods)

    plan = CampaignPlan(n=[11, 21, 41, 81], amplitude=AMPLITUDES[:1], spread=0.0, trials=2)
    result = analysed(plan, tmp_path, monkeypatch, unfinished)
    (group,) = result.groups
    (power,) = group.powers
    assert [point.n for point in power.points] == [11, 21, 41]
    assert power.p.value == pytest.approx(0.5, abs=1e-12)
    text, page = report.analysis_text(result), report.page(result, report.tables(result), [])
    for shown in ("166 of 308 bobs completed", "fits leave out 1 of 4 cells", "longer --duration"):
        assert shown in text
        assert shown in page


def test_analyses_name_the_groups_and_fits_that_they_do_not_draw(tmp_path, monkeypatch):
    from npend_gym.report import campaign_figures as draw

    masses = [1.0 + k for k in range(13)]
    angles = np.linspace(0.1, 1.1, 11).tolist()
    plan = CampaignPlan(n=[2, 3, 4], masses=masses, amplitude=angles, spread=0.0, trials=1)
    result = analysed(plan, tmp_path, monkeypatch, planted)
    for text in (report.analysis_text(result), report.page(result, report.tables(result), [])):
        assert "figures of the first 12 of 13 groups" in text
    assert draw.law_against_n(result.groups[0]).axes[0].get_title().endswith("9 of 11 fits drawn")


def test_small_residuals_have_two_significant_digits(tmp_path, monkeypatch):
    from npend_gym.report import campaign_figures as draw

    def bent(chain, theta, **options):
        return planted(chain, theta, **options) * (1.0 + 1e-5 * np.sin(40.0 * theta[:, :1]))

    plan = CampaignPlan(n=10, amplitude=AMPLITUDES, spread=0.0, trials=1)
    result = analysed(plan, tmp_path, monkeypatch, bent)
    assert re.search(r"residuals up to 0\.000\d\d%", report.analysis_text(result))
    figure = draw.law_against_amplitude(result.groups[0])
    figure.canvas.draw()
    labels = [label.get_text() for label in figure.axes[1].get_yticklabels()]
    assert len(set(labels)) == len(labels)


def test_planted_outliers_are_listed_and_nothing_else(tmp_path, monkeypatch):
    def jumping(chain, theta, **options):
        periods = planted(chain, theta, **options)
        if 0.3 <= theta[0, 0] < 0.33:
            periods[123] *= 1.01
        return periods

    plan = CampaignPlan(n=3, amplitude=[0.1, 0.3], trials=1000, batch=1000)
    stats = analysed(plan, tmp_path, monkeypatch, jumping).statistics
    assert stats.outlier_count == 1
    (outlier,) = stats.outliers
    assert (outlier.cell, outlier.trial) == (1, 124)
    assert outlier.median_s / outlier.expected_s == pytest.approx(1.01, rel=1e-3)
    assert stats.histogram.sum() == 2000


def test_statistics_are_those_of_the_whole_table(tmp_path):
    from npend_gym.experiments.studies.release_plan import RELEASES

    plan = CampaignPlan(n=[2, 3], amplitude=[0.3, 0.7], trials=60, batch=13)
    completed(plan, tmp_path)
    table = read_table(tmp_path, RELEASES, list(plan.tasks())).to_pydict()
    stats = analyse(tmp_path).statistics
    for cell in range(4):
        rows = np.array(table["cell"]) == cell
        medians, starts = np.array(table["median_s"])[rows], np.array(table["start_rad"])[rows]
        assert stats.releases[cell] == 60
        assert stats.median[cell] == pytest.approx(medians.mean(), rel=1e-14)
        assert stats.start[cell] == pytest.approx(starts.mean(), rel=1e-14)
        fit = np.polynomial.Polynomial.fit(starts, medians, 2)
        scatter = np.sqrt(np.sum((medians - fit(starts)) ** 2) / 57)
        assert stats.scatter[cell] == pytest.approx(scatter, rel=1e-3)


def test_a_cell_starts_where_its_releases_that_completed_do(tmp_path):
    plan = CampaignPlan(n=1, amplitude=0.7, spread=0.3, trials=100, duration=2.09, batch=2)
    completed(plan, tmp_path)
    stats = analyse(tmp_path).statistics  # does not warn of batches in which none completed
    assert 20 <= stats.completed[0] < 50
    expected = float(theory.pendulum_period(stats.start[0]))
    assert stats.median[0] == pytest.approx(expected, rel=1e-4)


def test_what_an_earlier_analysis_left_is_removed_and_the_campaign_is_kept(tmp_path, monkeypatch):
    result = analysed(CampaignPlan(n=[5], trials=3), tmp_path, monkeypatch, planted)
    with pytest.raises(ValueError, match="out must be another folder than the campaign's"):
        report.write_analysis(result, tmp_path / "analysis" / "..", figures=False)
    assert not (tmp_path / "manifest.json").exists()
    out = tmp_path / "analysis"
    out.mkdir()
    for name in ("fits", "residuals", "outliers", "failures", "mine"):
        (out / f"{name}.csv").touch()
    for name in ("law_against_n_3", "law_against_amplitude_0", "residuals"):
        (out / f"{name}.png").touch()
    report.write_analysis(result, out, figures=False)
    names = {path.name for path in out.iterdir()}
    assert names == {"cells.csv", "mine.csv", "report.html", "manifest.json"}


def test_ctrl_c_while_an_analysis_is_written_acts_once_it_is(tmp_path, monkeypatch, capsys):
    def pressed(*arguments, **named):
        signal.raise_signal(signal.SIGINT)
        return player.write(*arguments, **named)

    analysed(CampaignPlan(n=[5], trials=3), tmp_path, monkeypatch, planted)
    monkeypatch.setattr(report, "player", SimpleNamespace(**vars(player) | {"write": pressed}))
    assert main(["analyse", str(tmp_path)]) == 130
    out, error = capsys.readouterr()
    assert "report.html" in out
    assert error.endswith("npend analyse: interrupted\n")
    manifest = json.loads((tmp_path / "analysis" / "manifest.json").read_text())
    assert "report.html" in manifest["sha256"]


def test_a_full_disk_keeps_an_older_analysis_whole_or_removes_its_manifest(tmp_path, monkeypatch):
    result = analysed(CampaignPlan(n=[5], trials=3), tmp_path, monkeypatch, planted)
    out, disk = tmp_path / "analysis", FaultyDisk()
    monkeypatch.setattr(_files, "disk", disk)
    report.write_analysis(result, out, figures=False)
    before = (out / "manifest.json").read_bytes()
    first, second, *_ = [k for k, name in enumerate(disk.done) if name == "open"]
    for fatal, kept in ((first, True), (second + 1, False)):  # the old manifest is removed between
        monkeypatch.setattr(_files, "disk", FaultyDisk(fatal, code=errno.ENOSPC))
        with pytest.raises(OSError, match="No space left"):
            report.write_analysis(result, out, figures=False)
        assert [path.read_bytes() for path in out.glob("manifest.json")] == [before] * kept


def test_the_report_escapes_what_comes_from_files_and_user(tmp_path, monkeypatch):
    def failing(chain, theta, **options):
        if chain.n == 3:
            raise ArithmeticError("<script>alert(1)</script>")
        return planted(chain, theta, **options)

    out = tmp_path / "<b>&amp;'\"ä"
    result = analysed(CampaignPlan(n=[2, 3], trials=2), out, monkeypatch, failing)
    page = report.page(result, report.tables(result), [])
    assert "<script" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page
    assert "<b>" not in page
    assert "&lt;b&gt;&amp;amp;" in page


@pytest.mark.long
def test_the_command_writes_tables_figures_and_a_page(tmp_path, monkeypatch, capsys):
    plan = CampaignPlan(n=[10, 20, 40], amplitude=AMPLITUDES, trials=30)
    analysed(plan, tmp_path, monkeypatch, planted)
    assert main(["analyse", str(tmp_path)]) == 0
    assert "c = 0.9500" in capsys.readouterr().out
    names = {path.name for path in (tmp_path / "analysis").iterdir()}
    assert names == {
        "cells.csv", "fits.csv", "residuals.csv", "law_against_n_0.png",
        "law_against_amplitude_0.png", "residuals.png", "report.html", "manifest.json",
    }  # fmt: skip
    with (tmp_path / "analysis" / "fits.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 5 + 4 * 3
    page = (tmp_path / "analysis" / "report.html").read_text()
    assert len(re.findall("<img", page)) == 3
    assert len(re.findall("data:image/png;base64,iVBOR", page)) == 3


def test_for_a_single_cell_no_law_is_fitted_and_the_report_says_so(tmp_path, monkeypatch):
    result = analysed(CampaignPlan(n=[5], trials=3), tmp_path, monkeypatch, planted)
    assert result.groups[0].laws == result.groups[0].powers == ()
    assert "No law is fitted" in report.page(result, report.tables(result), [])


def test_a_campaign_without_finished_tasks_is_not_analysed(tmp_path):
    with (
        Campaign(CampaignPlan(n=[2]), tmp_path),
        pytest.raises(ValueError, match="nothing is done yet"),
    ):
        analyse(tmp_path)


@pytest.mark.long
def test_the_example_runs_and_analyses_a_campaign(tmp_path, monkeypatch):
    monkeypatch.setenv("LOKY_MAX_CPU_COUNT", "1")  # no worker processes
    shown = run_script(EXAMPLE, tmp_path / "out", 2, cwd=tmp_path)
    assert "48 of 48 releases" in shown
    found = re.search(r"N = 10 20: c = (\S+) \+- (\S+) \(exact (\S+)\)", shown)
    value, error, exact = map(float, found.groups())
    assert abs(value - exact) < 3.0 * error
    assert (tmp_path / "out" / "analysis" / "report.html").stat().st_size > 10_000


def test_the_exact_value_beside_a_fit_to_several_chains_is_the_mean_of_theirs(tmp_path):
    amplitudes = [0.02, 0.04, 0.06, 0.08]
    plan = CampaignPlan(n=[10, 14], amplitude=amplitudes, spread=0.0, trials=1)
    completed(plan, tmp_path)
    (group,) = analyse(tmp_path).groups
    together, *alone = group.laws
    assert together.exact == pytest.approx(np.mean([law.exact for law in alone]))
    assert together.c.value == pytest.approx(together.exact, rel=1e-4)


def test_cells_without_gravity_are_no_reason_for_a_longer_duration(tmp_path):
    completed(CampaignPlan(n=[2], gravity=[0.0, 9.81], trials=1), tmp_path)
    shown = report.analysis_text(analyse(tmp_path))
    assert "fits leave out 1 of 2 cells: nothing moves without gravity" in shown
    assert "--duration" not in shown


@pytest.mark.parametrize(
    "parts",
    [
        {"base": Cart(1.0)},
        pytest.param({"stiffness": 1e3}, marks=pytest.mark.long),
        {"centres": [0.5, 0.0], "inertias": 0.1},
    ],
    ids=["cart", "springs", "balanced link"],
)
def test_cells_that_have_no_slowest_mode_are_no_reason_for_more_cells(parts, tmp_path):
    chain = Chain([1.0, 1.0], [1.0, 1.0], **parts)
    plan = CampaignPlan(chain=chain, amplitude=[0.1, 0.2], trials=1, duration=30.0)
    completed(plan, tmp_path)
    result = analyse(tmp_path)
    shown = report.page(result, report.tables(result), [])
    assert "fits leave out 2 of 2 cells: the period of the slowest mode is known only" in shown
    assert "No law is fitted" not in shown


def test_the_fitted_limit_of_the_centre_of_mass_is_the_exact_one(tmp_path):
    plan = CampaignPlan(n=[2, 12, 24], amplitude=AMPLITUDES, spread=0.0, trials=1, definition="com")
    completed(plan, tmp_path)
    (group,) = analyse(tmp_path).groups
    assert [law.n_values for law in group.laws] == [(12, 24), (2,), (12,), (24,)]
    for law in group.laws:  # the formula with b and d fits the angles to some 4e-4
        assert law.c.value == pytest.approx(law.exact, rel=6e-4)
