"""The mechanics of the chain: equations of motion, simulation, linearisation, energy."""

from npend_gym._faces import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
