#!/usr/bin/env bash
# Newton 1.8.0: an MJCF body with a hinge and then a slide becomes one joint whose coordinates have the other
# order: `joint_q` is the slide, then the angle. It slides along the axis of the parent, and turns after that,
# where MuJoCo slides along the axis that has turned. A state of MuJoCo means another pose. Use two bodies.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q newton==1.8.0 mujoco==4.0.0
"$folder/venv/bin/python" - <<'PYTHON'
import mujoco
import newton
import numpy as np
import warp as wp

wp.config.quiet = True
MODEL = """<mujoco model="m"><worldbody><body name="a"><joint name="h1" axis="0 -1 0"/>
<joint name="s1" type="slide" axis="0 0 -1"/><inertial mass="1" pos="0 0 -1" diaginertia="1 1 1"/>
</body></worldbody></mujoco>"""
model = mujoco.MjModel.from_xml_string(MODEL)
data = mujoco.MjData(model)
data.qpos[:] = 0.5, 0.3
mujoco.mj_kinematics(model, data)
print("MuJoCo, angle 0.5 and slide 0.3:", data.body("a").xpos.round(4))
with wp.ScopedDevice("cpu"):
    builder = newton.ModelBuilder()
    builder.add_mjcf(MODEL)
    robot = builder.finalize()
    state, found = robot.state(), []
    for q in ((0.5, 0.3), (0.3, 0.5)):
        state.joint_q.assign(np.array(q, np.float32))
        newton.eval_fk(robot, state.joint_q, state.joint_qd, state)
        found.append(state.body_q.numpy()[0, :3].copy())
        print("Newton", newton.__version__, "joint_q", q, found[-1].round(4))
np.testing.assert_allclose(data.body("a").xpos, [0.3 * np.sin(0.5), 0.0, -0.3 * np.cos(0.5)])
np.testing.assert_allclose(found, [[0, 0, -0.5], [0, 0, -0.3]], atol=1e-6, err_msg="changed")
PYTHON
