"""The audit as a whole: its contents, its files, its command, and the committed document."""

import csv
import hashlib
import json
import os
import re
from pathlib import Path

import pytest
from interrupt import Interrupt
from scripts import run_python
from test_package import WITHOUT_EXTRAS

from npend_gym import _progress
from paper import __main__ as command
from paper import report
from paper.__main__ import main
from paper.claims import claims
from paper.findings import CHECKS, Finding, audit, by_section, groups, selected
from paper.registry import Verdict

QUICK = ("pendulum", "equations", "derivation", "linear", "frequencies", "series", "listings")
DOCUMENT = Path(__file__).parents[2] / "paper" / "audit.md"


@pytest.fixture(scope="module")
def findings():
    return list(audit(QUICK))


def item(text, key):
    """Return the verdict of an item of the document."""
    head, _ = re.split(rf"`python -m paper --only {key}`\n", text)
    return re.findall(r"\*\* \*(.+?)\*[.\n]", head)[-1]


def test_every_claim_has_a_check_and_every_check_a_claim():
    assert set(claims()) == set(CHECKS)
    for claim in claims().values():  # what a note refers to is there
        named = [*re.findall(r"see \[([a-z0-9-]+)\]", claim.note), claim.cause or claim.key]
        assert set(named) <= set(claims()), claim.key
    assert not set(claims()) & set(groups().values())
    assert all(claim.section and claim.place and claim.claim for claim in claims().values())


def test_every_numbered_equation_of_the_paper_is_judged_or_only_defines():
    text = DOCUMENT.read_text(encoding="utf-8")
    places = " ".join(re.findall(r"^\*\*(.*?): ", text, re.MULTILINE))
    assert all(
        (DOCUMENT.parent / name).is_file() for name in re.findall(r"\]\((images/.*?)\)", text)
    )
    anchors = set(re.findall(r"^### (.+)$", text, re.MULTILINE))
    assert set(re.findall(r"\]\(#(.+?)\)", text)) <= anchors
    named = {int(n) for n in re.findall(r"\((\d+)\)", places)}
    for first, last in re.findall(r"\((\d+)\)-\((\d+)\)", places):
        named |= set(range(int(first), int(last) + 1))
    definitions = {10, 18}  # Lagrange's equations, the vector Theta
    assert set(range(1, 58)) - named <= definitions


@pytest.mark.long
def test_the_committed_document_says_what_is_computed_now(findings):
    text = DOCUMENT.read_text(encoding="utf-8")
    for finding in findings:
        assert item(text, finding.key) == finding.verdict.value, finding.key
    assert len(re.findall(r"`python -m paper --only [a-z0-9-]+`", text)) == len(selected())
    for key in selected():
        assert f"`python -m paper --only {key}`" in text


@pytest.mark.long
def test_every_finding_of_some_modules_comes_once_and_in_the_papers_order(findings):
    assert [finding.key for finding in findings] == selected(QUICK)
    assert all(f.place and f.claim and f.printed and f.ours for f in findings)
    shuffled = by_section(reversed(findings))
    keys = [finding.key for some in shuffled.values() for finding in some]
    assert keys == selected(QUICK)
    assert list(shuffled) == sorted(shuffled)
    assert keys.index("torque") < keys.index("eom") < keys.index("matrices") < keys.index("e-hat")


@pytest.mark.long
def test_the_text_shows_verdict_place_and_both_values_in_lines_of_100(findings):
    text = report.audit_text(findings)
    assert max(map(len, text.splitlines())) <= 100
    for shown in ("DOES NOT HOLD: Eq. (28) [series-value]", "printed: 0.049", "ours:    0.03997"):
        assert shown in text


def test_markdown_keeps_its_own_characters_out_of_the_text():
    odd = Finding(
        "eom", "2", "Eq. (1)", "a * b < |c|", "x | y", "2 * 3", "so_so", verdict=Verdict.HOLDS
    )
    text = report.audit_markdown([odd])
    assert r"A \* b \< \|c\|" not in text  # a symbol is no word to begin with a capital
    assert r"**Eq. (1): a \* b \< \|c\|.** *holds*" in text
    assert "- Printed: `x | y`" in text


