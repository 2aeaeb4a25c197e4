"""The package keeps to itself: no network, no home, no terminal, nothing written elsewhere."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import npend_gym

WATCHED = """
import os, sys
allowed = {allowed!r}
def watch(event, arguments):
    if event.startswith(("socket.connect", "socket.getaddrinfo", "socket.bind", "socket.sendto")):
        os.write(2, f"NETWORK {{event}} {{arguments}}\\n".encode())
    if event == "open" and isinstance(arguments[0], str):
        writes = arguments[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        place = os.path.realpath(arguments[0])
        if writes and not place.startswith(tuple(allowed)):
            os.write(2, f"WRITTEN {{place}}\\n".encode())
sys.addaudithook(watch)
"""

WORK = """
import gymnasium as gym, numpy as np
import npend_gym
from npend_gym.cli import main
assert main(["release", "--n", "1,2", "--trials", "1", "--out", "results"]) == 0
for make in (gym.make, gym.make_vec):
    env = make("NPendulum-v0", n=2, render_mode="rgb_array")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    env.render()
    env.close()
npend_gym.simulate(npend_gym.Chain.uniform(2), 0.1, 0.0, [0.0, 1.0]).save("path.npz")
npend_gym.Trajectory.load("path.npz")
os.write(2, b"THE WORK IS DONE\\n")
import socket  # what the watch must see
open("../elsewhere", "w").close()
try: socket.create_connection(("127.0.0.1", 9), 0.1)
except OSError: pass
"""


@pytest.mark.long
def test_no_connection_is_opened_and_nothing_is_written_outside_the_output(tmp_path):
    matplotlib = pytest.importorskip("matplotlib")
    pytest.importorskip("pygame")
    kernels, out = Path(npend_gym.__file__).parent / "__pycache__", tmp_path / "out"
    out.mkdir()
    fonts = matplotlib.get_cachedir()  # to list them takes seconds
    caches = [str(kernels), os.environ.get("NUMBA_CACHE_DIR", str(kernels)), fonts]
    allowed = [str(out), *caches, "/dev"]
    settings = {"MPLCONFIGDIR": fonts, "PYTHONDONTWRITEBYTECODE": "1"}
    settings["PYTHONPATH"] = str(Path(npend_gym.__file__).parent.parent)
    kept = ("PATH", "LD_LIBRARY_PATH", "SYSTEMROOT", "NUMBA_CACHE_DIR")
    settings |= {name: os.environ[name] for name in kept if name in os.environ}
    done = subprocess.run(
        [sys.executable, "-c", WATCHED.format(allowed=allowed) + WORK], cwd=out, env=settings,
        capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    of_work, _, after = done.stderr.partition("THE WORK IS DONE")
    assert "NETWORK" not in of_work
    assert "WRITTEN" not in of_work
    assert {part.name for part in out.iterdir()} <= {"results", "path.npz"}
    assert "NETWORK socket.connect" in after
    assert f"WRITTEN {tmp_path / 'elsewhere'}" in after


READ_ONLY = """
set -e
mount -t tmpfs none "$1"
cp -r "$2" "$1"
find "$1" -name __pycache__ -exec rm -r {} +
mount -o remount,ro "$1"
cd /
exec "$3" -c "$4"
"""


@pytest.mark.long
@pytest.mark.parametrize("cached", ["cache", "site/cache"])
def test_a_read_only_installation_works_without_a_home_or_a_place_for_machine_code(
    cached, tmp_path, mounting
):
    site, cache = tmp_path / "site", tmp_path / cached
    site.mkdir()
    code = (
        "import os, npend_gym\n"
        f"assert npend_gym.__file__.startswith({str(site)!r})\n"
        "assert not os.access(npend_gym.__path__[0], os.W_OK)\n"
        "from npend_gym.compiled.sincos import sincos\n"
        "print(sincos(0.0))\n"
    )
    package = Path(npend_gym.__file__).parent
    around = {"PATH": os.environ["PATH"], "PYTHONPATH": str(site), "XDG_CACHE_HOME": str(cache)}
    done = subprocess.run(
        [*mounting, "sh", "-c", READ_ONLY, "sh", site, package, sys.executable, code],
        capture_output=True,
        text=True,
        check=False,
        env=around,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "(0.0, 1.0)"
    assert bool(list(cache.rglob("*.code"))) == (cached == "cache")
    assert done.stderr.count("\n") == (cached != "cache")  # that nothing is kept
