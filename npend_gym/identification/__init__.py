"""A chain from measured motion: parameters with standard errors, and what stays undetermined."""

from npend_gym._faces import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