@pytest.mark.long
def test_the_command_writes_findings_tables_figures_and_what_made_them(tmp_path, capsys):
    out = tmp_path / "results"
    arguments = ["--only", "rk4-orders,series-value,t0-digits", "--out", str(out)]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "3 findings" in printed
    assert "Eq. (28)" in printed
    names = {path.name for path in out.iterdir()}
    assert names == {
        "findings.csv", "audit.md", "digits.csv", "images", "manifest.json",
    }  # fmt: skip
    assert "![Errors of Runge-Kutta" in (out / "audit.md").read_text(encoding="utf-8")
    assert {path.name for path in (out / "images").iterdir()} == {
        "runge_kutta.pdf", "runge_kutta.png",
    }  # fmt: skip
    with (out / "findings.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["key"] for row in rows] == ["series-value", "rk4-orders", "t0-digits"]
    assert rows[0]["verdict"] == "does not hold"
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["provenance"]["arguments"] == {
        "only": ["rk4-orders", "series-value", "t0-digits"], "kane_n": 6,
    }  # fmt: skip
    assert manifest["complete"] is True
    for name, digest in manifest["sha256"].items():
        assert hashlib.sha256((out / name).read_bytes()).hexdigest() == digest


def test_the_command_prints_findings_as_json(capsys):
    assert main(["--only", "series-value", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["provenance"]["arguments"] == {"only": ["series-value"], "kane_n": 6}
    (finding,) = told["findings"]
    assert finding["key"] == "series-value"
    assert finding["verdict"] == "does not hold"


def test_the_command_lists_its_keys(capsys):
    assert main(["--list"]) == 0
    text = capsys.readouterr().out
    assert all(re.search(rf"^  {key}\b", text, re.MULTILINE) for key in [*selected(), "com-law"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("--only eon", "only must name findings or modules of the audit, such as eom"),
        ("--only eom,", "only must name"),
        ("--kane-n 1", "kane_n must be between 4 and 30"),
        ("--kane-n six", "--kane-n"),
        ("--only eom --out /dev/null/x", "out must be a folder"),
        ("--onli eom", "did you mean --only?"),
        ("--only eom --full", "--full is an option of com-law, which --only leaves out"),
        ("--only eom --threads 3", "--threads is an option of com-law"),
        ("--only eom --kane-n 12", "--kane-n is an option of run-time, which --only leaves out"),
        ("--only com-law --out new --n 0", "n must be between"),
        ("--only com-law --out new --amplitudes 0", "amplitudes must be greater than zero"),
        ("--only com-law --out new --amplitudes 3.2", "amplitudes must lie within pi/2"),
        ("--only com-law --amplitudes 0.1,60", "within pi/2 rad, got 60: 60 degrees are"),
        ("--only com-law --out new --threads 0", "threads must be between 1 and"),
    ],
)
def test_bad_arguments_exit_with_2_and_one_line(arguments, message, refusal, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert message in refusal(*arguments.split(), main=main)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("trouble", "code", "message"),
    [
        (KeyboardInterrupt(), 130, "interrupted"),
        (ImportError("Kane's method needs SymPy"), 1, "python -m paper: Kane's method needs SymPy"),
    ],
)
def test_what_was_found_is_kept_when_the_rest_fails(
    trouble, code, message, tmp_path, capsys, monkeypatch
):
    def some(*_args, **_options):
        yield next(audit(["t0-digits"]))
        raise trouble

    monkeypatch.setattr(command, "audit", some)
    assert main(["--out", str(tmp_path)]) == code
    captured = capsys.readouterr()
    assert message in captured.err
    assert "1 finding: 1 holds but for a slip" in captured.out
    assert (tmp_path / "digits.csv").exists() is (code != 130)  # Ctrl-C: no more is computed
    assert json.loads((tmp_path / "manifest.json").read_text())["complete"] is False


def test_ctrl_c_among_tables_and_figures_leaves_the_law_and_the_audit(
    tmp_path, capsys, monkeypatch
):
    def stopped(*_args, **_options):
        raise KeyboardInterrupt

    monkeypatch.setattr(report, "call", stopped)
    arguments = ["--only", "t0-digits,com-law", "--n", "2", "--amplitudes", "0.3"]
    assert main([*arguments, "--out", str(tmp_path)]) == 130
    captured = capsys.readouterr()
    assert "interrupted" in captured.err
    for folder, name, complete in (("com-law", "law.csv", True), ("", "audit.md", False)):
        manifest = json.loads((tmp_path / folder / "manifest.json").read_text())
        assert manifest["complete"] is complete
        assert name in manifest["sha256"]
        assert str(tmp_path / folder / name) in captured.out


def test_ctrl_c_ends_the_study_with_130(capsys):
    with Interrupt():
        assert main(["--only", "chaos"]) == 130
    assert "interrupted" in capsys.readouterr().err


@pytest.mark.long
def test_without_its_extras_the_study_works_or_names_the_one_it_needs(tmp_path):
    code = WITHOUT_EXTRAS.replace("npend_gym.cli", "paper.__main__")
    needed = {"--only one-radian --out results": "plot", "--only eom": "paper"}
    around = os.environ | {"PYTHONPATH": str(DOCUMENT.parents[1])}
    printed = run_python("-c", code, *needed, cwd=tmp_path, env=around)
    for line, extra in zip(printed.splitlines(), needed.values(), strict=True):
        exit_code, error, wrote = json.loads(line)
        assert exit_code == (0 if wrote else 1)
        assert f'pip install "npend-gym[{extra}]"' in error


def test_the_readme_counts_what_the_document_counts():
    counts = re.findall(r"\d+", re.search(r"\*\*(\d+ findings: .*)\*\*", DOCUMENT.read_text())[1])
    readme = " ".join((DOCUMENT.parent.parent / "README.md").read_text(encoding="utf-8").split())
    shown = re.search(
        r"Of (\d+) findings (\d+) hold, (\d+) hold but for a slip, (\d+) do not hold and (\d+)",
        readme,
    )
    assert list(shown.groups()) == counts


def test_a_redirected_audit_tells_how_far_it_is(capsys, monkeypatch):
    monkeypatch.setattr(_progress, "SECONDS", 0.0)
    assert main(["--only", "history,e-at-5"]) == 0
    assert capsys.readouterr().err == "1 of 2 findings\n"
