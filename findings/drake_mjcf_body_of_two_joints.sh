#!/usr/bin/env bash
# Drake 1.51.1: of an MJCF body with two joints, such as a hinge and a slide, only the last joint stands where
# `pos` of the body puts it: the first turns about the origin of the parent body. The body is elsewhere than in
# MuJoCo as soon as the hinge turns, and no warning says so. Give each joint a body of its own.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q drake==1.51.1 mujoco==4.0.0
"$folder/venv/bin/python" - <<'PYTHON'
import logging

import mujoco
import numpy as np

logging.getLogger("drake").setLevel(logging.ERROR)
from pydrake.all import MultibodyPlant, Parser

HEAD = '<mujoco model="m"><worldbody><body name="a"><joint name="h0" axis="0 -1 0"/>' \
    '<inertial mass="1" pos="0 0 -1" diaginertia="1 1 1"/><body name="b" pos="0 0 -1">'
HINGE, SLIDE = '<joint name="h1" axis="0 -1 0"/>', '<joint name="s1" type="slide" axis="0 0 -1"/>'
LAST = '<inertial mass="1" pos="0 0 -1" diaginertia="1 1 1"/>'
TAIL = "</body></body></worldbody></mujoco>"
ONE_BODY = HEAD + HINGE + SLIDE + LAST + TAIL
TWO_BODIES = f'{HEAD}{HINGE}{LAST}<body name="c">{SLIDE}{LAST}</body>{TAIL}'
Q = [0.2, 0.5, 0.3]


def places(text, body):
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:] = Q
    mujoco.mj_kinematics(model, data)
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModelsFromString(text, "xml")
    plant.Finalize()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, Q)
    pose = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(body))
    return data.body(body).xpos, pose.translation()


one, two = places(ONE_BODY, "b"), places(TWO_BODIES, "c")
print("two joints in one body: MuJoCo", one[0].round(4), "Drake", one[1].round(4))
print("two joints in two bodies: MuJoCo", two[0].round(4), "Drake", two[1].round(4))
np.testing.assert_allclose(*two, atol=1e-12, err_msg="changed")
assert abs(one[0] - one[1]).max() > 0.4, "changed"
PYTHON
