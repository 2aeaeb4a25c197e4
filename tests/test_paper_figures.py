import numpy as np
import pytest

from npend_gym.experiments.law import fit_law, scan
from npend_gym.experiments.paper.chaos import growth
from npend_gym.experiments.paper.figure_data import SOURCES, figure2, series
from npend_gym.experiments.paper.grid import grid
from npend_gym.experiments.paper.integrators import STEPS, runge_kutta_errors
from npend_gym.report.paper_figures import FIGURES, write_figures


@pytest.fixture(scope="module")
def results():
    data = scan((2, 10, 20, 50), (0.01, 0.3, np.pi / 4, 1.0, 1.2))
    law = data, fit_law(data)
    return {
        "trajectory": figure2(duration=20.0),
        "pseudo_periods": [series(5), series(10), series(5), series(10)],
        "readings": grid((5, 10), ("bob",)),
        "law_against_n": law,
        "law_against_angle": law,
        "runge_kutta": (STEPS, *runge_kutta_errors()),
        "kane_cost": (np.arange(1, 4), np.array([0.04, 0.07, 0.2]), np.array([10, 100]),
                      np.array([1e-6, 3e-6])),
        "lyapunov": {"45°": {2: growth(2, np.pi / 4, 5.0)}, "2 rad": {2: growth(2, 2.0, 5.0)}},
    }  # fmt: skip


def test_every_figure_has_its_data(results):
    assert set(FIGURES) == set(SOURCES) == set(results)


@pytest.mark.parametrize("name", list(FIGURES))
def test_every_axis_says_what_it_shows(name, results):
    figure = FIGURES[name](results[name])
    figure.draw_without_rendering()
    for axes in figure.axes:
        assert axes.get_ylabel()
        if axes.xaxis.get_tick_params().get("labelbottom", True):
            assert axes.get_xlabel()


def test_units_stand_where_there_are_units(results):
    axes = FIGURES["pseudo_periods"](results["pseudo_periods"]).axes[0]
    assert axes.get_ylabel() == "pseudo-period [s]"
    assert FIGURES["trajectory"](results["trajectory"]).axes[0].get_xlabel() == "x [m]"


def test_the_drawn_points_are_the_measured_ones(results):
    axes = FIGURES["pseudo_periods"](results["pseudo_periods"]).axes[1]
    drawn = {line.get_label(): line.get_ydata() for line in axes.lines}
    measured = results["pseudo_periods"][1].measured
    for trial in (1, 2, 3):
        np.testing.assert_array_equal(
            drawn[f"trial {trial}, mean over the bobs"], measured[trial - 1]
        )


def test_figures_are_written_as_pdf_and_png_the_same_bytes_each_time(results, tmp_path):
    some = {name: results[name] for name in ("runge_kutta", "kane_cost")} | {"unknown": 1}
    folders = [tmp_path / "a", tmp_path / "b"]
    for folder in folders:
        folder.mkdir()
        written = write_figures(some, folder)
        names = ["runge_kutta.pdf", "runge_kutta.png", "kane_cost.pdf", "kane_cost.png"]
        assert [path.name for path in written] == names
    for name in names:
        first, second = ((folder / name).read_bytes() for folder in folders)
        assert first == second
        assert first.startswith(b"%PDF" if name.endswith("pdf") else b"\x89PNG")
