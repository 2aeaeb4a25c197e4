"""The leaderboard: its page is what its files say, and its files are what the models do."""

import importlib.util

import pytest
from test_examples import ROOT

from npend_gym import _files
from npend_gym.cli import main
from npend_gym.rl import read_benchmarks
from npend_gym.rl.policies.files import pretrained_path

RESULTS = ROOT / "benchmarks" / "leaderboard"


def script():
    spec = importlib.util.spec_from_file_location("leaderboard", ROOT / "docs" / "leaderboard.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.long  # it draws many samples
def test_the_page_of_the_leaderboard_is_what_docs_leaderboard_writes():
    made = script()
    text = made.PAGE.read_text("utf-8")
    assert made.with_tables(text) == text, "python docs/leaderboard.py"


def test_every_result_is_complete_and_has_the_name_of_its_file():
    runs = read_benchmarks([RESULTS])
    assert {f"{each.name}-{each.suite}-{each.run}.json" for each in runs} == {
        path.name for path in RESULTS.glob("*.json")
    }
    assert all(each.complete for each in runs)


@pytest.mark.parametrize("suite", ["core", "hard"])
def test_the_pretrained_results_are_of_the_policies_that_ship(suite):
    """After a policy has changed, `npend benchmark pretrained --suite SUITE --by npend_gym -o
    benchmarks/leaderboard` and `python docs/leaderboard.py` make this pass.
    """
    (run,) = read_benchmarks([RESULTS / f"pretrained-{suite}-0.json"])
    of_files = run.record["model"]["sha256"]
    assert of_files == {name: _files.sha256(pretrained_path(name)) for name in of_files}


def test_runs_of_one_name_say_the_same_of_their_training():
    runs = [each for each in read_benchmarks([RESULTS]) if each.name == "PPO"][:2]
    runs[1].record["about"]["by"] = "somebody else"
    with pytest.raises(ValueError, match="runs of PPO must all say the same of steps and by"):
        script().table("core", runs)


@pytest.mark.long
@pytest.mark.parametrize("file", [
    "pretrained-core-0", "pretrained-hard-0", "random-core-0", "random-hard-0",
    "reference-release-0",
])  # fmt: skip
def test_a_result_of_the_leaderboard_is_what_its_models_do(file, capsys):
    assert main(["benchmark", "--check", str(RESULTS / f"{file}.json")]) == 0
    assert "accepted" in capsys.readouterr().out
