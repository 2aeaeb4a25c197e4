#!/usr/bin/env bash
# Of a URDF robot with two branches, Pinocchio 4.1.0 and DART 6.20.0 sort the branches by name; MuJoCo 4.0.0,
# Drake 1.51.1 and PyBullet 3.2.7 keep the order of the file. A vector of joint positions that is right in one
# of them exchanges two arms in another. Map coordinates by the names of joints.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q mujoco==4.0.0 drake==1.51.1 pin==4.1.0 pybullet==3.2.7 dartpy==6.20.0
"$folder/venv/bin/python" - <<'PYTHON'
import tempfile
from pathlib import Path

import dartpy
import mujoco
import pinocchio as pin
import pybullet as pb
from pydrake.all import MultibodyPlant, Parser

LINK = '<link name="{0}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>' \
    "</inertial></link>"
JOINT = '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><axis xyz="0 1 0"/>' \
    '<limit lower="-3" upper="3" effort="9" velocity="9"/></joint>'
ROBOT = '<robot name="r"><link name="world"/>' + "".join(map(LINK.format, ("body", "left", "arm"))) + "".join(
    JOINT.format(*each)
    for each in (("waist", "world", "body"), ("to_left", "body", "left"), ("to_arm", "body", "arm"))
) + "</robot>"
IN_FILE, SORTED = ["waist", "to_left", "to_arm"], ["waist", "to_arm", "to_left"]

found = {}
model = mujoco.MjModel.from_xml_string(ROBOT)
found["MuJoCo"] = [model.joint(k).name for k in range(model.njnt)]
plant = MultibodyPlant(0.0)
Parser(plant).AddModelsFromString(ROBOT, "urdf")
plant.Finalize()
found["Drake"] = [name[2:-2] for name in plant.GetPositionNames()]
found["Pinocchio"] = [*pin.buildModelFromXML(ROBOT).names][1:]
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "robot.urdf"
    path.write_text(ROBOT)
    pb.connect(pb.DIRECT)
    body = pb.loadURDF(str(path), useFixedBase=True)
    found["PyBullet"] = [pb.getJointInfo(body, k)[1].decode() for k in range(pb.getNumJoints(body))]
    skeleton = dartpy.utils.DartLoader().parseSkeleton(str(path))
    found["DART"] = [skeleton.getDof(k).getName() for k in range(skeleton.getNumDofs())]
for name, order in found.items():
    print(f"{name:10s}", order)
for name in ("MuJoCo", "Drake", "PyBullet"):
    assert found[name] == IN_FILE, f"changed: {name}"
for name in ("Pinocchio", "DART"):
    assert found[name] == SORTED, f"changed: {name}"
PYTHON
