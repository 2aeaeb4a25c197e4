"""Models of the same chains in other engines."""

import numpy as np
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


def mujoco_chain(chain):
    """Return MuJoCo's model of a chain that hangs at a fixed pivot; its rotors have no gear."""
    mujoco = pytest.importorskip("mujoco")
    spec = mujoco.MjSpec()
    spec.option.gravity = [0.0, 0.0, -chain.gravity]
    body, below = spec.worldbody, 0.0
    for i in range(chain.n):
        body, below = body.add_body(pos=[0.0, 0.0, below]), -chain.lengths[i]
        body.mass, body.ipos = chain.masses[i], [0.0, 0.0, -chain.centres[i]]
        body.inertia, body.explicitinertial = [chain.inertias[i]] * 3, True
        body.add_joint(
            type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, -1.0, 0.0],
            damping=chain.damping[i], armature=chain.armature[i],
        )  # fmt: skip
    return spec.compile()


def mujoco_accelerations(chain, theta, omega, torque):
    """Return MuJoCo's angular accelerations: it has angles and torques of the joints."""
    import mujoco

    model = mujoco_chain(chain)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = (np.diff(values, prepend=0.0) for values in (theta, omega))
    data.qfrc_applied[:] = torque
    mujoco.mj_forward(model, data)
    return np.cumsum(data.qacc)


def mujoco_motion(model, angles, speeds, control, duration, steps):
    """Return MuJoCo's coordinates after `duration`, by its RK4 in so many steps."""
    import mujoco

    data = mujoco.MjData(model)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.timestep = duration / steps
    data.qpos[:], data.qvel[:], data.ctrl[:] = angles, speeds, control
    mujoco.mj_step(model, data, nstep=steps)
    return data.qpos.copy()
