"""Reports: given results, draw and write them; nothing is measured here."""

from npend_gym._faces import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
