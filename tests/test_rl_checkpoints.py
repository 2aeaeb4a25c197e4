"""Training that is interrupted and resumed ends with the same policy, to the last bit."""

import errno
import hashlib
import io
import random
from collections import deque
from typing import Any, NamedTuple

import numpy as np
import pytest
from damage import flipped
from policy_files import random_policy

torch = pytest.importorskip("torch")

import learned_model  # noqa: E402
import value_iteration  # noqa: E402

from npend_gym import _files, _progress  # noqa: E402
from npend_gym.cli import main  # noqa: E402
from npend_gym.rl.policies import files  # noqa: E402
from npend_gym.rl.policies.files import read_policy  # noqa: E402
from npend_gym.rl.training import experts, imitation, shac  # noqa: E402
from npend_gym.rl.training.checkpoints import Checkpoint  # noqa: E402

pytestmark = pytest.mark.long

ONE = {"n": 1, "mode": "swingup", "observation": "sincos"}
SHORT = {"rounds": 5, "updates": 20, "first_updates": 40, "hidden": 16}
FEW = {"updates": 2, "num_envs": 16}
MUON = {"muon_learning_rate": 0.02}
RUNS = {
    "imitation": (imitation, imitation.Settings(ONE, seconds=3.0, guesses=2, num_envs=8, **SHORT)),
    "imitation of transitions": (
        imitation,
        imitation.Settings(ONE | {"mode": "transition"}, seconds=3.0, num_envs=16, **SHORT),
    ),
    "imitation with errors": (
        imitation,
        imitation.settings_of("swingup-1-robust", seconds=3.0, num_envs=32, **SHORT | MUON),
    ),
    "imitation by SPRING": (
        imitation,
        imitation.Settings(ONE, seconds=3.0, num_envs=8, **SHORT, spring_learning_rate=0.3),
    ),
    "value iteration": (
        value_iteration,
        value_iteration.Settings(updates=6, batch=8, lanes=8, memory=64, hidden=8),
    ),
    "value iteration in a learned model": (
        learned_model,
        learned_model.Settings(
            updates=6, batch=8, lanes=8, memory=64, hidden=8, episodes=4, rounds=2, fits=2
        ),
    ),
    "shac": (shac, shac.settings_of("swingup-2", total_timesteps=480, **FEW)),
    "shac with chains that differ": (
        shac,
        shac.settings_of("swingup-1-robust", total_timesteps=800, episode=20, **FEW | MUON),
    ),
    "shac with goals on a cart": (
        shac, shac.Settings(
            {"n": 1, "mode": "transition", "base": "cart", "observation": "sincos"},
            total_timesteps=800, episode=20, **FEW,
        ),
    ),
}  # fmt: skip


@pytest.fixture(autouse=True)
def few_wrong_chains(monkeypatch):
    few = [{"lengths": np.array([1.1])}, {"damping": np.array([0.05])}]
    monkeypatch.setattr(experts, "wrong_chains", lambda *_: few)


class StoppedError(Exception):
    """Stands for Ctrl-C."""


class StoppedCheckpoint(Checkpoint):
    """Writes after every round, and stops in the middle of one."""

    def rounds(self, parts, last, title, unit, first=1):
        for round_ in super().rounds(parts, last, title, unit, first):
            yield round_
            if round_ >= (first + last) // 2:
                raise StoppedError  # after the round, before it is written


@pytest.mark.parametrize(
    "name",
    [pytest.param(k, marks=pytest.mark.nightly) if "SPRING" in k else k for k in RUNS],
)
def test_a_run_that_was_stopped_ends_as_one_that_was_not(name, tmp_path, monkeypatch):
    trainer, settings = RUNS[name]
    whole, curve = trainer.train(settings)
    path = tmp_path / "run.checkpoint"
    with pytest.raises(StoppedError):
        trainer.train(settings, None, StoppedCheckpoint(settings, path, seconds=0.0))
    torch.manual_seed(123)
    for planned in ("planned_swing_up", "planned_transition"):  # the checkpoint has the plans
        monkeypatch.delattr(experts, planned)
    policy, resumed = trainer.train(settings, None, Checkpoint(settings, path, resume=True))
    pairs = zip(policy.weights + policy.biases, whole.weights + whole.biases, strict=True)
    for ours, theirs in pairs:
        np.testing.assert_array_equal(ours, theirs)
    without = [{k: v for k, v in row.items() if k != "seconds"} for row in curve]
    assert [{k: v for k, v in row.items() if k != "seconds"} for row in resumed] == without


