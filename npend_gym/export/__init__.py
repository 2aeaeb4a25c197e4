"""Policies and chains for other programs: C, ONNX, PyTorch, MuJoCo and URDF."""

from npend_gym._faces import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
