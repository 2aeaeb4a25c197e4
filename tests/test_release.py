import csv
import hashlib
import json
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy.special import ellipk

from npend_gym import Chain, __version__, _progress, pseudo_periods, theory
from npend_gym.chain import STANDARD_GRAVITY
from npend_gym.cli import main
from npend_gym.experiments import (
    ReleaseExperiment,
    bob_rows,
    power_law,
    release,
    run_release,
    starts,
    summary_rows,
)
from npend_gym.report import release_tables as report
from npend_gym.report.outputs import prepare_folder

SMALL = ReleaseExperiment(n_values=(2, 5), trials=2, seed=7)


@pytest.fixture(scope="module")
def runs():
    return run_release(SMALL)


def test_every_n_is_released_in_every_trial_from_the_draw_of_that_trial(runs):
    assert [(run.n, run.trial) for run in runs] == [(2, 1), (2, 2), (5, 1), (5, 2)]
    starts = [run.start for run in runs]
    assert starts[:2] == starts[2:]
    assert starts[0] != starts[1]
    assert all(np.pi / 4 <= start < np.pi / 4 + 0.017 for start in starts)


def test_a_run_is_the_pseudo_periods_of_its_chain(runs):
    expected = pseudo_periods(Chain.uniform(5), runs[3].start)
    np.testing.assert_array_equal(runs[3].periods, expected)


def test_a_draw_depends_on_the_seed_plus_the_trial_alone():
    alone = ReleaseExperiment(n_values=(5,), trials=1, seed=7).runs()[0]
    assert alone in SMALL.runs()
    (_, _, start), *_ = ReleaseExperiment(n_values=(3,), trials=1, seed=8).runs()
    assert start == SMALL.runs()[1][2]


def test_the_tidy_table_has_a_row_for_every_bob_and_trial(runs):
    rows = bob_rows(runs)
    assert len(rows) == 2 * (2 + 5)
    assert rows[0] == {
        "n": 2,
        "trial": 1,
        "start_rad": runs[0].start,
        "bob": 1,
        "completed": True,
        "pseudo_period_s": runs[0].periods[0],
        "com_s": pseudo_periods(Chain.uniform(2), runs[0].start, definition="com")[0],
    }


def test_the_summary_compares_the_mean_with_each_model(runs):
    row = summary_rows(SMALL, runs)[1]
    measured = np.mean([run.periods.mean() for run in runs if run.n == 5])
    assert row["measured_s"] == pytest.approx(measured)
    assert (row["completed"], row["bobs"]) == (10, 10)
    chain = Chain.uniform(5)
    assert row["ideal_s"] == theory.ideal_period(chain)
    assert row["fundamental_s"] == theory.fundamental_period(chain)
    assert row["corrected_s"] == pytest.approx(row["ideal_s"] * 1.0400, rel=2e-3)
    of_com = np.mean([run.com for run in runs if run.n == 5])
    assert row["law_error"] == pytest.approx(abs(of_com - row["law_s"]) / of_com)
    assert row["law_error"] < 0.003 < row["fundamental_error"]
    assert row["ideal_error"] == pytest.approx(abs(measured - row["ideal_s"]) / measured)


plans_with_bobs_that_do_not_complete = pytest.mark.parametrize(
    "plan",
    [
        ReleaseExperiment(n_values=(20,), trials=1, duration=5.0),
        ReleaseExperiment(n_values=(2,), trials=1, gravity=0.0),
    ],
    ids=["not yet", "never"],
)


@plans_with_bobs_that_do_not_complete
def test_bobs_that_do_not_complete_are_left_out_of_the_mean(plan):
    (run,) = run_release(plan)
    done = run.periods[np.isfinite(run.periods)]
    assert (done.size > 0) == (plan.gravity > 0.0)
    assert done.size < run.n
    (row,) = summary_rows(plan, [run])
    assert row["completed"] == done.size
    if done.size:
        assert row["measured_s"] == pytest.approx(done.mean())
    text = report.summary_text(plan, [run])
    assert f"{done.size}/{run.n}" in text
    assert "nan" not in text


