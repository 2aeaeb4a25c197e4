"""Files: what is damaged is refused, what cannot be written leaves what was there."""

import errno
import io
import json
import os
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from damage import flipped

from npend_gym import Chain, Event, Trajectory, simulate
from npend_gym._files import disk, replacing
from npend_gym.cli import main
from npend_gym.rl import Policy

posix = pytest.mark.skipif(os.name != "posix", reason="FIFOs, devices and mounts")


@pytest.fixture(scope="module")
def path():
    return simulate(Chain([1.0, 0.5], [1.0, 0.7]), 1.0, 0.0, np.linspace(0.0, 2.0, 30))


@pytest.fixture
def file(path, tmp_path):
    path.save(tmp_path / "path.npz")
    return tmp_path / "path.npz"


def same(a, b):
    arrays = ("times", "theta", "omega")
    equal = all(np.array_equal(getattr(a, name), getattr(b, name)) for name in arrays)
    return equal and a.chain == b.chain and a.provenance == b.provenance


def same_policy(a, b):
    return a == b  # its numbers and its env


@pytest.mark.parametrize(
    ("name", "load", "equal", "message", "flips"),
    [
        ("a.npz", Trajectory.load, same, r"path must name a trajectory.*a\.npz", 300),
        ("a.safetensors", Policy.load, same_policy, r"a\.safetensors is no policy", 150),
    ],
)
def test_a_file_cut_anywhere_is_refused_and_a_flipped_bit_too_or_it_changes_nothing_that_is_read(
    name, load, equal, message, flips, path, tmp_path
):
    file, rng, refused = tmp_path / name, np.random.default_rng(0), 0
    (path if name == "a.npz" else Policy.pretrained("balance-1")).save(file)
    whole, good = file.read_bytes(), load(file)
    for percent in range(100):
        file.write_bytes(whole[: len(whole) * percent // 100])
        with pytest.raises(ValueError, match=message):
            load(file)
    for damaged in flipped(whole, rng.choice(8 * len(whole), flips, replace=False).tolist()):
        file.write_bytes(damaged)
        try:
            read = load(file)
        except ValueError:
            refused += 1
        else:
            assert equal(read, good)  # a date of the archive, say
    assert refused > 0.8 * flips


@pytest.mark.parametrize(
    "damage",
    [
        lambda _: b"PK",
        lambda _: b"times,theta\n",
        lambda whole: whole.replace(b"\n", b"\r\n"),
        lambda whole: b"\xef\xbb\xbf" + whole[:-1],
    ],
    ids=["PK", "text", "CRLF", "BOM"],
)
def test_what_is_no_trajectory_is_refused(file, damage):
    file.write_bytes(damage(file.read_bytes()))
    with pytest.raises(ValueError, match="path must name a trajectory"):
        Trajectory.load(file)


def rewritten(file, **change):
    """Write `file` anew with other arrays."""
    with np.load(file) as data:
        arrays = dict(data) | change
    np.savez(file, **arrays)


TWO_RODS = {"masses": [1, 1], "lengths": 1}
RECIPE = {
    "method": "rk4", "settings": {"dt": 0.1}, "torque": [0.0, 0.0], "force": 0.0,
    "pivot_acceleration": None,
}  # fmt: skip


def about(chain=TWO_RODS, provenance=None, **recipe):
    """Return the text in an archive, with a recipe that is changed."""
    described = {"chain": chain, "provenance": {} if provenance is None else provenance}
    described |= {"recipe": RECIPE | recipe} if recipe else {}
    return {"about": np.array(json.dumps(described))}


def test_an_archive_that_tells_how_it_was_made_is_read(file):
    rewritten(file, **about(force=0.0))
    assert Trajectory.load(file).recipe.settings == {"dt": 0.1}


@pytest.mark.parametrize(
    "change",
    [
        {"theta": np.zeros((30, 3))},
        {"times": np.zeros((30, 1))},
        {"omega": np.full((30, 2), np.nan)},
        {"theta": np.array([["a"] * 2] * 30)},
        {"position": np.zeros(30), "velocity": np.zeros(30)},  # of a pivot: two numbers
        {"counts": np.zeros(2, int)},
        {"times": np.linspace(2.0, 0.0, 30)},
        {"status": np.zeros(30, int)},
        {"status": np.array(7)},
        {"counts": np.full(3, -1)},
        {
            "t_events_0": np.ones(2),
            "theta_events_0": np.ones((1, 2)),
            "omega_events_0": np.ones((2, 2)),
        },
        {"about": np.array("{}")},
        {"about": np.array("[" * 100_000)},
        about({"masses": [1, -1], "lengths": 1}),
        about(provenance=3),
        about(),
        about(TWO_RODS | {"base": {"mass": -1.0}}),
        about(TWO_RODS | {"base": {"mass": 1.0}}),  # a cart, and no position of it
        about(method="euler"),
        about(settings={"rtol": 0.0}),
        about(torque=[0.0, 0.0, 0.0]),
        about(torque=[[0.0, 0.0]]),
        about(force=[0.0]),
        about(torque={"signal": {"times": [1.0, 0.0], "values": [0.0, 1.0]}}),
        about(torque={"lambda": "os.mkdir"}),
        about(force="strong"),
        about(pivot_acceleration=[1.0]),
    ],
)
def test_a_whole_archive_of_something_else_is_refused(file, change):
    rewritten(file, **change)
    with pytest.raises(ValueError, match="path must name a trajectory"):
        Trajectory.load(file)


OTHER_ROD = TWO_RODS | {"lengths": 2}


@pytest.mark.parametrize(
    "change",
    [
        {"t_events_0_sizes": np.array([3, -1])},
        {"t_events_0_sizes": np.array([1.0, 1.0])},
        {"t_events_0_sizes": np.array([2])},
        {"chains": [TWO_RODS]},
        {"chains": [OTHER_ROD, TWO_RODS]},
        {"chains": [TWO_RODS, {"masses": [1, 1, 1], "lengths": 1}]},
        {"recipe": RECIPE | {"torque": [[0.0, 0.0]] * 5}},
        {"recipe": RECIPE | {"force": [0.0] * 5}},
    ],
)
def test_an_archive_whose_parts_are_of_other_motions_is_refused(change, tmp_path):
    chains, file = [Chain(**TWO_RODS), Chain(**OTHER_ROD)], tmp_path / "many.npz"
    motions = simulate(chains, 1.0, 0.0, [0.0, 1.0], events=Event("angle"))
    motions.save(file)
    assert [len(found) for found in Trajectory.load(file).t_events[0]] == [1, 1]
    with np.load(file) as data:
        told = json.loads(str(data["about"]))
    arrays = {name: each for name, each in change.items() if isinstance(each, np.ndarray)}
    about = {name: each for name, each in change.items() if name not in arrays}
    rewritten(file, about=np.array(json.dumps(told | about)), **arrays)
    with pytest.raises(ValueError, match="path must name a trajectory"):
        Trajectory.load(file)


class Bomb:
    """What runs code when it is unpickled."""

    def __reduce__(self):
        return os.mkdir, ("exploded",)


def test_a_pickle_in_an_archive_is_not_run(file, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    rewritten(file, theta=np.array([Bomb()], object))
    with pytest.raises(ValueError, match="path must name a trajectory"):
        Trajectory.load(file)
    assert not (tmp_path / "exploded").exists()


def test_an_archive_that_would_fill_the_memory_is_refused(file):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": (2**36,)}
    )
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("about", "times", "theta", "omega"):
            archive.writestr(f"{name}.npy", header.getvalue())
    whole = file.read_bytes()
    with pytest.raises(ValueError, match="path must name a trajectory"):
        Trajectory.load(file)
    # or one whose directory says so
    at = whole.index(b"PK\x01\x02") + 24
    file.write_bytes(whole[:at] + b"\xfe\xff\xff\xff" + whole[at + 4 :])
    with pytest.raises(ValueError, match="path must name a trajectory"):
        Trajectory.load(file)


@posix
def test_a_fifo_or_a_folder_is_neither_read_nor_replaced(path, tmp_path):
    fifo, folder = tmp_path / "fifo.npz", tmp_path / "folder.npz"
    os.mkfifo(fifo)
    folder.mkdir()
    for place in (fifo, folder):
        with pytest.raises(ValueError, match="it is no file"):
            Trajectory.load(place)
        with pytest.raises(OSError, match=f"not a regular file.*{place.name}"):
            path.save(place)
    assert fifo.is_fifo()
    assert sorted(tmp_path.iterdir()) == [fifo, folder]


@posix
@pytest.mark.parametrize("out", ["/dev/full", "/dev/null", "/proc/nothing", "fifo"])
def test_results_go_to_no_device_and_no_fifo(out, tmp_path, refusal):
    os.mkfifo(tmp_path / "fifo")
    place = str(tmp_path / out)
    assert place in refusal("release", "--n", "1", "--trials", "1", "--out", place)


def test_an_output_that_is_a_folder_is_a_failure_that_names_it(tmp_path, capsys):
    (tmp_path / "periods.csv").mkdir()
    assert main(["release", "--n", "1", "--trials", "1", "--out", str(tmp_path)]) == 1
    error = capsys.readouterr().err
    assert error.startswith("npend release: ")
    assert error.count("\n") == 1
    assert str(tmp_path / "periods.csv") in error


def test_a_failed_write_names_the_path_and_keeps_what_was_there(tmp_path):
    target = tmp_path / "good"
    target.write_text("good")

    def fill():
        with replacing(target) as file:
            file.write("half")
            raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match=f"No space left.*{target}"):
        fill()
    assert target.read_text() == "good"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("place", ["missing/a.npz", "a.npz"])
def test_a_file_that_cannot_be_opened_or_replaced_is_named_as_the_user_named_it(
    path, place, tmp_path, monkeypatch
):
    def fail(source, target):
        raise OSError(errno.EACCES, "Permission denied", source, None, target)

    monkeypatch.setattr(disk, "replace", fail)
    with pytest.raises(OSError, match=rf"'{tmp_path / place}'$"):
        path.save(tmp_path / place)


def test_a_failure_to_read_another_file_while_writing_names_that_file(tmp_path):
    def copy():
        with replacing(tmp_path / "copy") as file:
            file.write((tmp_path / "missing").read_text())

    with pytest.raises(FileNotFoundError, match=f"'{tmp_path / 'missing'}'$"):
        copy()


@posix
@pytest.mark.parametrize("letter", ["x", "é", "𝜃"])  # of one byte, two and four
def test_a_file_may_have_any_name_that_the_system_allows(path, letter, tmp_path):
    name = letter * (251 // len(letter.encode())) + ".npz"
    path.save(tmp_path / name)
    assert same(Trajectory.load(tmp_path / name), path)


@posix
def test_nothing_is_lost_where_the_output_device_is_full():
    with open("/dev/full", "w") as full:  # noqa: PTH123
        command = [sys.executable, "-m", "npend_gym", "examples"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "No space left" in done.stderr


FULL_DISK = """
set -e
mount -t tmpfs -o size=64k none "$1"
{run} --n 1 > /dev/null
cp "$1/manifest.json" "$2"
head -c 1000000 /dev/zero > "$1/filler" 2> /dev/null || true
code=0; {run} --n 2,3 > /dev/null 2> "$3" || code=$?
cmp "$1/manifest.json" "$2"
test -z "$(ls -A "$1" | grep part)"
mount -o remount,ro "$1"
{run} --n 1 > /dev/null 2>> "$3" && code=readonly
echo "code $code"
"""


@pytest.mark.long
@posix
def test_a_full_disk_and_a_read_only_one_are_failures_that_keep_the_previous_results(
    tmp_path, mounting
):
    folder, manifest, errors = tmp_path / "disk", tmp_path / "before", tmp_path / "errors"
    folder.mkdir()
    code = "from npend_gym.cli import common; common.can_draw = lambda: False\n"
    code += "from npend_gym.cli import main, release; release.can_draw = common.can_draw\n"
    code += f"import sys; sys.exit(main(sys.argv[1:] + ['--out', {str(folder)!r}]))"
    script = tmp_path / "npend.py"
    script.write_text(code)
    run = f"{sys.executable} {script} release --trials 1"
    command = [*mounting, "sh", "-c", FULL_DISK.format(run=run), "sh", folder, manifest, errors]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(manifest.read_text())["provenance"]["arguments"]["n_values"] == [1]
    assert done.stdout.strip() in ("code 1", "code 2")
    lines = errors.read_text().strip().splitlines()
    full, read_only = [line for line in lines if "replaces the results" not in line]
    assert "No space left" in full
    assert str(folder) in full
    assert "Read-only" in read_only
    assert str(folder) in read_only
