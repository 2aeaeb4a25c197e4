#!/usr/bin/env bash
# MuJoCo 4.0.0: `<flag actuation="disable">` switches off the torque of a servo, but not the `damping` and
# `armature` of its actuator, which act on the joint as before. `<flag damper="disable">` switches off the
# damping, though it is none of a joint. A model with "actuation off" is not the passive mechanism.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q mujoco==4.0.0
"$folder/venv/bin/python" - <<'PYTHON'
import mujoco

MODEL = """<mujoco><option gravity="0 0 0"><flag {}/></option><worldbody><body><joint name="hinge" axis="0 1 0"/>
<geom type="sphere" size="0.1" pos="0 0 -1" mass="1"/></body></worldbody><actuator>
<position joint="hinge" kp="5" damping="0.7" armature="0.3"/></actuator></mujoco>"""


def acceleration(flag):
    model = mujoco.MjModel.from_xml_string(MODEL.format(flag))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = 0.2, 1.0
    mujoco.mj_forward(model, data)
    return data.qacc[0]


inertia = 1.0 + 0.4 * 0.1**2  # of the sphere about the hinge
found = {flag: acceleration(flag) for flag in ("", 'actuation="disable"', 'damper="disable"')}
print("mujoco", mujoco.__version__, {flag or "all": round(value, 6) for flag, value in found.items()})
expected = [(-0.7 - 5 * 0.2) / (inertia + 0.3), -0.7 / (inertia + 0.3), -5 * 0.2 / (inertia + 0.3)]
for value, one in zip(found.values(), expected):
    assert abs(value - one) < 1e-12, "changed"
print("passive, it would be 0")
PYTHON
