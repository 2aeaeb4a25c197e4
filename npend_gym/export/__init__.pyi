from npend_gym.export.c import to_c as to_c
from npend_gym.export.engines import in_mujoco as in_mujoco
from npend_gym.export.feedback import policy_of as policy_of
from npend_gym.export.mjcf import to_mjcf as to_mjcf
from npend_gym.export.networks import to_onnx as to_onnx
from npend_gym.export.networks import to_torch as to_torch
from npend_gym.export.read_mjcf import from_mjcf as from_mjcf
from npend_gym.export.urdf import to_urdf as to_urdf
