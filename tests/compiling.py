"""The kernels are compiled once for all workers of a test run, shared out among them."""

import time
from contextlib import suppress

import gymnasium as gym
import numpy as np

from npend_gym import Chain, pseudo_periods, simulate
from npend_gym.physics import Ensemble

PATIENCE = 600.0  # s, with a worker that compiles


def step_of(env):
    env.reset(seed=0)
    env.step(env.action_space.sample())


SHORT = Chain.uniform(2), 0.1, 0.0, [0.0, 0.1]
# Each compiles kernels that the others do not, the longest first
SHARES = {
    "one env": lambda: step_of(gym.make("NPendulum-v0")),
    "many envs": lambda: step_of(gym.make_vec("NPendulum-v0", num_envs=17)),
    "one env of links": lambda: step_of(gym.make("NPendulum-v0", chain="realaigym C.1")),
    "many envs of links": lambda: step_of(
        gym.make_vec("NPendulum-v0", num_envs=17, chain="realaigym C.1")
    ),
    "an ensemble of one": lambda: Ensemble(Chain.uniform(2)).advance(0.0, 0.1),
    "an ensemble": lambda: Ensemble(Chain.uniform(2), 17).advance(0.0, 0.1),
    "one release": lambda: pseudo_periods(Chain.uniform(2), 0.1),
    "many releases": lambda: pseudo_periods(Chain.uniform(2), np.full((17, 2), 0.1)),
    "adaptive steps": lambda: simulate(*SHORT),
    "fixed steps": lambda: simulate(*SHORT, method="rk4", dt=0.1),
}


def compile_together(folder):
    """Compile what no worker has taken yet; return when all of them are done.

    Parameters
    ----------
    folder : Path
        Where the workers leave word of what they have taken and what is done.
    """
    for name, share in SHARES.items():
        with suppress(FileExistsError):
            (folder / f"{name}.taken").touch(exist_ok=False)
            try:
                share()
            finally:
                (folder / f"{name}.done").touch()
    deadline = time.monotonic() + PATIENCE
    while len(list(folder.glob("*.done"))) < len(SHARES) and time.monotonic() < deadline:
        time.sleep(0.1)
