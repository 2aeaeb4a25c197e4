"""Films: what their pictures show, and the files."""

import json
import re
import signal
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import imageio.v3 as imageio
import numpy as np
import pytest
from PIL import Image
from test_render import TIP, where

from npend_gym import Chain, __version__, simulate
from npend_gym.cli import main
from npend_gym.experiments import ReleaseExperiment, measure
from npend_gym.identification import read_motion
from npend_gym.recording import (
    record_episode,
    record_motion,
    record_release,
    record_simulation,
)
from npend_gym.report import animation
from npend_gym.report.animation import Film, _draw, write


def film(n=3, *, duration=None, size=240, **options):
    plan = ReleaseExperiment(n_values=[n], trials=1, duration=duration)
    interval = options.get("speed", 1.0) / options.get("fps", 25.0)
    return Film(
        record_release(plan, measure(plan, *plan.runs()[0]), interval), size=size, **options
    )


def tip_of(picture, size):
    return where(picture[:, :size], TIP)


@pytest.mark.parametrize("n", [1, 2, 30, 200])
def test_the_tip_moves_in_the_film_as_in_the_motion(n):
    shown = film(n, duration=2.0)
    motion = shown.recording.motion
    for k in (0, 20, 50):
        x, y = motion.positions()[k, -1] / motion.chain.total_length
        expected = 120 + 0.44 * 240 * np.array([x, -y])
        np.testing.assert_allclose(tip_of(shown.picture(k), 240), expected, atol=1.0)


def test_a_film_of_an_episode_on_a_cart_shows_what_the_environment_renders():
    keywords = {"n": 2, "mode": "swingup", "base": "cart"}
    recording = record_episode(lambda *_: np.array([[0.6]]), keywords, seed=3, seconds=1.5)
    shown = Film(recording, fps=20.0, size=160, diagrams=False)
    env = gym.make("NPendulum-v0", render_mode="rgb_array", render_size=160, **keywords)
    env.reset(seed=3)
    env.step(np.array([0.6], np.float32))
    for k in range(1, recording.motion.times.size - 1):
        # the force of a step is shown before it in films, and here after it; traces begin elsewhere
        np.testing.assert_allclose(shown.picture(k).astype(int), env.render(), atol=8)
        env.step(np.array([0.6], np.float32))
    assert np.ptp(recording.cart()) > 0.05


def far_motion(case):
    """A motion of two rods that goes further than the chain is long."""
    times = np.linspace(0.0, 2.0, 51)
    if case == "springs":
        return simulate(Chain([1.0, 1.0], [1.0, 1.0], stiffness=60.0), 1.5, 0.0, times)
    return simulate(Chain.dm_control("cartpole", 2), 2.5, 0.0, times, velocity=3.0)


@pytest.mark.parametrize(
    "case", [pytest.param("springs", marks=pytest.mark.long), "links on a cart"]
)
def test_the_tip_is_in_every_picture_of_a_film_that_keeps_one_scale(case):
    motion = far_motion(case)
    shown = Film(record_motion(motion), size=240, diagrams=False)
    places = motion.positions()
    if case == "links on a cart":
        places += motion.position[:, None, None] * [1.0, 0.0]
    reach = np.abs(places).max()
    assert reach > 1.3 * motion.chain.total_length
    # a link is a bar, seen by its middle
    seen = places[:, -1] if case == "springs" else places.mean(axis=1)
    for k in range(0, 51, 10):
        expected = 120 + 0.44 * 240 * seen[k] * (1.0, -1.0) / reach
        np.testing.assert_allclose(tip_of(shown.picture(k), 240), expected, atol=1.0)


def test_the_diagrams_appear_from_left_to_right():
    shown = film()
    diagrams = [shown.picture(k)[:, 240:].astype(int) for k in (0, 40, len(shown) - 1)]
    colored = [np.flatnonzero((np.ptp(d, axis=-1) > 60).any(axis=0)) for d in diagrams]
    widths = [columns[columns < 230].size for columns in colored]  # without the legend's rows
    assert widths[0] < widths[1] < widths[2]
    upper = [(np.ptp(d[:120], axis=-1) > 60).any(axis=0).sum() for d in diagrams]
    assert upper[0] == 0
    assert 0 < upper[1] < upper[2]


