"""Compile what most programs use, and keep the machine code.

A program then starts at once. Use it where the first start must be short: in the image of a
container, or before a class begins. What is compiled already takes no time.

Examples
--------
  npend compile
  NUMBA_CACHE_DIR=/opt/npend npend compile
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from npend_gym.cli.common import OK


def run(*, quiet: bool = False) -> int:
    """Compile, and print what is done; return the exit code.

    Parameters
    ----------
    quiet : bool
        Print nothing.
    """
    for name, use in uses().items():
        if not quiet:
            print(name, flush=True)
        use()
    return OK


def uses() -> dict[str, Callable[[], Any]]:
    """Return short programs by name; each compiles kernels that the others do not."""
    import numpy as np

    from npend_gym.chain import Chain
    from npend_gym.envs.registration import TASKS
    from npend_gym.period import pseudo_periods
    from npend_gym.physics import Ensemble, simulate

    two, several = Chain.uniform(2), 17
    kinds: dict[str, dict[str, Any]] = {
        "of links": {"chain": "realaigym C.1"},
        "with random chains": {"randomize": {"masses": (0.9, 1.1)}},
        "with noise and lag": {"angle_noise": 0.01, "action_delay": 1, "motor_lag": 0.01},
    }
    short = two, 0.1, 0.0, [0.0, 0.1]
    return {
        **{f"{env_id}, one and many": partial(_step, env_id) for env_id in TASKS},
        **{f"environments {name}": partial(_step, "npend/SwingUp-v1", **more)
           for name, more in kinds.items()},
        "ensembles": lambda: [Ensemble(two, size).advance(0.0, 0.1) for size in (1, several)],
        "releases": lambda: [
            pseudo_periods(two, np.full((size, 2), 0.1)) for size in (1, several)
        ],
        "motions with adaptive steps": lambda: simulate(*short),
        "motions with fixed steps": lambda: simulate(*short, method="rk4", dt=0.1),
    }  # fmt: skip


def _step(env_id: str, **keywords: Any) -> None:
    """Take a step of one environment, and of several."""
    import gymnasium as gym

    for env in (
        gym.make(env_id, **keywords), gym.make_vec(env_id, num_envs=17, **keywords)
    ):  # fmt: skip
        env.reset(seed=0)
        env.step(env.action_space.sample())
        env.close()
