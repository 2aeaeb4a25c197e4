"""Closed forms: the paper's model of the pseudo-period, and the correct ones."""

from npend_gym._faces import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
