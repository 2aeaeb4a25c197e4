"""The kernels are compiled once for all workers of a test run, shared out among them."""

import time
from contextlib import suppress

import gymnasium as gym
import numpy as np

from npend_gym import Chain, pseudo_periods, simulate
from npend_gym.chaos import largest_lyapunov
from npend_gym.envs import EnvConfig
from npend_gym.physics import Ensemble
from npend_gym.rl.controllers.regulators import lqr

PATIENCE = 600.0  # s, with a worker that compiles


def step_of(env):
    env.reset(seed=0)
    env.step(env.action_space.sample())


SHORT = Chain.uniform(2), 0.1, 0.0, [0.0, 0.1]
ON_A_CART = {"id": "NPendulum-v0", "base": "cart", "mode": "swingup"}
MEASURED = {"id": "NPendulum-v0", "measure_periods": True}
# Each compiles kernels that the others do not, for tests in many files; the longest first
SHARES = {
    "many envs": lambda: step_of(gym.make_vec("NPendulum-v0", num_envs=17)),
    "one env": lambda: step_of(gym.make("NPendulum-v0")),
    "one env on a cart": lambda: step_of(gym.make(**ON_A_CART)),
    "many envs on a cart": lambda: step_of(gym.make_vec(**ON_A_CART, num_envs=17)),
    "many releases": lambda: pseudo_periods(Chain.uniform(2), np.full((17, 2), 0.1)),
    "one env that measures": lambda: step_of(gym.make(**MEASURED)),
    "many envs that measure": lambda: step_of(gym.make_vec(**MEASURED, num_envs=17)),
    "an ensemble": lambda: Ensemble(Chain.uniform(2), 17).advance(0.0, 0.1),
    "an ensemble of one": lambda: Ensemble(Chain.uniform(2)).advance(0.0, 0.1),
    "one release": lambda: pseudo_periods(Chain.uniform(2), 0.1),
    "an exponent": lambda: largest_lyapunov(Chain.uniform(2), 0.1, duration=10.0),
    "adaptive steps": lambda: simulate(*SHORT),
    "adaptive steps of links": lambda: simulate(Chain.uniform(2, friction=0.1), *SHORT[1:]),
    "feedback": lambda: lqr(EnvConfig(n=2, mode="balance")),
    "feedback on a cart": lambda: lqr(EnvConfig(n=2, mode="balance", base="cart")),
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
