"""The N-pendulum: exact O(N) dynamics, Gymnasium environments, the free-release experiment."""

from npend_gym._faces import attach_stub
from npend_gym.envs.registration import register_envs

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)

register_envs()
