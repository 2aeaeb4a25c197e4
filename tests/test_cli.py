import errno
import inspect
import io
import json
import math
import os
import re
import shlex
import signal
import subprocess
import sys
import threading
from dataclasses import fields

import numpy as np
import pytest
from interrupt import Interrupt
from scripts import run_python

from npend_gym.cli import COMMANDS, _Command, main, parsers
from npend_gym.cli.values import angle, setting
from npend_gym.experiments import CampaignPlan, FlipMap, ReleaseExperiment
from npend_gym.report import outputs, release_figures


def test_release_prints_a_table_or_json_and_names_the_files_that_it_replaces(tmp_path, capsys):
    out = tmp_path / "results"
    release = ["release", "--trials", "1", "--spread", "0", "--out", str(out)]
    assert main([*release, "--n", "1,2"]) == 0
    shown = capsys.readouterr()
    assert "2.0863" in shown.out
    assert "2.7165" in shown.out
    assert "replaces" not in shown.err
    assert {p.name for p in out.iterdir()} >= {"periods.csv", "manifest.json"}
    assert main([*release, "--n", "1", "--json"]) == 0
    shown = capsys.readouterr()
    assert f"npend release: replaces the results in {out}\n" in shown.err
    report = json.loads(shown.out)
    assert report["summary"][0]["measured_s"] == pytest.approx(2.086256, abs=1e-6)
    assert report["provenance"]["arguments"]["trials"] == 1
    assert main(["release", "--n", "2", "--gravity", "0", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["summary"][0]["measured_s"] is None


def test_control_characters_in_names_do_not_reach_the_terminal(tmp_path, capsys):
    evil = "\x1b]0;owned\x07\x1b[2J\rname\x9b31m"
    out = tmp_path / evil
    assert main(["release", "--n", "1", "--trials", "1", "--out", str(out)]) == 0
    page = str(out / "a.html")
    assert main(["release", "--n", "1", "--trials", "1", "--page", page]) == 0
    for bad in (["release", "--out", str(out / "periods.csv")], ["analyse", str(out)]):
        with pytest.raises(SystemExit):
            main(bad)
    printed = capsys.readouterr()
    assert "\\x1b]0;owned" in printed.out
    assert "\\x1b]0;owned" in printed.err
    for text in (printed.out, printed.err):
        assert all(c.isprintable() or c == "\n" for c in text)


@pytest.mark.parametrize(
    ("text", "radians"),
    [
        ("0.5", 0.5), ("-1e-3", -0.001), ("60deg", math.pi / 3), ("-22.5 degrees", -math.pi / 8),
        ("pi", math.pi), ("pi/4", math.pi / 4), ("-pi/6", -math.pi / 6), ("2pi/3", 2 * math.pi / 3),
        ("0.5*pi", math.pi / 2), ("1e-2deg", math.pi / 18000),
    ],
)  # fmt: skip
def test_angles_are_radians_multiples_of_pi_or_degrees(text, radians):
    assert angle(text) == pytest.approx(radians, rel=1e-15)
    parser = _Command(prog="npend chaos")
    options = parser.parse_args(["map", "--centre", f"{text},1", "--width", text])
    assert options.centre == pytest.approx([radians, 1.0])
    assert options.width == pytest.approx(radians)


@pytest.mark.long
@pytest.mark.parametrize(
    "start",
    [
        ["-c", "import sys; from npend_gym.cli import main; sys.exit(main(sys.argv[1:]))"],
        ["-m", "npend_gym"],
    ],
)
def test_degrees_in_place_of_radians_bring_one_plain_line_however_a_command_is_started(start):
    words = ["simulate", "--theta", "120,-10", "--duration", "0.1"]
    line = [sys.executable, *start, *words]
    done = subprocess.run(line, check=True, capture_output=True, text=True)
    assert done.stderr == (
        "npend simulate: theta reaches 120 rad, 19.1 turns: are these degrees? They must be radians"
        " (np.radians converts; npend takes 120deg)\n"
    )


@pytest.mark.parametrize(
    "words", ["release -n 2 -a 45", "chaos map --centre 45,1", "campaign -a 45 --out results"]
)
def test_degrees_that_no_command_takes_are_refused_with_how_to_write_them(words, capsys):
    with pytest.raises(SystemExit):
        main(words.split())
    assert "npend takes 45deg" in capsys.readouterr().err


@pytest.mark.parametrize(("text", "value"), [
    (".5", 0.5), ("1.", 1.0), ("+2", 2.0), ("-.5e-1", -0.05), ("[1, 2]", [1, 2]), ("1_0", "1_0"),
])  # fmt: skip
def test_settings_take_numbers_as_people_write_them(text, value):
    assert setting(f"name={text}") == ("name", value)


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [
        (RuntimeError("no step"), 1, "npend verify: no step"),
        (ImportError("figures need matplotlib"), 1, "npend verify: figures need matplotlib"),
        (OSError(28, "Full", "a.csv"), 1, "npend verify: [Errno 28] Full: 'a.csv'"),
        (BrokenPipeError(), 1, "npend verify: the output was closed before its end"),
        (KeyboardInterrupt(), 130, "npend verify: interrupted"),
    ],
)
def test_an_expected_failure_is_one_line_and_an_exit_code(error, code, text, monkeypatch, capsys):
    def fail(**_options):
        raise error

    monkeypatch.setattr("npend_gym.cli.verify.run", fail)
    assert main(["verify"]) == code
    assert capsys.readouterr().err == f"{text}\n"


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("identify a.csv --columns time=t,theta0=a,theta0=b", "must name each column of ours once"),
        # what a chain has
        ("release --chain acrobot --masses 1", "--masses must be left out with --chain"),
        ("simulate --chain acrobot --gravity 9.81", "--gravity must be left out with --chain"),
        ("campaign -o a --chain acrobot --damping 0", "--damping must be left out with --chain"),
        # of a film
        ("simulate --fps 20", "--fps must be left out without --film"),
        ("simulate --speed 1", "--speed must be left out without --film"),
        ("simulate --size 480", "--size must be left out without --film"),
        ("simulate swingup-1 --plain", "--plain must be left out without --film"),
        # no path, or a file in what is no folder
        ("release -n 1 -t 1 --out ''", ": must be a path, got ''"),
        ("release ''", ": must be a path, got ''"),
        ("analyse ''", ": must be a path, got ''"),
        ("simulate -n 1 --csv ''", ": must be a path, got ''"),
        ("identify a.csv '' --lengths 1", ": must be a path, got ''"),
        ("simulate --csv /dev/null/a.csv", "csv must be in a folder that can be written to, got"),
        ("release --page /dev/null/a.html", "page must be in a folder that can be written to"),
    ],
)
def test_what_a_command_would_ignore_or_cannot_write_to_is_refused(
    line, message, refusal, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert message in refusal(*shlex.split(line))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_every_command_shows_examples_of_it(command, capsys):
    with pytest.raises(SystemExit) as caught:
        main([command, "--help"])
    assert caught.value.code == 0
    _, examples = capsys.readouterr().out.split("\nexamples:\n")
    assert f"  npend {command}" in examples


def arguments_of(command):
    """Return the arguments of a command by what they fill."""
    parser = parsers()[1][command]
    parser.load()
    return parser.run, {action.dest: action for action in parser._actions}


@pytest.mark.parametrize("command", COMMANDS)
def test_every_parameter_of_a_command_is_an_argument_with_help(command):
    run, arguments = arguments_of(command)
    taken = [each for each in inspect.signature(run).parameters.values() if each.kind.value < 4]
    assert {each.name for each in taken} <= set(arguments)
    assert all(action.help for action in arguments.values())
    named = re.compile(r"\(default _?[A-Z]{2,}[A-Z_]*\)$")  # of a constant, not its value
    assert not [name for name, action in arguments.items() if named.search(action.help)]


@pytest.mark.parametrize(
    ("command", "filled"),
    [("release", ReleaseExperiment), ("campaign", CampaignPlan), ("chaos", FlipMap)],
)
def test_every_field_is_an_option_and_the_help_has_its_default(command, filled):
    _, arguments = arguments_of(command)
    for field in fields(filled):
        option, value = arguments[field.name], getattr(filled(), field.name)
        shown = re.search(r"\(default (\S+)\)$", option.help)
        assert (shown is None) == (value is None)
        if shown:
            np.testing.assert_array_equal(np.ravel(option.type(shown[1])), np.ravel(value))


def test_help_and_its_options_import_nothing_heavy():
    code = """
import contextlib, io, sys
from npend_gym.cli import COMMANDS, main
for arguments in ([], *([name] for name in COMMANDS)):
    with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):
        main([*arguments, "--help"])
print([name for name in ("numba", "scipy", "matplotlib", "torch", "tqdm") if name in sys.modules])
"""
    assert run_python("-c", code) == "[]\n"


def test_help_names_every_command_and_the_exit_codes_and_the_version_is_told(capsys):
    with pytest.raises(SystemExit, match="0"):
        main(["--version"])
    assert capsys.readouterr().out.startswith("npend_gym ")
    with pytest.raises(SystemExit, match="0"):
        main(["--help"])
    text = capsys.readouterr().out
    assert all(re.search(rf"\n    {command}\s", text) for command in COMMANDS)  # long ones wrap
    assert "exit codes: 0 done, 1 the work failed, 2 bad arguments, 130 interrupted" in text


@pytest.mark.long
@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_ctrl_c_keeps_what_was_measured_and_exits_with_130(tmp_path, capsys, monkeypatch):
    from npend_gym.experiments import release

    pseudo_periods = release.pseudo_periods
    measuring_the_long_chain = threading.Event()

    def measured(chain, *arguments, **options):
        if chain.n == 1000:
            measuring_the_long_chain.set()
        return pseudo_periods(chain, *arguments, **options)

    monkeypatch.setattr(release, "pseudo_periods", measured)
    with Interrupt(measuring_the_long_chain, patience=60.0):  # figures are drawn
        code = main(["release", "--n", "1,1000", "--trials", "20", "--out", str(tmp_path)])
    assert code == 130
    out, error = capsys.readouterr()
    assert "interrupted" in error
    assert "2.08" in out
    assert '"complete": false' in (tmp_path / "manifest.json").read_text()


@pytest.mark.parametrize("words", [["--version"], ["release", "--help"]])
def test_a_text_that_cannot_be_printed_is_a_failure_in_one_line(words, monkeypatch, capsys):
    class Full(io.StringIO):
        def write(self, _):
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(sys, "stdout", Full())
    with pytest.raises(SystemExit, match="1"):
        main(words)
    assert re.fullmatch("npend.*: .*No space left on device\n", capsys.readouterr().err)


@pytest.mark.long
@pytest.mark.parametrize("trouble", ["a broken matplotlib", "a wrong backend"])
def test_results_are_written_where_figures_cannot_be_drawn(trouble, tmp_path):
    (tmp_path / "matplotlib").mkdir()
    (tmp_path / "matplotlib" / "__init__.py").write_text("raise ImportError('no bogus here')")
    wrong = {"PYTHONPATH": str(tmp_path)} if "broken" in trouble else {"MPLBACKEND": "bogus"}
    out = tmp_path / "results"
    done = subprocess.run(
        [sys.executable, "-m", "npend_gym", "release", "-n", "1", "-t", "1", "-o", str(out)],
        capture_output=True, text=True, check=True, env=os.environ | wrong,
    )  # fmt: skip
    assert "figures need matplotlib: it is installed but cannot be imported: " in done.stderr
    assert "bogus" in done.stderr
    assert {path.name for path in out.iterdir()} == {
        "release.json", "periods.csv", "summary.csv", "manifest.json",
    }  # fmt: skip


@pytest.fixture
def pressing(monkeypatch):
    """A function: it lets calls of a function press Ctrl-C, or send another signal."""

    def press(module, name, times, number=signal.SIGINT):
        function = getattr(module, name)

        def pressed(*arguments, **named):
            for _ in range(times):
                signal.raise_signal(number)
            return function(*arguments, **named)

        monkeypatch.setattr(module, name, pressed)

    return press


RELEASE = ["release", "-n", "1", "-t", "1", "-o"]


@pytest.mark.parametrize(
    ("module", "name", "number"),
    [
        (release_figures, "period_against_n", signal.SIGINT),
        (outputs, "write_manifest", signal.SIGINT),
        (outputs, "write_manifest", signal.SIGTERM),
    ],
)
def test_ctrl_c_and_sigterm_while_results_are_written_act_once_they_are(
    module, name, number, pressing, tmp_path, capsys
):
    pressing(module, name, 1, number)
    assert main([*RELEASE, str(tmp_path)]) == 128 + number
    out, error = capsys.readouterr()
    assert "period_of_each_bob.png" in out
    assert error.endswith("npend release: interrupted\n")
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    assert manifest["complete"]
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {*manifest["sha256"], "manifest.json"}


def test_a_second_ctrl_c_leaves_out_the_figures(pressing, tmp_path):
    pressing(release_figures, "period_against_n", 2)
    assert main([*RELEASE, str(tmp_path)]) == 130
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    assert list(manifest["sha256"]) == ["release.json", "periods.csv", "summary.csv"]
    assert main(["release", str(tmp_path)]) == 0


def test_ctrl_c_before_the_first_run_is_done_says_that_nothing_was_measured(monkeypatch, capsys):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("npend_gym.experiments.measure", interrupted)
    assert main(["release", "-n", "1"]) == 130
    assert capsys.readouterr().err.endswith("interrupted: nothing was measured\n")
