import numpy as np
import pytest

from paper.checks import early_bobs
from paper.checks.chaos import growth
from paper.checks.integrators import STEPS, runge_kutta_errors
from paper.checks.procedure import figure2, series
from paper.claims import claims
from paper.hesitation import velocities
from paper.law import fit_law, scan
from paper.readings import grid
from paper.report import DRAWINGS, TABLES, draw


@pytest.fixture(scope="module")
def results():
    data = scan((2, 10, 20, 50), (0.01, 0.3, np.pi / 4, 1.0, 1.2))
    law = data, fit_law(data)
    seconds = {"Kane's derivation": (0.04, 0.07, 0.2), "our evaluation": (1e-6, 3e-6, 9e-6)}
    return {
        "trajectory": figure2(duration=20.0),
        "pseudo_periods": [series(5), series(10), series(5), series(10)],
        "errors_by_reading": grid((5, 10), ("bob",)),
        "law_against_n": law,
        "law_against_angle": law,
        "runge_kutta": (STEPS, *runge_kutta_errors()),
        "kane_cost": [
            {"what": what, "n": n, "seconds": value}
            for what, values in seconds.items() for n, value in enumerate(values, start=1)
        ],
        "hesitation": early_bobs.Hesitation(
            [velocities(20, a, early_bobs.BOBS, frames=200) for a in early_bobs.SHOWN],
            early_bobs.rows((10, 20)),
        ),
        "lyapunov": {"45°": {2: growth(2, np.pi / 4, 5.0)}, "2 rad": {2: growth(2, 2.0, 5.0)}},
    }  # fmt: skip


def test_every_figure_and_table_belongs_to_a_claim():
    belong = [one.claim for one in (*DRAWINGS.values(), *TABLES.values())]
    assert set(belong) <= set(claims())


@pytest.mark.long
@pytest.mark.parametrize("name", DRAWINGS)
def test_every_axis_says_what_it_shows(name, results):
    figure = DRAWINGS[name].draw(results[name])
    figure.draw_without_rendering()
    assert figure.axes
    for axes in figure.axes:
        assert axes.get_ylabel()
        if axes.xaxis.get_tick_params().get("labelbottom", True):
            assert axes.get_xlabel()


def test_the_drawn_points_are_the_measured_ones():
    results = [series(5), series(10), series(5), series(10)]
    axes = DRAWINGS["pseudo_periods"].draw(results).axes[1]
    drawn = {line.get_label(): line.get_ydata() for line in axes.lines}
    measured = results[1].measured
    for trial in (1, 2, 3):
        np.testing.assert_array_equal(
            drawn[f"trial {trial}, mean over the bobs"], measured[trial - 1]
        )


@pytest.mark.long
def test_a_figure_is_written_as_pdf_and_png_the_same_bytes_each_time(tmp_path):
    folders = [tmp_path / "a", tmp_path / "b"]
    for folder in folders:
        folder.mkdir()
        written = draw("runge_kutta", folder)
        assert [path.name for path in written] == ["runge_kutta.pdf", "runge_kutta.png"]
    for path in written:
        first, second = ((folder / path.name).read_bytes() for folder in folders)
        assert first == second
        assert first.startswith(b"%PDF" if path.suffix == ".pdf" else b"\x89PNG")
