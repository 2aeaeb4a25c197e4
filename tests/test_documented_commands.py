"""Every command that a page names is understood, and those in blocks do their work."""

import re
import shlex
import shutil
from importlib.util import find_spec
from pathlib import Path

import pytest
from scripts import run_script
from suites import timing

from npend_gym.cli import main, parsers
from npend_gym.rl import Policy
from npend_gym.rl.training import tasks
from paper import __main__ as study

ROOT = Path(__file__).parent.parent
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md")),
    *sorted((ROOT / "paper").glob("*.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
BLOCK = re.compile(r"```(?:sh|console)\n(.*?)```", re.DOTALL)
OURS = ("npend ", "python benchmarks/", "python examples/", "python -m paper")


def commands(page):
    """Return those in blocks, and those within sentences, which may leave out what is required."""
    text = page.read_text("utf-8")
    blocks = "\n".join(BLOCK.findall(text)).replace("\\\n", " ")
    sentences = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    lines = [line.removeprefix("$ ") for line in blocks.splitlines()]
    inline = [" ".join(code.split()) for code in re.findall(r"`([^`]+)`", sentences)]
    for found, whole in ((lines, True), (inline, False)):
        for line in found:
            for command in re.split(r" && | \| ", line):
                if command.startswith(OURS):
                    yield shlex.split(command, comments=True), whole


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_of_the_page_are_understood(page, capsys):
    parser, each = parsers()
    for words, whole in commands(page):
        placeholder = any(re.fullmatch(r"[A-Z]+|\.\.\.", word) for word in words)
        if words[:3] == ["python", "-m", "paper"]:
            study.command().parse_args(words[3:])
        elif words[0] == "python":
            file = words[1] if words[1] != "-m" else f"{words[2].replace('.', '/')}.py"
            script = (ROOT / file).read_text("utf-8")
            options = {word for word in words[2:] if word.startswith("--")} - {"--env"}
            assert all(f'"{option}"' in script for option in options), words
        elif whole and not placeholder:
            parser.parse_args(words[1:])
        elif words[1] in each:
            command = each[words[1]]
            command.load()
            known = re.findall(r"--[\w-]+", command.format_help())
            assert {word for word in words[2:] if word.startswith("--")} <= set(known), words
        else:
            assert placeholder or words[1] in ("--help", "--version"), words
    assert capsys.readouterr().err == ""


def test_the_pages_name_many_commands():
    assert sum(len(list(commands(page))) for page in PAGES) > 200


ELSEWHERE = {  # why a command is not run here
    "train_rllib": "Ray has an environment of its own",
    "train_skrl": "skrl, too",
    "train_tianshou": "Tianshou, too",
    "npend dataset": "Minari, too",
    "clone_behaviour": "Minari, too",
    "offline_iql": "Minari, too",
    "benchmarks/recipes.py": "training that takes hours; tests/test_rl_examples.py runs a part",
    "--address": "it needs a cluster",
    "--only gpu": "it needs a GPU",
    "paper --out results": "its findings are tested one by one, and take long together",
    "benchmarks/hardness.py": "minutes; tests/test_hardness.py runs a part",
    "s3://": "it needs a store; tests/test_campaign_stores.py has one",
    "long_motions.py": "minutes, and it needs heyoka",
    "evaluate_engines.py": "it needs other engines; tests/test_certify.py runs a part",
    "paper.period": "minutes; tests/paper/test_period_paper.py runs a part",
    "--full": "half an hour; tests/paper/test_com_law.py runs a part",
    "--only hesitation": "minutes; tests/paper/test_paper_hesitation.py runs it",
    "--only tables-together": "minutes; tests/paper/test_paper_tables.py runs it",
    "--only chaos-n": "minutes: exponents up to N = 100",
    "nonlinear_modes": "half a minute; tests/test_examples.py runs a part",
    "--resume": "it goes on with what was interrupted; tests/test_rl_checkpoints.py",
    "algorithms.py": "training that takes hours; tests/test_rl_examples.py runs a part",
    "side_by_side.py": "training that takes hours; tests/test_side_by_side.py runs a part",
    "robustness.py": "it takes long; tests/test_rl_robustness.py runs a part",
    "tracker.txt": "the recording is a reader's own; tests/test_measure.py has such a file",
    "drive1.csv": "the recordings are a reader's own",
    "rec.csv": "the recording is a reader's own",
    "--around": "the fit is a reader's own; tests/test_rl_training.py reads one",
    "benchmark models": "the models are a reader's own; tests/test_rl_benchmark.py has some",
    "benchmarks/leaderboard": "they are in a clone; tests/test_leaderboard.py checks them",
    "my-swing-up/": "the policy is a reader's own",
}
FEW_ROUNDS = '--set rounds=3 --set num_envs=32 --set updates=20 --set errors={"delay":1.0}'
SHORTER = {  # with less of what takes minutes
    "npend train swingup-2-robust": FEW_ROUNDS,
    "npend train balance-2-robust": FEW_ROUNDS,
    "npend train": "--set total_timesteps=4096",
    "npend evaluate": "--episodes 4",
    "npend benchmark": "--episodes 4",
    "npend chaos map": "--size 60",
    "npend simulate": "--duration 2",
    "python examples/evaluate.py --controller plan": "--task swingup-1 --episodes 2 --seconds 1",
    "python examples/evaluate.py": "--episodes 2 --seconds 1",
    "python examples/train_sb3.py": "--steps 4096",
    "python examples/train_torchrl.py": "--steps 4096",
}
LIBRARIES = {"train_sb3": "stable_baselines3", "train_torchrl": "torchrl", "npend train": "torch"}
OWN = {"motion.csv": "multiarm_double.csv", "double.csv": "multiarm_double.csv"}


def runs_here(line):
    """Whether a command is one that is run, with the libraries that are there."""
    missing = [mark for mark, library in LIBRARIES.items() if not find_spec(library)]
    return not any(mark in line for mark in [*ELSEWHERE, *missing])


def in_blocks():
    """Return the commands of each page's blocks that are run here, as words.

    A command that an earlier page has is left out, unless its page reads results.
    """
    found, seen = {}, set()
    for page in PAGES:
        here = [words for words, whole in commands(page) if whole and runs_here(" ".join(words))]
        reads = any("results/" in word for words in here for word in words)
        found[page] = [words for words in here if reads or tuple(words) not in seen]
        seen |= {tuple(words) for words in here}
    return {page: lines for page, lines in found.items() if lines}


COMMANDS = in_blocks()


def shorter(words):
    """Return the words with the options that stand for them in SHORTER, which replace settings."""
    line = " ".join(words)
    added = next((more.split() for start, more in SHORTER.items() if line.startswith(start)), [])
    names = {word.partition("=")[0] for word in added if "=" in word}
    own = [k for k, word in enumerate(words) if word.partition("=")[0] in names]
    dropped = {*own, *(k - 1 for k in own)}  # "--set", "name=value"
    return [word for k, word in enumerate(words) if k not in dropped] + added


@pytest.mark.long
@pytest.mark.parametrize(
    "page",
    [
        # other tests call what makes their pictures and tables
        pytest.param(page, marks=[pytest.mark.nightly] * (page.stem in ("gallery", "robustness")))
        for page in COMMANDS
    ],
    ids=lambda page: str(page.relative_to(ROOT)),
)
def test_commands_of_the_page_do_their_work_one_after_another(page, tmp_path, monkeypatch):
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    for name, data in OWN.items():
        shutil.copy(ROOT / "examples" / "data" / data, tmp_path / name)
    Policy.pretrained("calm-1").save(tmp_path / "calm.safetensors")  # as code of a page makes one
    plan = re.search(r"```toml\n(n = .*?)```", page.read_text("utf-8"), re.DOTALL)
    if plan:
        (tmp_path / "plan.toml").write_text(plan[1].replace("trials = 1000", "trials = 2"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.setattr("webbrowser.open", lambda _url: True)  # of `npend play`
    monkeypatch.setattr(tasks, "LEAST_SUCCESS", 0.0)  # shorter trainings may learn nothing
    monkeypatch.setattr(timing, "SECONDS", 1e-4)  # of a round of `python benchmarks/peers.py`
    for words in COMMANDS[page]:
        if words[1] != "analyse":  # which reads what the command before has written
            for folder in {"results", "FOLDER"} & set(words):
                shutil.rmtree(folder, ignore_errors=True)
        if words[:3] == ["python", "-m", "paper"]:
            assert study.main(words[3:]) == 0, words
        elif words[0] == "python":
            run_script(ROOT / words[1], *shorter(words)[2:], cwd=tmp_path)
        else:
            assert main(shorter(words)[1:]) == 0, words


@pytest.mark.long
def test_the_example_of_the_help_of_export_takes_the_fit_of_the_pages(
    tmp_path, monkeypatch, capsys
):
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    page = ROOT / "docs" / "howto" / "real_pendulum.md"
    fit = next(words for words, whole in commands(page) if whole and words[1] == "identify")
    with pytest.raises(SystemExit):
        main(["export", "--help"])
    lines = capsys.readouterr().out.splitlines()
    example = next(line for line in lines if "--chain results/fit.json" in line)
    for words in (fit, shlex.split(example)):
        assert main(words[1:]) == 0, words
    assert (tmp_path / "chain.xml").read_text().startswith("<mujoco")
