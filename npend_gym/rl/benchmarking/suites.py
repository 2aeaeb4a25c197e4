"""Which tasks each suite has: public ids with their default observation and episode."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from npend_gym import _checks

EPISODES = 100
# Of sensors like those of a bench: noise of encoders and of their velocities, one step late
_OF_A_BENCH: dict[str, Any] = {"angle_noise": 0.01, "velocity_noise": 0.1, "observation_delay": 1.0}


class BenchmarkTask(NamedTuple):
    """A task of a suite, in whose episodes models are compared.

    Attributes
    ----------
    env_id : str
    keywords : dict
        Of ``gym.make_vec(env_id, ...)``; all others have their defaults.
    controller : str
        Of `CONTROLLERS`, the reference that knows the equations; "" where there is none.
    """

    env_id: str
    keywords: dict[str, Any]
    controller: str = ""

    @property
    def env(self) -> dict[str, Any]:
        """What `evaluate` takes."""
        return {"id": self.env_id} | self.keywords


def _swing(controller: str = "plan", **keywords: Any) -> BenchmarkTask:
    return BenchmarkTask("npend/SwingUp-v1", keywords, controller)


_CARTS = "npend/CartPole-v1", "npend/CartDoublePole-v1", "npend/CartTriplePole-v1"
_CORE = {
    "swingup-1": _swing(n=1),
    "swingup-2": _swing(n=2),
    "balance-2": BenchmarkTask("npend/Balance-v1", {"n": 2}, "LQR"),
    "calm-2": BenchmarkTask("npend/Calm-v1", {"n": 2}, "damping"),
    "transition-2": BenchmarkTask("npend/Transition-v1", {"n": 2}, "plan"),
    **{f"balance-{n}-cart": BenchmarkTask(_CARTS[n - 1], {}, "LQR") for n in (1, 2, 3)},
}
_HARD = {
    **{f"swingup-{n}": _swing(n=n) for n in (3, 4, 5, 6)},
    "swingup-2-cart": BenchmarkTask(_CARTS[1], {"mode": "swingup"}, "plan"),
    "swingup-3-cart": BenchmarkTask(_CARTS[2], {"mode": "swingup"}, "plan"),
    "swingup-2-medium": _swing(n=2, difficulty="medium"),
    "swingup-1-hard": _swing("energy", n=1, difficulty="hard"),
    "swingup-2-angles": _swing("", n=2, observe_velocities=False),
    "swingup-2-bench": _swing(n=2, **_OF_A_BENCH),
}
_RELEASE = {
    f"release-{n}": BenchmarkTask("npend/Release-v1", {"n": n}, "simulate")
    for n in (1, 2, 5, 10, 20)
}
SUITES: Mapping[str, Mapping[str, BenchmarkTask]] = MappingProxyType({
    "core": MappingProxyType(_CORE),
    "hard": MappingProxyType(_HARD),
    "release": MappingProxyType(_RELEASE),
})  # fmt: skip
"""The tasks of each suite by their names. In "release" a model predicts motions."""


def tasks_of(suite: str) -> Mapping[str, BenchmarkTask]:
    """Return the tasks of a suite, or say which there are."""
    return SUITES[_checks.choice("suite", suite, tuple(SUITES))]
