"""Every example of the paper's reproduction runs, in a small form."""

import re
from pathlib import Path

from scripts import run_script

FOLDER = Path(__file__).parent.parent / "examples" / "paper"


def test_tables_shows_the_printed_errors_and_how_far_off_the_nearest_reading_is(tmp_path):
    out = run_script(FOLDER / "tables.py", 5, cwd=tmp_path)
    assert re.search(r"printed:\n  trial 1 +0\.142\n  trial 2 +0\.194\n  trial 3 +0\.222", out)
    # the trials differ by 0.08, and no reading's do by a tenth of that or so
    assert float(re.search(r"off by (\S+) where", out)[1]) > 0.03
    assert float(re.search(r"by (\S+) rad and differ by 0\.003", out)[1]) > 0.5


def test_law_prints_the_fitted_law(tmp_path):
    out = run_script(FOLDER / "law.py", 50, cwd=tmp_path)
    assert "limit of small angles, many bobs: 0.9500" in out
    assert float(re.search(r"b = (\S+)", out)[1]) > 0.1
    assert abs(float(re.search(r"p = (\S+)", out)[1]) - 0.5) < 0.005


def test_figures_draws_what_is_asked_for(tmp_path):
    run_script(FOLDER / "figures.py", tmp_path, "runge_kutta", cwd=tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"runge_kutta.pdf", "runge_kutta.png"}


def test_chaos_tells_the_two_starts_apart(tmp_path):
    out = run_script(FOLDER / "chaos.py", 20, cwd=tmp_path)
    last = {
        (int(n), angle): float(estimate)
        for n, angle, estimate in re.findall(r"N = (\d) from (\S+) rad: +\S+ +\S+ +(\S+)", out)
    }
    assert last[2, "2.000"] > 0.5
    assert last[2, "0.785"] < 0.1


def test_metastable_writes_a_row_for_each_run(tmp_path):
    out = tmp_path / "lyapunov.csv"
    run_script(FOLDER / "metastable.py", out, "2:300", "3:200:1e-9", cwd=tmp_path)
    rows = [line.split(",") for line in out.read_text(encoding="utf-8").splitlines()[1:]]
    assert [row[:3] for row in rows] == [["2", "0.0", "300"], ["3", "1e-09", "200"]]
    assert all(abs(float(row[3])) < 0.2 for row in rows)  # it grows with time, no faster
