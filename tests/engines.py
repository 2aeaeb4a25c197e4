"""Models of the same chains in other engines."""

import pytest


def dm_control_model(num_poles=None):
    """Return MuJoCo's model of dm_control's acrobot, or of its cart with this many poles."""
    mujoco = pytest.importorskip("mujoco")
    suite = pytest.importorskip("dm_control.suite")
    if num_poles is None:
        text, assets = suite.acrobot.get_model_and_assets()
    else:
        text, assets = suite.cartpole.get_model_and_assets(num_poles)
    text = text.decode() if isinstance(text, bytes) else text
    return mujoco.MjModel.from_xml_string(text, assets)
