"""Learning: the adapter for Stable-Baselines3, reference controllers, policies, evaluation."""

from npend_gym._faces import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