def test_a_film_without_diagrams_is_the_left_half_of_one_with_them():
    whole, plain = film(), film(diagrams=False)
    assert plain.picture(20).shape == (240, 240, 3)
    assert np.array_equal(plain.picture(20), whole.picture(20)[:, :240])


def test_a_bob_is_dotted_once_it_has_completed():
    shown = film(1, duration=3.0, size=480)
    (period,) = shown.recording.periods
    x, y = shown.recording.turning_points()[0]
    row, column = (np.array([240 - 0.44 * 480 * y, 240 + 0.44 * 480 * x])).astype(int)
    completed = int(np.ceil(period * 25.0))
    for k in sorted({*range(0, len(shown), 12), completed - 1, completed, completed + 1}):
        assert (shown.picture(k)[row, column].max() < 80) == (k >= completed), k


def test_the_speed_sets_how_many_pictures_a_motion_has():
    assert len(film(2, duration=4.0)) == 101
    assert len(film(2, duration=4.0, speed=2.0)) == 51
    assert len(film(2, duration=4.0, fps=10.0, speed=0.5)) == 81


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # imageio's reader
@pytest.mark.parametrize("suffix", [".gif", pytest.param(".mp4", marks=pytest.mark.long)])
def test_a_file_has_every_picture_and_is_the_same_bytes_when_written_again(suffix, tmp_path):
    shown = film(2, duration=1.0)
    first, second = (write(shown, tmp_path / f"{k}{suffix}") for k in (1, 2))
    assert first.read_bytes() == second.read_bytes()
    assert [path.name for path in sorted(tmp_path.iterdir())] == [f"1{suffix}", f"2{suffix}"]
    read = imageio.imread(first)
    assert read.shape[:3] == (26, 240, 480)
    for k in (0, 13, 25):  # colours are fewer in the file
        assert np.abs(read[k, ..., :3].astype(int) - shown.picture(k)).mean() < 2.0


@pytest.mark.parametrize("fps", [7.0, 25.0, 30.0, 40.0])
def test_a_gif_plays_at_its_speed(fps, tmp_path):
    shown = film(1, duration=0.7, size=120, fps=fps, diagrams=False)
    with Image.open(write(shown, tmp_path / "a.gif")) as image:
        delays = [_delay(image, k) for k in range(image.n_frames)]
    assert len(delays) == len(shown)
    ends = np.cumsum(delays) - 1000.0 / fps * np.arange(1, len(shown) + 1)
    assert np.abs(ends).max() <= 5.0  # ms
    with pytest.raises(ValueError, match=r"fps must be at most 50 in a GIF.*got 60: write"):
        write(film(1, duration=0.7, size=120, fps=60.0), tmp_path / "b.gif")


def test_a_gif_refuses_pictures_that_would_stand_longer_than_its_delays_can_say(tmp_path):
    slow = Film(film(1, duration=0.7).recording, fps=0.0015, size=120)
    with pytest.raises(ValueError, match=r"fps must be at least 0\.00153 in a GIF.*got 0\.0015"):
        write(slow, tmp_path / "a.gif")
    with pytest.raises(ValueError, match="fps must be at least"):
        slow._repr_html_()
    slow = Film(slow.recording, fps=0.00153, size=120)
    with Image.open(write(slow, tmp_path / "a.gif")) as image:
        assert image.info["duration"] == pytest.approx(1000.0 / 0.00153, abs=10.0)


def test_a_gif_refuses_a_chain_that_stands_still_for_longer(tmp_path):
    still = simulate(Chain.uniform(1), 0.0, 0.0, np.linspace(0.0, 700.0, 36))
    with pytest.raises(ValueError, match=r"stand still for more than 655 s in a GIF: write an"):
        still.animate(tmp_path / "a.gif", size=120, fps=0.05)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("change", [{"fps": 1e12}, {"speed": 1e-12}])
