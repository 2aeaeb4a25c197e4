"""Policies and chains for other programs: C, ONNX, PyTorch, MuJoCo, URDF, SDF and USD."""

from npend_gym._faces import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
