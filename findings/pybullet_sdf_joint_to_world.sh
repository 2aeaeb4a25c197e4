#!/usr/bin/env bash
# PyBullet 3.2.7: `loadSDF` of a pendulum whose joint has the parent "world", which is how SDF fixes a model. It
# looks for a link of that name, finds none, and loads nothing: "Cannot find parent link for a joint". Without
# limits it refuses the joint before that. Give it URDF, whose root it can hold (`useFixedBase=True`). Besides, it
# loads a file that was written anew as it was before, unless `enableFileCaching=0`.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q pybullet==3.2.7 numpy==2.4.6
"$folder/venv/bin/python" - "$folder/arm.sdf" <<'PYTHON' > "$folder/said"
import sys

import pybullet

ARM = """<sdf version="1.7"><model name="arm">%s<link name="rod"><inertial><mass>1</mass><inertia><ixx>1</ixx>
<iyy>1</iyy><izz>1</izz></inertia></inertial></link><joint name="hinge" type="revolute"><parent>%s</parent>
<child>rod</child><axis><xyz>0 1 0</xyz>%s</axis></joint></model></sdf>"""
LIMIT = "<limit><lower>-9</lower><upper>9</upper></limit>"
BASE = """<link name="base"><inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia>
</inertial></link>"""


def joints_of(*parts):
    with open(sys.argv[1], "w") as file:
        file.write(ARM % parts)
    try:
        (body,) = pybullet.loadSDF(sys.argv[1])
        return pybullet.getNumJoints(body)
    except pybullet.error as error:
        return str(error)


pybullet.connect(pybullet.DIRECT)
cached = joints_of(BASE, "base", LIMIT), joints_of("", "world", LIMIT)  # of the same name
pybullet.setPhysicsEngineParameter(enableFileCaching=0)
found = joints_of(BASE, "base", LIMIT), joints_of("", "world", LIMIT), joints_of("", "world", "")
print("\nto a link:", found[0], "joint; to the world:", found[1], "without limits:", found[2])
assert cached == (1, 1), "changed"
assert found == (1, "Cannot load SDF file.", "Cannot load SDF file."), "changed"
PYTHON
cat "$folder/said"
grep -q "Cannot find parent link for a joint" "$folder/said" # Bullet itself writes there
grep -q "it does not specify limits" "$folder/said"
