"""Every example of the paper's reproduction runs, in a small form."""

import re
import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).parent.parent / "examples" / "paper"


def run(name, *arguments):
    done = subprocess.run(
        [sys.executable, FOLDER / name, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_tables_shows_the_printed_errors_and_how_far_off_the_nearest_reading_is():
    out = run("tables.py", 5)
    assert re.search(r"printed:\n  trial 1 +0\.142\n  trial 2 +0\.194\n  trial 3 +0\.222", out)
    # the trials differ by 0.08, and no reading's do by a tenth of that or so
    assert float(re.search(r"off by (\S+) where", out)[1]) > 0.03
    assert float(re.search(r"by (\S+) rad and differ by 0\.003", out)[1]) > 0.5


def test_law_prints_the_fitted_law():
    out = run("law.py", 50)
    assert "limit of small angles, many bobs: 0.9500" in out
    assert float(re.search(r"b = (\S+)", out)[1]) > 0.1
    assert abs(float(re.search(r"p = (\S+)", out)[1]) - 0.5) < 0.005


def test_figures_draws_what_is_asked_for(tmp_path):
    run("figures.py", tmp_path, "runge_kutta")
    assert {path.name for path in tmp_path.iterdir()} == {"runge_kutta.pdf", "runge_kutta.png"}


def test_chaos_tells_the_two_starts_apart():
    out = run("chaos.py", 20)
    last = {
        (int(n), angle): float(estimate)
        for n, angle, estimate in re.findall(r"N = (\d) from (\S+) rad: +\S+ +\S+ +(\S+)", out)
    }
    assert last[2, "2.000"] > 0.5
    assert last[2, "0.785"] < 0.1