def test_a_film_of_more_pictures_than_anyone_can_hold_is_refused_before_it_is_made(change):
    with pytest.raises(ValueError, match=r"at most 20000000 angles.*lower fps or raise speed"):
        Film(film(2, duration=0.2).recording, **change)


def _delay(image, k):
    image.seek(k)
    return image.info["duration"]


def test_the_energy_of_a_counterweight_is_within_the_diagram():
    chain = Chain([5.0, 0.1], [1.0, 0.5], centres=[-0.3, 0.25], inertias=[0.1, 0.1])
    motion = simulate(chain, 0.4, 0.0, np.linspace(0.0, 1.0, 21))
    lowest = (motion.energy() - motion.kinetic_energy()).min()
    assert _draw(record_motion(motion)).axes[1].get_ylim()[0] <= lowest < 0.0


@pytest.mark.long
def test_the_comment_of_a_file_says_what_made_it(tmp_path):
    shown = film(2, duration=0.2)
    with Image.open(write(shown, tmp_path / "a.gif")) as image:
        about = json.loads(image.info["comment"])
        assert image.info["duration"] == 40
    assert about["version"] == __version__
    assert about["arguments"]["n_values"] == [2]
    text = json.dumps(about).encode()
    assert text in write(shown, tmp_path / "a.mp4").read_bytes()


@pytest.mark.long
def test_an_interrupted_film_leaves_nothing(tmp_path):
    def interrupting(_pictures):
        raise KeyboardInterrupt

    for suffix in (".gif", ".mp4"):
        with pytest.raises(KeyboardInterrupt):
            write(film(1, duration=0.2), tmp_path / f"a{suffix}", interrupting)
    assert not list(tmp_path.iterdir())


def test_an_interrupted_film_leaves_no_program_that_runs_on(tmp_path, monkeypatch):
    slow, started = tmp_path / "ffmpeg", []
    slow.write_text("#!/bin/sh\nexec sleep 100\n")
    slow.chmod(0o755)

    class Watched(subprocess.Popen):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            started.append(self)

    def interrupting(_pictures):
        raise KeyboardInterrupt

    monkeypatch.setattr(animation, "_ffmpeg", lambda: str(slow))
    monkeypatch.setattr(animation, "Popen", Watched)
    with pytest.raises(KeyboardInterrupt):
        write(film(1, duration=0.2), tmp_path / "a.mp4", interrupting)
    assert [program.returncode for program in started] == [-signal.SIGKILL]


