"""A chain to play with, in a live window (extra "render")."""

from npend_gym._faces import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
