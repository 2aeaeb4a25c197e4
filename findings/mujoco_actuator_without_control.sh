#!/usr/bin/env bash
# MuJoCo 4.0.0: a model whose number of controls `nu` is 0 may still have actuators. `<dcmotor input="none">`
# is a motor without a control: it brakes its joint by motorconst^2 / resistance = 1.25 N m s, which stands in
# neither `dof_damping` nor `actuator_damping`. Code that loops over `model.nu` does not see it: use `nactuator`.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q mujoco==4.0.0
"$folder/venv/bin/python" - <<'PYTHON'
import mujoco

MODEL = """<mujoco><option gravity="0 0 0"/><worldbody><body><joint name="hinge" axis="0 1 0"/>
<geom type="sphere" size="0.1" pos="0 0 -1" mass="1"/></body></worldbody><actuator>
<dcmotor joint="hinge" input="none" motorconst="0.5" resistance="0.2"/></actuator></mujoco>"""

model = mujoco.MjModel.from_xml_string(MODEL)
data = mujoco.MjData(model)
data.qvel[:] = 1.0
mujoco.mj_forward(model, data)
print("mujoco", mujoco.__version__, "nu", model.nu, "nactuator", model.nactuator)
print("damping of joint and actuator", model.dof_damping, model.actuator_damping)
print("torque of the actuators at 1 rad/s [N m]:", data.qfrc_actuator)
assert (model.nu, model.nactuator) == (0, 1), "changed"
assert not model.dof_damping.any() and not model.actuator_damping.any(), "changed"
assert abs(data.qfrc_actuator[0] + 1.25) < 1e-12, "changed"
PYTHON
