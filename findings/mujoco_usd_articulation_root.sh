#!/usr/bin/env bash
# MuJoCo 4.0.0 with mujoco-usd 4.0.0: a robot of USD whose ArticulationRootAPI is on the Xform around its bodies,
# as UsdPhysics allows and Newton reads. MuJoCo makes a moving body without mass of that Xform, and refuses the
# file: "mass and inertia of moving bodies must be larger than mjMINVAL". Put the root on the first body.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q mujoco==4.0.0 mujoco-usd==4.0.0
"$folder/venv/bin/python" - "$folder/robot.usda" <<'PYTHON'
import sys

import mujoco

STAGE = """#usda 1.0
(
    defaultPrim = "robot"
    metersPerUnit = 1
    upAxis = "Z"
)
def Xform "robot" (%s)
{
    def PhysicsScene "scene" {}
    def Xform "arm" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"%s])
    {
        float physics:mass = 1
        point3f physics:centerOfMass = (0, 0, -1)
        float3 physics:diagonalInertia = (1, 1, 1)
        quatf physics:principalAxes = (1, 0, 0, 0)
    }
    def PhysicsRevoluteJoint "hinge"
    {
        uniform token physics:axis = "Y"
        rel physics:body1 = </robot/arm>
    }
}
"""
ROOT = '"PhysicsArticulationRootAPI"'
CASES = {
    "on no prim": ("", ""),
    "on the body": ("", f", {ROOT}"),
    "on the Xform around it": (f"prepend apiSchemas = [{ROOT}]", ""),
}

found = {}
for name, schemas in CASES.items():
    with open(sys.argv[1], "w") as file:
        file.write(STAGE % schemas)
    try:
        model = mujoco.MjSpec.from_file(sys.argv[1]).compile()
        found[name] = f"{model.nbody - 1} body, {model.njnt} joint"
    except ValueError as error:
        found[name] = " ".join(str(error).split())
    print("mujoco", mujoco.__version__, "root of the articulation", name + ":", found[name])
assert found["on no prim"] == found["on the body"] == "1 body, 1 joint", "changed"
assert "mjMINVAL Element name '/robot'" in found["on the Xform around it"], "changed"
PYTHON
