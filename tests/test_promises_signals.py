"""Ctrl-C is heard within two seconds, whatever is being computed; no process is left behind."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from functools import partial
from pathlib import Path

import gymnasium as gym
import numpy as np
import psutil
import pytest
from interrupt import PATIENCE, Interrupt
from test_simulate_many import DOUBLE, drive, slow_drive

from npend_gym import Chain, Event, Signal, chaos, pseudo_periods, simulate
from npend_gym.cli import main
from npend_gym.cli.common import Parser, dispatch

ROOT = Path(__file__).parent.parent
pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals")


ENDLESS = {
    "rk4 in one interval": lambda: simulate(
        Chain.uniform(5), 0.1, 0.0, [0.0, 1e4], method="rk4", dt=1e-6
    ),
    "dop853": lambda: simulate(Chain.uniform(50), 1.5, 0.0, [0.0, 1e6]),
    "pseudo-periods": lambda: pseudo_periods(Chain.uniform(2000), 0.7),
    "many pseudo-periods in threads": lambda: pseudo_periods(
        Chain.uniform(300), np.full((64, 300), 0.7), threads=2
    ),
}


def motion(theta=(2.0, 1.0), **given):
    return simulate(DOUBLE, theta, 0.0, [0.0, 1e6], **given)


ANGLES = np.random.default_rng(5).uniform(-1.5, 1.5, (5000, 2))
LONG = {
    "a torque in Python": partial(motion, torque=slow_drive),
    "a compiled torque": partial(motion, torque=drive),
    "a signal": partial(motion, torque=Signal([0.0, 1e7], [0.1, -0.1], "linear")),
    "an event": partial(motion, events=[Event("velocity")]),
    "motions": partial(motion, np.ones((40, 2))),
    "motions in threads": partial(motion, np.ones((40, 2)), threads=2),
    **{
        measure.__name__: partial(measure, Chain.uniform(300), 1.0, duration=1e4)
        for measure in (chaos.lyapunov_spectrum, chaos.megno, chaos.poincare_section)
    },
    "stroboscopic_section": lambda: chaos.stroboscopic_section(
        Chain.uniform(300), 1.0, period=1.0, count=10_000
    ),
    "orbits": lambda: chaos.periodic_orbits(Chain.uniform(60), 59, amplitudes=[2.0]),
    "flips": lambda: chaos.flip_times(DOUBLE, ANGLES + np.sign(ANGLES), duration=1e4),
}
ENDLESS |= {name: pytest.param(work, marks=pytest.mark.long) for name, work in LONG.items()}


@pytest.mark.parametrize("work", ENDLESS.values(), ids=ENDLESS)
def test_endless_computations_hear_ctrl_c(work):
    with Interrupt(), pytest.raises(KeyboardInterrupt):
        work()


@pytest.mark.parametrize(("lanes", "threads"), [(None, 1), (40, 1), (40, 2)])
def test_a_step_that_takes_for_ever_hears_ctrl_c_and_wants_a_reset(lanes, threads):
    options = {"n": 300, "dt": 1e-3, "substeps": 100_000}
    if lanes is None:
        env, action = gym.make("NPendulum-v0", **options).unwrapped, np.zeros(1)
    else:
        env = gym.make_vec("NPendulum-v0", num_envs=lanes, threads=threads, **options)
        action = np.zeros((lanes, 1))
    env.reset(seed=0)
    with Interrupt(), pytest.raises(KeyboardInterrupt):
        env.step(action)
    with pytest.raises(RuntimeError, match=r"call reset\(\)"):
        env.step(action)
    env.reset(seed=0)
    began = time.perf_counter()
    env.close()
    assert time.perf_counter() - began < PATIENCE


def test_a_command_hears_ctrl_c_and_leaves_with_130(capsys):
    with Interrupt():
        assert main(["release", "--n", "3000"]) == 130
    assert "interrupted" in capsys.readouterr().err


@pytest.fixture
def sending(monkeypatch, tmp_path):
    """A function: it runs a command that sends itself signals while it writes over a film."""
    old = {number: signal.getsignal(number) for number in (*ENDING, signal.SIGINT)}
    film = tmp_path / "a.gif"
    film.write_text("old")

    def send(*numbers, handlers):
        def write(_film, file, *_):
            file.write(b"half")
            for number in numbers:
                signal.raise_signal(number)

        for number, handler in handlers.items():
            signal.signal(number, handler)
        monkeypatch.setattr("npend_gym.report.animation._write_gif", write)
        code = main(["simulate", "-n", "1", "--duration", "1", "--film", str(film)])
        assert {number: signal.getsignal(number) for number in handlers} == handlers
        assert list(tmp_path.iterdir()) == [film]
        return code, film.read_text()

    yield send
    for number, handler in old.items():
        signal.signal(number, handler)


ENDING = (signal.SIGTERM, signal.SIGHUP) if os.name == "posix" else ()
DEFAULT = dict.fromkeys(ENDING, signal.SIG_DFL)


@pytest.mark.parametrize("times", [1, 2])  # `timeout` sends two
@pytest.mark.parametrize("at_ctrl_c", [signal.default_int_handler, signal.SIG_IGN])
@pytest.mark.parametrize("number", ENDING)
def test_sigterm_and_sighup_keep_the_old_file_and_leave_nothing_half_written(
    number, at_ctrl_c, times, sending, capsys
):
    handlers = DEFAULT | {signal.SIGINT: at_ctrl_c}
    assert sending(*[number] * times, handlers=handlers) == (128 + number, "old")
    assert capsys.readouterr().err.endswith("npend simulate: interrupted\n")


def test_a_command_leaves_alone_signals_that_are_ignored(sending):
    handlers = dict.fromkeys(ENDING, signal.SIG_IGN)
    assert sending(*ENDING, handlers=handlers) == (0, "half")


def test_a_command_runs_in_a_thread_of_another_program(capsys):
    codes = []
    thread = threading.Thread(target=lambda: codes.append(main(["examples"])))
    thread.start()
    thread.join()
    assert codes == [0], capsys.readouterr().err


@pytest.mark.long
def test_sigterm_ends_the_process_and_leaves_no_orphan():
    code = (
        "import gymnasium as gym, numpy as np, npend_gym, sys\n"
        "from gymnasium.vector import AsyncVectorEnv\n"
        "env = AsyncVectorEnv([lambda: gym.make('npend_gym:NPendulum-v0')] * 2)\n"
        "env.reset(); print('ready', flush=True)\n"
        "while True: env.step(env.action_space.sample())\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "ready\n"
    children = psutil.Process(process.pid).children(recursive=True)
    assert len(children) >= 2
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=10) == -signal.SIGTERM
    _, alive = psutil.wait_procs(children, timeout=10)
    process.stdout.close()
    for child in alive:
        child.kill()
    assert not alive


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")  # Gymnasium's own, about the worker that is gone
def test_a_killed_worker_of_a_vector_env_is_an_error_and_no_hang():
    env = gym.vector.AsyncVectorEnv([lambda: gym.make("npend_gym:NPendulum-v0")] * 2)
    env.reset(seed=0)
    os.kill(env.processes[1].pid, signal.SIGKILL)
    began = time.perf_counter()
    with pytest.raises((OSError, EOFError)):
        env.step(np.zeros((2, 1), np.float32))
    assert time.perf_counter() - began < 10.0
    with contextlib.suppress(Exception):
        env.close(terminate=True)


def test_a_closed_pipe_is_a_failure_without_a_traceback():
    process = subprocess.Popen(
        [sys.executable, "-m", "npend_gym", "examples"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    process.stdout.close()
    _, error = process.communicate(timeout=120)
    assert process.returncode == 1
    assert error == "npend examples: the output was closed before its end\n"


def npend(line, *, closed="", **options):
    """Run a command line, with streams that the shell has closed."""
    program = [sys.executable, "-m", "npend_gym", *line.split()]
    return subprocess.run(
        ["sh", "-c", f'exec "$@" {closed}', "sh", *program],
        capture_output=True, text=True, check=False, timeout=300, **options,
    )  # fmt: skip


LINES = [
    "examples", "--version", "release --help", "release --n 1 --json",
    "release --n 1 --trials 1 --page a.html",
]  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("line", LINES)
def test_closed_streams_lose_what_is_printed_and_nothing_else(line, tmp_path):
    def in_folder(name, closed):
        (tmp_path / name).mkdir()
        done = npend(line, closed=closed, cwd=tmp_path / name)
        files = sorted(path for path in (tmp_path / name).rglob("*") if path.is_file())
        return done, [path.relative_to(tmp_path / name) for path in files]

    usual, files = in_folder("usual", "")
    assert usual.returncode == 0
    done, written = in_folder("stdout", ">&-")
    command = "" if line.startswith("-") else f" {line.split()[0]}"
    assert done.stderr.endswith(f"npend{command}: the output was closed before its end\n")
    assert "Traceback" not in done.stderr
    assert (done.returncode, done.stdout, written) == (1, "", files)
    done, written = in_folder("stderr", "2>&-")
    assert (done.returncode, done.stdout, written) == (0, usual.stdout, files)
    done, written = in_folder("both", ">&- 2>&- <&-")
    assert (done.returncode, done.stdout + done.stderr, written) == (1, "", files)


@pytest.mark.long
@pytest.mark.parametrize("line", ["fly", "release --n 0"])
def test_bad_arguments_are_refused_with_closed_streams_too(line):
    usual = npend(line)
    assert usual.returncode == 2
    assert npend(line, closed=">&-").stderr == usual.stderr
    done = npend(line, closed="2>&-")
    assert (done.returncode, done.stdout, done.stderr) == (2, "", "")


STARTS = {
    # what pip writes as `npend`, and what `python -m` does: it imports the package first
    "script": "from npend_gym.cli import main; sys.exit(main())",
    "module": "import runpy; del sys.argv[1:3]; "
    "runpy.run_module('npend_gym', run_name='__main__', alter_sys=True)",
}
# Prints a line when the imports that take long begin: what is before takes a millisecond or two
TELLING = f"""
import sys
sys.path.insert(0, {str(ROOT)!r})
class Telling:
    def find_spec(self, name, *_):
        if name == "npend_gym._faces":
            print(flush=True)
sys.meta_path.insert(0, Telling())
"""
LATER = (pytest.param(0.004 * 3.0**k, marks=pytest.mark.long) for k in (0, 1, 2, 4, 5))


@pytest.mark.parametrize("seconds", [0.1, *LATER])
@pytest.mark.parametrize("start", STARTS)
def test_ctrl_c_while_a_command_starts_is_one_line_and_exit_code_130(start, seconds, tmp_path):
    code = TELLING + STARTS[start]
    program = [sys.executable, "-c", code, "-m", "npend_gym"]
    if start == "script":
        (tmp_path / "npend").write_text(code)
        program = [sys.executable, str(tmp_path / "npend")]
    process = subprocess.Popen(
        [*program, "release", "--n", "3000"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    process.stdout.readline()
    time.sleep(seconds)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert len(error.splitlines()) == 1
    assert "interrupted" in error
    assert process.returncode == 130


def test_ctrl_c_in_a_compiled_import_is_an_interruption(capsys):
    def run(_):  # as modules of pybind11 do
        raise ImportError("initialization failed") from KeyboardInterrupt()

    assert dispatch(Parser(prog="npend release"), run, {}) == 130
    assert capsys.readouterr().err == "npend release: interrupted\n"
