"""Every example runs, and the table of `npend release` in the pages is what it prints."""

import math
import re
from pathlib import Path

import pytest
from PIL import Image
from scripts import run_script

from npend_gym.cli import main

ROOT = Path(__file__).parent.parent


def test_passive_release_prints_the_known_periods_and_draws(tmp_path):
    out = run_script(ROOT / "examples" / "passive_release.py", tmp_path / "a.png", cwd=tmp_path)
    assert "  1     2.0863" in out
    assert "  2     2.7165" in out
    assert (tmp_path / "a.png").stat().st_size > 10_000


def test_quickstart_steps_one_chain_and_many(tmp_path):
    out = run_script(ROOT / "examples" / "quickstart.py", 40, cwd=tmp_path)
    total, limit, seconds = re.search(r"return (\S+) of at most (\d+) in (\S+) s", out).groups()
    assert 0.0 <= float(total) < 2.0  # it hangs, nearly
    assert (limit, seconds) == ("40", "2")
    assert -2.0 <= float(re.search(r"tip: (\S+) m", out)[1]) < 0.0
    assert abs(float(re.search(r"wrong by (\S+) of", out)[1])) < 1e-3
    assert f"{64 * 40} steps" in out


@pytest.mark.long
def test_environments_reproduce_the_papers_periods_and_draw(tmp_path):
    out = run_script(ROOT / "examples" / "passive_env.py", tmp_path / "a.png", cwd=tmp_path)
    rows = re.findall(r"(\d+) +(\S+) s +\+- (\S+) s +(\S+) +(\S+)% +(\d+)/(\d+)", out)
    table = {int(n): [float(value) for value in rest] for n, *rest in rows}
    assert sorted(table) == [5, 10, 20, 100]
    # the means and the spread over trials that `npend release` has, see docs/howto/reproduce.md
    for n, mean, tolerance in (
        (5, 4.03, 0.01),
        (10, 5.333, 0.01),
        (20, 7.083, 0.01),
        (100, 15.56, 0.02),
    ):
        assert abs(table[n][0] - mean) < tolerance
        assert 0.0 < table[n][1] < 0.01
    for n, (mean, _, ideal, error, completed, bobs) in table.items():
        assert abs(ideal - 2.0 * math.pi * math.sqrt(n / 9.81)) < 1e-4
        assert abs(error - 100.0 * (ideal / mean - 1.0)) < 0.1
        assert completed == bobs == 3 * n
    assert (tmp_path / "a.png").stat().st_size > 10_000


@pytest.mark.long
def test_nonlinear_modes_are_listed_and_drawn(tmp_path):
    out = run_script(ROOT / "examples" / "nonlinear_modes.py", tmp_path / "a.gif", 2, cwd=tmp_path)
    rows = re.findall(r"^ 2 +([01]) +(\S+) +(\S+) +\S+ +\S+ +(\S+)$", out, re.MULTILINE)
    assert [(int(mode), float(angle)) for mode, angle, *_ in rows] == [
        (mode, angle) for mode in (0, 1) for angle in (0.785, 1.2, 1.6, 2.0)
    ]
    assert all(float(closed) < 1e-10 for *_, closed in rows)
    with Image.open(tmp_path / "a.gif") as film:
        assert film.n_frames > 100


def test_the_table_of_the_release_in_the_pages_is_what_the_command_prints(capsys):
    page = (ROOT / "docs" / "howto" / "reproduce.md").read_text(encoding="utf-8")
    shown = re.search(r"```console\n\$ npend release\n(.*?)```", page, re.DOTALL)[1]
    assert main(["release"]) == 0
    assert capsys.readouterr().out == shown
