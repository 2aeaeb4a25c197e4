"""Fixtures and strategies that several test files share."""

import gc
import os
import shutil
import signal
import subprocess
from pathlib import Path

import numpy as np
import pytest
from compiling import compile_together
from hypothesis import settings
from hypothesis import strategies as st

from npend_gym import Chain
from npend_gym.cli import main
from npend_gym.compiled import native

# Begun in the background by a shell, this process and so those of the tests would ignore Ctrl-C
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config):
    """Give the whole suite a worker per core, four at most; named files or tests run here."""
    whole = all(Path(argument).is_dir() for argument in config.args)
    return min(4, os.cpu_count() or 1) if whole else 0


# A worker has one core
os.environ.setdefault("OMP_NUM_THREADS", "1")


@pytest.fixture(scope="session", autouse=True)
def compiled(request, tmp_path_factory):
    """Share out what must be compiled before the workers begin, where there are any.

    At the end: the machine code of every kernel of the package that was called could be kept.
    """
    if hasattr(request.config, "workerinput"):
        compile_together(tmp_path_factory.getbasetemp().parent)
    yield
    assert never_kept() == []


def never_kept():
    """Return names of the package's kernels that Numba ran, which compiles in every process."""
    if native._needs_numba():
        return []
    kernels = [each for each in gc.get_objects() if type(each) is native.Kernel]
    return sorted(
        f"{each.__module__}.{each.__qualname__}"
        for each in kernels
        if "_by_numba" in vars(each) and each.__module__.startswith("npend_gym.")
    )


settings.register_profile("fixed", derandomize=True, deadline=None, max_examples=100)
settings.load_profile("fixed")


@st.composite
def chains_in_motion(draw, max_n=12):
    """A random chain with a state and torques: (chain, theta, omega, torque)."""
    n = draw(st.integers(1, max_n))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    chain = Chain(
        rng.uniform(0.2, 5.0, n),
        rng.uniform(0.2, 5.0, n),
        gravity=rng.uniform(0.0, 20.0),
        damping=rng.uniform(0.0, 2.0, n) * draw(st.booleans()),
    )
    spin = rng.normal(size=n) * 3.0
    return chain, rng.uniform(-7.0, 7.0, n), spin, rng.normal(size=n) * 20.0 * draw(st.booleans())


@pytest.fixture
def uneven():
    """A chain of four unequal rods, without damping."""
    return Chain([1.0, 0.5, 2.0, 0.8], [1.0, 0.7, 0.4, 1.3])


@pytest.fixture
def written(tmp_path):
    """A function that writes text or bytes to a file and returns its path."""

    def write(content, name="file.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


@pytest.fixture
def refusal(capsys):
    """A function that runs a command with bad arguments, and returns its one line of error."""

    def run(*arguments, main=main):
        capsys.readouterr()
        with pytest.raises(SystemExit) as caught:
            main(arguments)
        assert caught.value.code == 2
        out, error = capsys.readouterr()
        assert out == ""
        assert len(error.strip().splitlines()) == 1
        return error

    return run


@pytest.fixture(scope="session")
def mounting():
    """The beginning of a command whose mounts are its own; skipped where it may make none."""
    prefix = ["unshare", "--mount"]
    attempt = [*prefix, "sh", "-c", "mount -t tmpfs none /mnt"]
    if (
        not shutil.which("unshare")
        or subprocess.run(attempt, check=False, capture_output=True).returncode
    ):
        pytest.skip("mounting is not allowed here")
    return prefix


BROWSERS = ("chromium", "chromium-browser", "google-chrome")


@pytest.fixture(scope="session")
def browser():
    """A browser without a window, by Playwright."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        pytest.skip(f"no browser: none of {', '.join(BROWSERS)} is installed")
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def open_page(browser):
    """Open a file in a tab without a network; at the end nothing must have gone wrong in any."""
    contexts, wrong = [], []

    def open_file(path, **options):
        context = browser.new_context(offline=True, **({"color_scheme": "light"} | options))
        contexts.append(context)
        tab, url = context.new_page(), path.as_uri()
        tab.on("console", lambda message: message.type != "error" or wrong.append(message.text))
        tab.on("pageerror", lambda error: wrong.append(str(error)))
        tab.on("request", lambda request: request.url == url or wrong.append(request.url))
        tab.goto(url)
        return tab

    yield open_file
    for context in contexts:
        context.close()
    assert wrong == []


def wait_for(page, true, seconds=30):
    """Wait until it is true; the pages let no text be run as a program."""
    for _ in range(20 * seconds):
        if true():
            return
        page.wait_for_timeout(50)
    raise TimeoutError
