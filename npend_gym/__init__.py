"""The N-pendulum: exact O(N) dynamics, Gymnasium environments, the free-release experiment."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from npend_gym._version import __version__
from npend_gym.chain import Chain
from npend_gym.envs.registration import register_envs

if TYPE_CHECKING:
    from npend_gym import theory
    from npend_gym.period import pseudo_periods
    from npend_gym.physics.simulate import IntegrationError, Trajectory, simulate

__all__ = [
    "Chain",
    "IntegrationError",
    "Trajectory",
    "__version__",
    "pseudo_periods",
    "simulate",
    "theory",
]

# Imported when first asked for: Numba and SciPy take longer to import than all the rest.
_LAZY = {
    "IntegrationError": "npend_gym.physics.simulate",
    "Trajectory": "npend_gym.physics.simulate",
    "pseudo_periods": "npend_gym.period",
    "simulate": "npend_gym.physics.simulate",
    "theory": "npend_gym.theory",
}


def __getattr__(name: str) -> object:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = import_module(_LAZY[name])
    return module if name == "theory" else getattr(module, name)


def __dir__() -> list[str]:
    return sorted(__all__)


register_envs()
