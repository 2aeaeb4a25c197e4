"""Files from elsewhere: what they hold is checked before it is used, and refused in one line."""

import json
import shutil
import tracemalloc
import warnings

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from campaign_tables import completed, part_of
from policy_files import header, save_changed, small_policy
from readers import PLAN, resting_plans

from npend_gym._files import part_digest
from npend_gym.cli import main
from npend_gym.envs.registration import TASKS
from npend_gym.experiments import analyse
from npend_gym.rl import PlannedTransitions, Policy
from npend_gym.rl.policies.shipped import find_policy


def write_policy(path, env=None, **arrays):
    """Write a policy of the swing-up of two rods, or one with other arrays and another env."""
    described = {"n": 2, "mode": "swingup", "observation": "sincos"} if env is None else env
    about = json.dumps({"env": described})
    save_changed(small_policy(scale=np.ones(6)), path, about, **arrays)
    return path


# What describes a policy


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"[]", "must be an object"),
        (b"3", "must be an object"),
        (b"null", "must be an object"),
        (b'"env"', "must be an object"),
        (b"{", "Expecting property name"),
        (b"{}", "env must be an object"),
        (b"[" * 100_000, "nested too deep"),
        (b'{"env": {}, "x": ' + b"[" * 100_000 + b"]" * 100_000 + b"}", "nested too deep"),
        (b'{"env": {}, "x": ' + b"[" * 40 + b"]" * 40 + b"}", "nested deeper than 32"),
        (b'{"env": {}, "x": "\xff"}', "(invalid utf-8|InvalidHeader)"),  # by new and old libraries
        (b'{"env": [["n", 2]]}', "env must be an object"),
        (b'{"env": null}', "env must be an object"),
        (b" " * 20_000_001, "at most 20000000"),
    ],
)
def test_what_is_no_description_is_refused_by_its_path(text, message, tmp_path):
    path = tmp_path / "a.safetensors"
    whole = header(__metadata__={"npend_gym": text.decode("latin-1")})
    content = whole[8:].replace(b"\\u00ff", b"\xff")  # as the bytes that were given
    path.write_bytes(len(content).to_bytes(8, "little") + content)
    with pytest.raises(
        ValueError, match=rf"a\.safetensors (is no|does not describe a) policy.*{message}"
    ):
        Policy.load(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"n": 1_000_000}, "n must be between 1 and 6"),
        ({"n": 1.5}, "n must be an integer"),
        ({"n": 1}, "observes 3 numbers"),
        ({"chain": {"masses": [1.0] * 5, "lengths": 1.0}, "n": None}, "n must be an integer"),
        ({"chain": "fit.json"}, "its chain must be a preset's name or parameters"),
        ({"dt": 1e-9}, "dt must be at least 0.0001"),
        ({"dt": -1.0}, "dt must be greater"),
        ({"dt": 1e6}, "dt must be at most 100"),
        ({"render_mode": "human"}, "render_mode"),
        ({"max_episode_steps": 0}, "max_episode_steps"),
        ({"mode": "os:system"}, "trust=True"),
        ({"mode": 3}, "mode must be one of"),
        ({"actuated": [0, 1]}, "2 motors"),
        ({"torque_levels": 3}, "torque_levels must be left out"),
        ({"goal_env": True, "mode": "transition"}, "goal_env must be left out"),
        ({"masses": [1.0, -1.0]}, "masses must be greater"),
        ({"masses": "heavy"}, "masses must"),
        ({"gravity": {"a": 1}}, "gravity must be"),
        ({"randomize": {"masses": [1e300, 1e301]}}, "masses"),
    ],
)
def test_a_policy_for_no_sound_environment_is_refused(change, message, tmp_path):
    env = {"n": 2, "mode": "swingup", "observation": "sincos"} | change
    path = write_policy(tmp_path / "a.safetensors", env)
    with pytest.raises(ValueError, match=rf"a\.safetensors is no policy.*{message}"):
        Policy.load(path)


