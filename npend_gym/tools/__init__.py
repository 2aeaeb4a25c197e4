"""What programs around the package share: checks, files, colours, provenance, a command's frame.

The study of the paper, the benchmarks and other programs of a clone are written with these names.
"""

from npend_gym._faces import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