def test_a_checkpoint_that_is_cut_or_has_a_flipped_bit_is_refused(tmp_path):
    run, path = {"weights": torch.arange(50.0)}, tmp_path / "run"
    restored(path, run, {})
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    damaged = [whole[:size] for size in rng.integers(len(whole), size=20)]
    damaged += flipped(whole, rng.integers(8 * len(whole), size=200).tolist())
    for content in damaged:
        path.write_bytes(content)
        with pytest.raises(ValueError, match="is no checkpoint: it is damaged"):
            Checkpoint(imitation.Settings(), path, resume=True)


def test_a_checkpoint_that_cannot_be_written_names_the_reason_and_its_file(tmp_path, monkeypatch):
    class Full(io.FileIO):
        def write(self, _):
            raise OSError(errno.ENOSPC, "No space left on device")

    path = tmp_path / "run.checkpoint"
    monkeypatch.setattr(_files.disk, "open", Full)
    with pytest.raises(OSError, match=f"No space left on device: '{path}'"):
        restored(path, {"weights": torch.zeros(50_000)}, {})
    assert not list(tmp_path.iterdir())


def test_a_checkpoint_is_of_the_same_keywords_in_any_order_and_names_those_that_differ(tmp_path):
    settings, path = shac.Settings({"n": 1, "damping": 0.1}, hidden=8), tmp_path / "run"
    with pytest.raises(ValueError, match="there is no checkpoint"):
        Checkpoint(settings, path, resume=True)
    list(Checkpoint(settings, path, seconds=0.0).rounds({}, 1, None, "round"))
    assert Checkpoint(shac.Settings({"damping": 0.1, "n": 1}, hidden=8), path, resume=True).is_kept
    with pytest.raises(ValueError, match="has ") as caught:
        Checkpoint(shac.Settings({"n": 2, "gravity": 9.0}, seed=1, hidden=8), path, resume=True)
    told, _ = str(caught.value).split(": ")
    assert told == (
        f"{path} has seed = 0 where this run has 1, env n = 1 where this run has 2, env gravity = "
        "nothing where this run has 9.0, env damping = 0.1 where this run has nothing"
    )


def test_a_checkpoint_of_numbers_that_print_alike_is_refused(tmp_path):
    chains = ({"masses": 1.0, "lengths": np.array([length])} for length in (1.0, 1.0 + 1e-12))
    one, other = (shac.Settings({"chain": chain}) for chain in chains)
    assert repr(one) == repr(other)
    kept = Checkpoint(one, tmp_path / "run", seconds=0.0)
    assert not kept.is_kept
    assert list(kept.rounds({}, 2, None, "round")) == [1, 2]
    assert kept.is_kept
    assert Checkpoint(one, tmp_path / "run", resume=True).is_kept
    with pytest.raises(ValueError, match=r"this run has .*1\.000000000001"):
        Checkpoint(other, tmp_path / "run", resume=True)


def test_a_checkpoint_runs_no_code(tmp_path):
    import pickle

    class Evil:
        def __reduce__(self):
            return (tmp_path.joinpath("was_run").mkdir, ())

    path = tmp_path / "run.checkpoint"
    torch.save({"about": Evil()}, saved := io.BytesIO())
    for content in (saved.getvalue(), pickle.dumps(Evil())):
        path.write_bytes(hashlib.sha256(content).digest() + content)
        with pytest.raises(ValueError, match=r"is no checkpoint \("):
            Checkpoint(RUNS["shac"][1], path, resume=True)
    assert not tmp_path.joinpath("was_run").exists()


class Pair(NamedTuple):
    a: Any
    b: Any


def restored(path, run, fresh):
    """Return what a run starts with, after it was resumed from a checkpoint of another."""
    settings = imitation.Settings()
    for _ in Checkpoint(settings, path, seconds=0.0).rounds(run, 1, None, "round"):
        pass
    assert not [*Checkpoint(settings, path, resume=True).rounds(fresh, 1, None, "round")]
    return fresh


