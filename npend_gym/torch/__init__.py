"""Chains as tensors of PyTorch: steps and environments with exact gradients, by one physics."""

from npend_gym._faces import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