def test_files_hold_the_measured_values_and_the_manifest_their_provenance(runs, tmp_path):
    written = report.write(SMALL, runs, tmp_path / "a b" / "out", figures=True)
    names = {path.name for path in written}
    assert names == {
        "release.json", "periods.csv", "summary.csv", "period_against_n.png",
        "period_of_each_bob.png", "manifest.json",
    }  # fmt: skip
    folder = tmp_path / "a b" / "out"
    assert {path.name for path in folder.iterdir()} == names
    with (folder / "periods.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    read = [float(row["pseudo_period_s"]) for row in rows]
    np.testing.assert_array_equal(read, np.concatenate([run.periods for run in runs]))
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["provenance"]["version"] == __version__
    assert manifest["provenance"]["arguments"]["seed"] == 7
    assert manifest["provenance"]["arguments"]["n_values"] == [2, 5]
    assert manifest["complete"] is True
    for name, digest in manifest["sha256"].items():
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest


def test_figures_show_every_release(runs):
    from npend_gym.report.release_figures import period_against_n, period_of_each_bob

    (axes,) = period_against_n(SMALL, runs).axes
    drawn = [line.get_ydata() for line in axes.lines if line.get_marker() == "o"]
    assert [run.mean for run in runs] == [y[0] for y in drawn if len(y)]
    titles = [axes.get_title() for axes in period_of_each_bob(SMALL, runs).axes]
    assert titles == ["N = 2: 4 of 4 completed", "N = 5: 10 of 10 completed"]
    plan = ReleaseExperiment(n_values=(3,), trials=4, masses=[1, 2, 3], lengths=[1, 0.5, 0.2])
    several = run_release(plan)
    assert len(period_of_each_bob(plan, several).axes) == 1
    many = ReleaseExperiment(n_values=(2,), trials=20)
    (legend,) = period_of_each_bob(many, run_release(many)).legends
    assert len(legend.get_texts()) == 3
    period_against_n(plan, several)
    short = ReleaseExperiment(n_values=(1, 2), trials=1, lengths=0.02)  # 0.3 to 0.4 s
    (axes,) = period_against_n(short, run_release(short)).axes
    assert len([label for label in axes.get_yticklabels() if label.get_text()]) > 2


@pytest.mark.parametrize("n", [1, 3])
def test_the_figure_of_bobs_shows_legend_dots_and_bobs_whole_for_a_single_n(n):
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from npend_gym.report.release_figures import period_of_each_bob

    plan = ReleaseExperiment(n_values=(n,), trials=3, amplitude=3.0, duration=30.0)
    runs = run_release(plan)
    figure = period_of_each_bob(plan, runs)
    FigureCanvasAgg(figure).draw()
    (legend,), (axes,) = figure.legends, figure.axes
    box = legend.get_window_extent()
    assert figure.bbox.x0 <= box.x0
    assert box.x1 <= figure.bbox.x1
    assert axes.bbox.height > 0.4 * figure.bbox.height
    ticks = axes.get_xticks()
    np.testing.assert_array_equal(ticks, np.round(ticks))
    highest = np.nanmax(np.concatenate([run.periods for run in runs]))
    assert axes.get_ylim()[1] > 1.04 * highest


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"n_values": ()}, ValueError, "n_values must name"),
        ({"n_values": (2, 3, 2)}, ValueError, "n_values must name each number once"),
        ({"n_values": range(1000, -1, -1)}, ValueError, "n must be between 1 and 1000000, got 0"),
        ({"n_values": 5}, TypeError, "n_values must be a list of integers"),
        ({"n_values": {2}}, TypeError, "n_values must be a list of integers"),
        ({"n_values": None}, TypeError, "n_values must be a list of integers"),
        ({"amplitude": 0.0}, ValueError, "amplitude must not be 0"),
        ({"amplitude": 3.14}, ValueError, "must stay within pi"),
        ({"seed": -1}, ValueError, "seed must be between"),
        ({"definition": "x"}, ValueError, "definition must be one of"),
        ({"lengths": [1.0, 2.0]}, ValueError, "lengths must be one number or 5 of them"),
        (
            {"n_values": [2, 3], "masses": [1.0, 2.0]},
            ValueError,
            "masses must be one number or 3 of them for n = 3",
        ),
        ({"damping": [0.1, 0.2]}, TypeError, r"damping must be a real number, got \[0.1, 0.2\]"),
    ],
)
def test_bad_arguments_are_refused_with_their_rule(change, error, message):
    with pytest.raises(error, match=message):
        ReleaseExperiment(**change)