def test_generators_of_every_kind_go_on(tmp_path):
    def generators(seed):
        kinds = np.random.PCG64, np.random.MT19937, np.random.Philox, np.random.SFC64
        made = [np.random.Generator(kind(seed)) for kind in kinds]
        return {"numpy": [*made, np.random.RandomState(seed)], "python": random.Random(seed)}

    def numbers(run):
        return [each.random(3).tolist() for each in run["numpy"]], run["python"].random()

    run = generators(0)
    numbers(run)
    fresh = restored(tmp_path / "run", run, generators(1))
    assert numbers(fresh) == numbers(run)


def test_values_come_back_with_their_types(tmp_path):
    run = {
        "elites": [np.zeros(2), np.ones(2, np.complex64)], "pairs": [(1, 2.5), (np.zeros(1), "a")],
        "best": np.array(["text"]), "pair": Pair(1, np.zeros(2)), "tensor": torch.ones(2),
        "number": np.float32(0.1), "table": {0: 1.0, (1, 2): np.zeros(1)}, "none": None,
        "empty": (), "returns": deque([2.0, 3.0]),
    }  # fmt: skip
    fresh = {
        "best": None, "elites": [None], "pair": Pair(0, None), "returns": deque([1.0], maxlen=2),
        "table": {5: 0.0}, "none": torch.nn.Linear(1, 1),
    }  # fmt: skip
    table, returns = fresh["table"], fresh["returns"]
    again = restored(tmp_path / "run", run, fresh)
    assert repr(again) == repr(run).replace("deque([2.0, 3.0])", "deque([2.0, 3.0], maxlen=2)")
    assert again["table"] is table
    assert again["returns"] is returns


def test_networks_in_lists_and_schedulers_go_on(tmp_path):
    def made():
        torch.manual_seed(0)
        networks = [torch.nn.Linear(1, 2), torch.nn.BatchNorm1d(2)]
        gain = torch.nn.Parameter(torch.ones(2))
        learned = [gain, *(each for network in networks for each in network.parameters())]
        optimizer = torch.optim.Adam(learned, np.float64(0.1))
        scheduler = torch.optim.lr_scheduler.MultiStepLR(optimizer, [2, 3])
        run = {"networks": networks, "gain": gain, "optimizer": optimizer}
        return run | {"schedulers": [scheduler]}

    def update(run):
        first, second = run["networks"]
        (run["gain"] * second(first(torch.arange(3.0)[:, None]))).square().sum().backward()
        run["optimizer"].step()
        run["optimizer"].zero_grad()
        run["schedulers"][0].step()
        parts = [*run["networks"], run["optimizer"], run["schedulers"][0]]
        return repr([run["gain"], *(part.state_dict() for part in parts)])

    run = made()
    update(run)
    again = restored(tmp_path / "run", run, made())
    for _ in range(3):
        assert update(again) == update(run)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ([{1}], r"parts\['x'\]\[0\] must be something that a checkpoint can store.*the set \{1\}"),
        (np.array([None]), "the ndarray array"),
        ({np.int64(1): 0}, r"keys of parts\['x'\] must be numbers or texts, got np.int64"),
    ],
)
def test_what_a_checkpoint_cannot_store_is_named_when_it_is_written(value, message, tmp_path):
    with pytest.raises(TypeError, match=message):
        restored(tmp_path / "run", {"x": value}, {})
    assert not list(tmp_path.iterdir())


def test_a_network_that_a_resumed_run_has_not_made_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"parts\['x'\] must be a Linear before `rounds`.*None"):
        restored(tmp_path / "run", {"x": torch.nn.Linear(1, 1)}, {"x": None})


def test_the_command_goes_on_after_ctrl_c(tmp_path, monkeypatch, capsys):
    common = ["train", "calm-1", "--set", "updates=1", "--set", "total_timesteps=1920"]
    assert main([*common, "--out", str(tmp_path / "whole")]) == 1  # too short to calm
    update, calls = shac.Learner.update, []

    def stopped(*arguments):
        calls.append(1)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return update(*arguments)

    monkeypatch.setattr(shac.Learner, "update", stopped)
    monkeypatch.setattr(Checkpoint.__init__, "__kwdefaults__", {"resume": False, "seconds": 0.0})
    out = ["--out", str(tmp_path / "two")]
    assert main([*common, *out]) == 130
    assert RESUMES in capsys.readouterr().err
    assert main([*common, *out, "--resume"]) == 1
    assert not list(tmp_path.glob("two/*.checkpoint"))
    runs = [read_policy(tmp_path / folder / "calm-1.safetensors") for folder in ("whole", "two")]
    for _, about in runs:
        about["training"].pop("seconds")  # of the processor
    assert runs[0][1] == runs[1][1]
    for name in runs[0][0]:
        np.testing.assert_array_equal(*(arrays[name] for arrays, _ in runs))


