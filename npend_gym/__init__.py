"""The N-pendulum: exact O(N) dynamics, Gymnasium environments, the free-release experiment."""

from npend_gym import _interrupts

_interrupts.leave_at_interrupts()  # before the imports that take long

from npend_gym._faces import attach_stub  # noqa: E402
from npend_gym.envs.registration import register_envs  # noqa: E402

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)

register_envs()
