"""The chain that swings: its parameters, checked once, immutable."""

from npend_gym._faces import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