def test_numpy_integers_describe_the_same_experiment_as_integers():
    keywords = {"sensor_interval": 0.01, "sensor_noise": 0.02}
    plain = ReleaseExperiment(n_values=(1, 2), trials=2, seed=255, **keywords)
    given = {"n_values": np.array([1, 2]), "trials": np.int8(2), "seed": np.uint8(255)}
    plan = ReleaseExperiment(**given, **keywords)
    assert plan == plain
    found, expected = (report.summary_json(each, run_release(each)) for each in (plan, plain))
    assert json.loads(found)["summary"] == json.loads(expected)["summary"]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: starts(-1, 0, 3, 0.7, 0.1), r"seed must be at least 0, got -1$"),
        (lambda: starts(0, -1, 3, 0.7, 0.1), "first must be at least 0, got -1"),
        (lambda: starts(0, 0, -3, 0.7, 0.1), "count must be at least 0, got -3"),
        (lambda: power_law([1.0, 1.0], [1.0, 2.0]), "x must hold two different numbers"),
        (lambda: power_law([1.0, 2.0], [-1.0, 2.0]), "y must be greater than zero"),
        (lambda: power_law([1.0, 2.0, 3.0], [1.0, np.nan, 3.0]), "y must be finite"),
        (lambda: power_law([1.0], [1.0]), "x and y must be at least two each"),
        (lambda: power_law([1.0, 2.0], [1.0, 2.0, 3.0]), "x and y must be at least two each"),
    ],
)
def test_draws_and_fits_refuse_arguments_by_name(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_models_are_of_the_releases_that_completed():
    plan = ReleaseExperiment(n_values=[1], amplitude=0.7, spread=0.3, trials=20, duration=2.09)
    (row,) = summary_rows(plan, run_release(plan))
    assert 3 < row["completed"] < 17
    assert row["corrected_error"] < 1e-4


def test_the_spread_of_bobs_is_of_the_releases_in_which_some_completed():
    plan = ReleaseExperiment(n_values=[2], trials=6, duration=2.6, amplitude=0.3, spread=0.6)
    runs = run_release(plan)
    some = [one for run in runs if (one := run.periods[np.isfinite(run.periods)]).size]
    assert len(some) < 6
    (row,) = summary_rows(plan, runs)
    assert row["bob_spread_s"] == pytest.approx(np.mean([one.std() for one in some]))


def test_commands_that_write_into_one_folder_at_once_do_not_fail(tmp_path):
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(prepare_folder, [tmp_path] * 400))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("kind", [list, tuple, np.array])
def test_an_experiment_keeps_masses_of_its_own_and_equals_that_of_its_dict(kind):
    masses = kind([1.0, 2.0])
    experiment = ReleaseExperiment(n_values=[2], masses=masses)
    assert ReleaseExperiment(**experiment.as_dict()) == experiment
    assert hash(experiment) == hash(ReleaseExperiment(n_values=[2], masses=(1.0, 2.0)))
    if kind is not tuple:
        masses[0] = -5.0
    assert experiment.masses == (1.0, 2.0)


def test_an_experiment_with_many_numbers_of_rods_is_described_at_once(monkeypatch):
    made = []
    build = release.released_chain

    def counted(n, *rest):
        made.append(n)
        return build(n, *rest)

    monkeypatch.setattr(release, "released_chain", counted)
    assert len(ReleaseExperiment(n_values=range(100_000, 0, -1)).n_values) == 100_000
    assert len(made) == 1
    ReleaseExperiment(n_values=[2], masses=[1.0, 2.0])
    assert len(made) == 3


@pytest.mark.parametrize("definition", ["bob", "com", "link"])
def test_no_percent_of_error_is_half_a_swing_beyond_a_right_angle(definition, capsys):
    command = ["release", "-n", "1", "-a", "179deg", "-t", "1", "--spread", "0", "--json"]
    assert main([*command, "--definition", definition]) == 0
    row = json.loads(capsys.readouterr().out)["summary"][0]
    small = 2.0 * np.pi * np.sqrt(1.0 / STANDARD_GRAVITY)
    exact = small * 2.0 / np.pi * ellipk(np.sin(np.radians(179.0) / 2.0) ** 2)
    assert row["measured_s"] == pytest.approx(exact, abs=1e-5)
    assert row["com_s"] == pytest.approx(exact, abs=1e-5)
    assert row["corrected_error"] < 1e-5


def test_titles_of_figures_say_degrees(runs):
    from npend_gym.report import release_figures

    title = release_figures.period_against_n(SMALL, runs).axes[0].get_title()
    assert title.startswith("Release from 45 degrees, ")


@pytest.mark.parametrize(
    ("definition", "amplitude", "said"),
    [
        ("bob", 2.0, "beyond 90 degrees: bobs and com reverse around the pivot"),
        ("com", -2.0, "beyond 90 degrees: bobs and com reverse around the pivot"),
        ("horizontal", 2.0, "one pendulum completes in half of its period"),
        ("height", 0.5, "one pendulum is back at its height after half of its period"),
    ],
)
def test_the_table_says_which_definition_is_no_whole_swing(definition, amplitude, said):
    plan = ReleaseExperiment(n_values=[1], amplitude=amplitude, definition=definition)
    assert said in report.legend(plan)
    small = ReleaseExperiment(n_values=[1], definition="bob")
    assert report.legend(small).endswith("between these two")


def test_progress_says_how_many_of_how_many_are_done(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(_progress, "SECONDS", 0.0)
    command = ["release", "-n", "1,2,3,4", "-t", "1", "--page", str(tmp_path / "few.html")]
    assert main(command) == 0
    lines = capsys.readouterr().err.splitlines()
    assert lines[:3] == ["1 of 4 releases", "2 of 4 releases", "3 of 4 releases"]
    assert "2 of 4 chains" in lines


def test_a_bar_on_a_terminal_says_it_too(monkeypatch, capsys):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    assert list(_progress.bar([1, 2, 3, 4], unit="chains")) == [1, 2, 3, 4]
    assert "4 of 4 chains" in capsys.readouterr().err