def test_a_film_that_the_disk_cannot_take_leaves_the_old_file(tmp_path):
    resource = pytest.importorskip("resource", reason="POSIX")
    path, limits = tmp_path / "12:30.mp4", resource.getrlimit(resource.RLIMIT_FSIZE)
    shown = film(1, duration=2.0)
    write(film(1, duration=0.2), path)
    old = path.read_bytes()
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(old), limits[1]))
    try:
        with pytest.raises(OSError, match=r"\[Errno 5\] .*12:30"):
            write(shown, path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert path.read_bytes() == old
    assert [*tmp_path.iterdir()] == [path]


def test_torques_that_noise_takes_beyond_their_limit_are_drawn_at_it():
    recording = record_episode(
        lambda _observation, _info: np.ones((1, 1)),
        {"mode": "swingup", "n": 2, "action_delay": 0.3, "torque_noise": 0.5},
        seconds=0.5,
    )
    assert recording.torque.max() > 1.0
    most = int(recording.torque.argmax())
    assert Film(recording, fps=20.0, size=120).scene(most).torque == 1.0


@pytest.mark.parametrize(
    ("arguments", "shape", "made_by"),
    [
        ("--theta 2,1 --duration 1 --fps 10", (11, 120, 240), {"theta": [2.0, 1.0]}),
        ("--plain --n 1 --duration 0.2", (6, 120, 120), {"definition": "bob"}),
        ("swingup-1 --duration 2", (41, 120, 240), {"policy": "swingup-1"}),
    ],
    ids=["a release", "the chain alone", "a policy"],
)
def test_simulate_films_what_the_comment_of_the_file_names(
    arguments, shape, made_by, tmp_path, capsys
):
    out = tmp_path / "new" / "a.gif"
    assert main(["simulate", *arguments.split(), "--size", "120", "--film", str(out)]) == 0
    assert f"{shape[0]} pictures, " in capsys.readouterr().out
    assert imageio.improps(out).shape[:3] == shape
    with Image.open(out) as image:
        about = json.loads(image.info["comment"])
    assert about["arguments"].items() >= made_by.items()


def test_simulate_prints_the_ends_of_a_motion_and_writes_what_identify_reads(tmp_path, capsys):
    out = tmp_path / "new" / "motion.csv"
    line = f"simulate --theta 120deg,-10deg --omega 0,1 --duration 3 --csv {out} --interval 0.1"
    assert main(line.split()) == 0
    printed = capsys.readouterr().out
    start = np.radians([120.0, -10.0])
    expected = simulate(Chain.uniform(2), start, [0.0, 1.0], 0.1 * np.arange(31))
    for k, at in enumerate(zip(start, expected.theta[-1], expected.omega[-1], strict=True), 1):
        (row,) = [words for words in map(str.split, printed.splitlines()) if words[:1] == [str(k)]]
        np.testing.assert_allclose([float(row[i]) for i in (1, 3, 4)], at, atol=1e-6)
    assert f"energy {expected.energy()[0]:.6g} J" in printed
    motion = read_motion(out)
    np.testing.assert_array_equal(motion.times, expected.times)
    np.testing.assert_array_equal(motion.theta, expected.theta)


@pytest.mark.parametrize(
    ("module", "option"),
    [
        ("pygame", "--film a.gif"),
        ("imageio_ffmpeg", "--film a.mp4"),
        ("matplotlib", "--plot a.png"),
    ],
)
@pytest.mark.parametrize("what", ["-n 1", "swingup-1"])
def test_what_a_film_or_a_plot_needs_is_checked_before_anything_is_simulated(
    module, option, what, tmp_path, monkeypatch, capsys
):
    def simulated(*_, **__):
        raise AssertionError

    for name in ("record_simulation", "record_episode"):
        monkeypatch.setattr(f"npend_gym.recording.{name}", simulated)
    monkeypatch.setitem(sys.modules, module, None)  # importing it fails
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", *what.split(), *option.split()]) == 1
    error = capsys.readouterr().err
    assert re.search(f"need {module}: install it with pip install .npend-gym", error)
    assert list(tmp_path.iterdir()) == []


def test_simulate_plots_a_motion_of_a_chain_from_a_file(tmp_path):
    (tmp_path / "chain.json").write_text(json.dumps(Chain.acrobot().as_dict()))
    out = tmp_path / "motion.png"
    chain = str(tmp_path / "chain.json")
    assert main(["simulate", "--chain", chain, "--duration", "1", "--plot", str(out)]) == 0
    with Image.open(out) as image:
        assert image.size > (600, 500)


def test_the_hero_film_shows_the_release_that_its_comment_names():
    path = Path(__file__).parent.parent / "docs" / "images" / "hero.gif"
    assert path.stat().st_size < 2_000_000
    with Image.open(path) as image:
        about = json.loads(image.info["comment"])
        image.seek(120)
        shown = np.asarray(image.convert("RGB")).astype(int)
    arguments = about["arguments"]
    chain = Chain.from_dict(arguments.pop("chain"))
    assert chain == Chain.uniform(20)
    start = (arguments.pop(name) for name in ("theta", "omega", "seconds"))
    (recording,) = record_simulation(chain, *start, 1.0 / about["fps"], **arguments)
    again = Film(recording, fps=about["fps"], size=shown.shape[0]).picture(120)
    assert np.abs(shown - again).mean() < 2.0
