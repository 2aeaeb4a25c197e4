"""Every example runs, and the README tells the truth."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent


def run(*arguments, cwd):
    done = subprocess.run(
        [sys.executable, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        cwd=cwd,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def in_readme(pattern):
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    return re.search(pattern, readme, re.DOTALL).groups()


def test_passive_release_prints_the_known_periods_and_draws(tmp_path):
    out = run(ROOT / "examples" / "passive_release.py", tmp_path / "a.png", cwd=tmp_path)
    assert "  1     2.0863" in out
    assert "  2     2.7165" in out
    assert (tmp_path / "a.png").stat().st_size > 10_000


def test_code_of_the_readme_prints_what_the_readme_shows(tmp_path):
    code, output = in_readme(r"```python\n(.*?)```\n\n```text\n(.*?)```")
    (tmp_path / "code.py").write_text(code, encoding="utf-8")
    assert run("code.py", cwd=tmp_path) == output


def test_table_of_the_readme_is_what_the_command_prints(tmp_path):
    (shown,) = in_readme(r"```console\n\$ npend release\n(.*?)```")
    assert run("-m", "npend_gym", "release", cwd=tmp_path) == shown