def test_a_mode_of_ones_own_is_imported_only_when_the_file_is_trusted(tmp_path, monkeypatch):
    (tmp_path / "own_task.py").write_text(
        "from pathlib import Path\nfrom npend_gym.envs import SwingUp\n"
        "Path('imported').touch()\nclass Own(SwingUp):\n    name = 'own'\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    env = {"n": 2, "mode": "own_task:Own", "observation": "sincos"}
    path = write_policy(tmp_path / "a.safetensors", env)
    for refused in (lambda: Policy.load(path), lambda: find_policy(str(path))):
        with pytest.raises(ValueError, match="trust=True"):
            refused()
    assert not (tmp_path / "imported").exists()
    assert Policy.load(path, trust=True).env == env
    assert (tmp_path / "imported").exists()


def test_a_policy_for_an_id_of_the_package_needs_no_trust(tmp_path):
    env = {"n": 2, "observation": "sincos"} | TASKS["npend/DMAcrobot-v1"].keywords
    path = write_policy(tmp_path / "a.safetensors", env)
    assert Policy.load(path).config.mode.name == "dm_acrobot"


# Its numbers; for shapes see test_rl_policy_files.py


@pytest.mark.parametrize("value", [1e20, 1e28, 1e31])
def test_enormous_weights_act_within_bounds_without_a_warning_or_are_refused(value, tmp_path):
    weights = {f"weight{k}": np.full((m, n), value, "f4") for k, m, n in ((0, 4, 6), (2, 1, 4))}
    path = write_policy(tmp_path / "a.safetensors", **weights)
    if value > 1e30:
        with pytest.raises(ValueError, match="overflow"):
            Policy.load(path)
        return
    policy = Policy.load(path)
    largest = np.array([1, 1, 1, 1, 1e6, 1e6], np.float32)  # that an observation may be
    rng = np.random.default_rng(0)
    with warnings.catch_warnings(), np.errstate(all="raise", under="ignore"):
        warnings.simplefilter("error")
        for signs in rng.choice([-1.0, 1.0], (100, 6)):
            assert abs(policy(largest * signs.astype(np.float32))) <= 1.0


# Commands


def test_commands_refuse_a_policy_that_names_no_sound_environment(refusal, tmp_path):
    path = str(write_policy(tmp_path / "a.safetensors", {"n": 2, "mode": "swingup", "dt": 1e-9}))
    for command in (["simulate", "--film", str(tmp_path / "a.gif"), path],
                    ["evaluate", path]):  # fmt: skip
        assert f"{path} is no policy" in refusal(*command)


# Parts of a campaign


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    out = tmp_path_factory.mktemp("campaign")
    completed(PLAN, out)
    return out


@pytest.fixture
def forged(campaign, tmp_path):
    """A function that puts a table, or bytes, in place of a part, with the name that fits."""
    out = tmp_path / "campaign"
    shutil.copytree(campaign, out)
    task = next(PLAN.tasks())

    def forge(content, compression="none"):
        data, part = content, part_of(out, "releases", task)
        if not isinstance(content, bytes):
            table, sink = content(pq.ParquetFile(part).read()), pa.BufferOutputStream()
            pq.write_table(table, sink, compression=compression, use_dictionary=False)
            data = sink.getvalue().to_pybytes()
        part.unlink()
        forged = out / "releases" / f"{task.place}-{part_digest(PLAN.digest, data)}.parquet"
        forged.write_bytes(data)
        return out, forged

    return forge


def with_column(name, values):
    return lambda table: table.set_column(table.column_names.index(name), name, pa.array(values))


FORGERIES = {
    "empty": (b"", "Parquet"),
    "text": (b"cell,trial\n1,2\n", "Parquet"),
    "no rows": (lambda table: table.slice(0, 0), "20 rows"),
    "no column": (lambda table: table.drop_columns(["median_s"]), "columns"),
    "another column": (lambda table: table.append_column("x", table["cell"]), "columns"),
    "text in a column": (with_column("median_s", ["long"] * 20), "median_s"),
    "lists in a column": (with_column("median_s", [[1.0]] * 20), "median_s"),
    "text for numbers": (with_column("trial", ["one"] * 20), "trial"),
    "null for a count": (with_column("completed", [None] * 20), "completed"),
    "NaN": (with_column("median_s", [np.nan] * 20), "median_s"),
    "1e308": (with_column("median_s", [1e308] * 20), "median_s"),
    "minus one": (with_column("tip_s", [-1.0] * 20), "tip_s"),
    "infinite": (with_column("mean_s", [np.inf] * 20), "mean_s"),
    "another start": (with_column("start_rad", [0.9] * 20), "start_rad"),
    "no start": (with_column("start_rad", [None] * 20), "start_rad"),
    "another cell": (with_column("cell", [7] * 20), "cell"),
    "another trial": (with_column("trial", [1] * 20), "trial"),
    "too many bobs": (with_column("completed", np.full(20, 3, np.int32)), "completed"),
    "compressed": (lambda table: table, "must not be compressed", "zstd"),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", FORGERIES)
def test_a_forged_part_is_refused_by_its_path_in_one_line(kind, forged, refusal):
    content, message, *compression = FORGERIES[kind]
    out, part = forged(content, *compression)
    with pytest.raises(ValueError, match=f"{part.name}.*({message})"):
        analyse(out)
    error = refusal("analyse", str(out))
    assert str(part) in error


def test_a_part_that_expands_to_gigabytes_is_refused_without_the_memory(forged):
    def bomb(table):
        return pa.table(dict.fromkeys(table.column_names, pa.array(np.zeros(2_000_000))))

    out, part = forged(bomb, compression="zstd")
    before = pa.total_allocated_bytes()
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match=f"{part.name} is no part"):
            analyse(out)
        assert tracemalloc.get_traced_memory()[1] < 20e6
    finally:
        tracemalloc.stop()
    assert pa.total_allocated_bytes() - before < 10e6


def test_a_page_that_says_it_has_gigabytes_is_refused_without_the_memory(forged):
    out, part = forged(lambda table: table)
    whole = bytearray(part.read_bytes())
    at = pq.ParquetFile(part).metadata.row_group(0).column(5).data_page_offset
    assert whole[at : at + 3] == b"\x15\x00\x15"  # the sizes follow, in bytes of seven bits
    sizes = slice(at + 3, at + 3 + 2)
    assert whole[sizes][0] >= 128 > whole[sizes][1]
    whole[sizes] = b"\xfe\xff\xff\xff\x0f"  # 2^31 - 1
    before = pa.total_allocated_bytes()
    out, part = forged(bytes(whole))
    with pytest.raises(ValueError, match=f"{part.name} is no part"):
        analyse(out)
    assert pa.total_allocated_bytes() - before < 10e6


def test_a_plan_of_a_folder_from_elsewhere_is_checked_before_it_is_used(tmp_path, refusal):
    for text, message in (
        ("[]", "must be an object"),
        ("[" * 100_000, "nested too deep"),
        ('{"version": [1], "digest": 2, "plan": 3}', "damaged|version"),
    ):
        (tmp_path / "plan.json").write_text(text)
        with pytest.raises(ValueError, match=rf"plan\.json.*({message})"):
            analyse(tmp_path)
        assert "plan.json" in refusal("analyse", str(tmp_path))


def test_a_campaign_is_analysed_when_nothing_is_forged(forged, capsys):
    out, _ = forged(lambda table: table)
    assert main(["analyse", str(out)]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.long  # kernels of derivatives are compiled
@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("settle", 0.0),
        ("settle", [0.0, np.nan]),
        ("settle", [0.0, -1.0]),
        ("pairs", [[["no"], ["no"]], [["yes"], ["yes"]]]),
        ("pairs", [[[True], [False]], [[True], [True]]]),
        ("states", np.zeros((2, 4, 2), complex)),
        ("states", np.full((2, 4, 2), 1e300)),
        ("states", np.full((2, 4, 2), np.nan)),
        ("actions", np.zeros(6)),
        ("actions", np.full((2, 3, 1), np.inf)),
    ],
)
def test_forged_plans_of_transitions_are_refused_by_their_path(name, value, tmp_path):
    path = tmp_path / "plans.npz"
    config = resting_plans(path)
    assert PlannedTransitions.load(path, config).plans.keys() == {
        ((False,), (False,)), ((True,), (True,))
    }  # fmt: skip
    with np.load(path) as data:
        np.savez(path, **dict(data) | {name: np.array(value)})
    with pytest.raises(ValueError, match=r"plans\.npz holds (no )?plans"):
        PlannedTransitions.load(path, config)