def interrupted(*_):
    raise KeyboardInterrupt


def test_after_ctrl_c_a_checkpoint_of_another_run_is_no_progress(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(shac, "train", interrupted)
    (tmp_path / "calm-1.checkpoint").write_bytes(b"of other settings")
    assert main(["train", "calm-1", "--overwrite", "--out", str(tmp_path)]) == 130
    assert "nothing was written" in capsys.readouterr().err


@pytest.fixture
def quick_training(monkeypatch):
    """A training of one round, which writes a checkpoint and ends with a random policy."""

    def trained(_settings, _title, checkpoint):
        list(checkpoint.rounds({}, 1, None, "update"))
        env = {"n": 1, "mode": "calm", "observation": "sincos"}
        return random_policy([(4, 3), (1, 4)], env), [{"steps": 1}]

    monkeypatch.setattr(shac, "train", trained)
    monkeypatch.setattr(Checkpoint.__init__, "__kwdefaults__", {"resume": False, "seconds": 0.0})


RESUMES = "the same command with --resume continues"


@pytest.mark.usefixtures("quick_training")
def test_the_command_keeps_the_checkpoint_of_a_policy_that_cannot_be_saved(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(files, "MAX_BYTES", 100)
    (tmp_path / "calm-1.csv").write_text("of the policy before")
    with pytest.raises(SystemExit):
        main(["train", "calm-1", "--out", str(tmp_path)])
    hint, error = capsys.readouterr().err.splitlines()
    assert RESUMES in hint
    assert "at most 100 bytes" in error
    assert {path.name for path in tmp_path.iterdir()} == {"calm-1.checkpoint", "calm-1.csv"}
    assert (tmp_path / "calm-1.csv").read_text() == "of the policy before"


@pytest.mark.usefixtures("quick_training")
def test_ctrl_c_during_the_final_evaluation_keeps_the_progress_and_says_so(
    tmp_path, monkeypatch, capsys
):
    common = ["train", "calm-1", "--out", str(tmp_path)]
    with monkeypatch.context() as patched:
        patched.setattr("npend_gym.rl.training.tasks.evaluate", interrupted)
        assert main(common) == 130
    assert RESUMES in capsys.readouterr().err
    assert main([*common, "--resume"]) == 0


@pytest.mark.usefixtures("quick_training")
def test_no_checkpoint_of_an_interrupted_run_and_no_policy_is_replaced_unasked(tmp_path, refusal):
    common, kept = ["train", "calm-1", "--out", str(tmp_path)], tmp_path / "calm-1.checkpoint"
    kept.write_bytes(b"of a longer run")
    assert "give --resume to continue it, or --overwrite to begin again" in refusal(*common)
    assert kept.read_bytes() == b"of a longer run"
    assert main([*common, "--overwrite"]) == 0
    assert not kept.exists()
    assert "give --overwrite to train it again" in refusal(*common)
    assert main([*common, "--overwrite"]) == 0


@pytest.mark.usefixtures("quick_training")
def test_a_training_that_is_done_removes_files_that_a_kill_has_left_half_written(tmp_path):
    others = tmp_path / ".calm-1-robust.checkpoint.00000000.part", tmp_path / ".calm-1.part"
    for path in (*others, tmp_path / ".calm-1.checkpoint.d473b518.part"):
        path.write_bytes(b"half")
    assert main(["train", "calm-1", "--out", str(tmp_path)]) == 0
    assert {*tmp_path.glob(".*")} == {*others}


def test_where_the_error_stream_is_no_terminal_lines_tell_how_far_training_is(monkeypatch, capsys):
    monkeypatch.setattr(_progress, "SECONDS", 0.0)
    kept = Checkpoint(shac.settings_of("calm-2"))
    assert list(kept.rounds({}, 3, "calm-2", "updates")) == [1, 2, 3]
    assert capsys.readouterr().err == "calm-2: 1 of 3 updates\ncalm-2: 2 of 3 updates\n"
    assert list(kept.rounds({}, 3, None, "updates")) == [1, 2, 3]
    assert capsys.readouterr().err == ""
