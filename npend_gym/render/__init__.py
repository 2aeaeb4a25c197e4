"""Pictures of a chain by pygame-ce (extra "render"), in memory; no display is opened."""

from npend_gym._faces import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
