#!/usr/bin/env bash
# MuJoCo 3.17.0 and 4.0.0: `mj_saveLastXML` of a point mass with 1e-13 kg m^2 on a hinge, which both load.
# Version 3.17.0 writes `diaginertia="0 0 0"`, and refuses the file that it has written: "mass and inertia of
# moving bodies must be larger than mjMINVAL". Version 4.0.0 writes the number. Keep the text it was compiled from.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
for version in 3.17.0 4.0.0; do
  python3 -m venv "$folder/$version"
  "$folder/$version/bin/pip" install -q "mujoco==$version"
  "$folder/$version/bin/python" - "$folder/$version.xml" <<'PYTHON'
import re
import sys

import mujoco

MODEL = """<mujoco><worldbody><body name="bob"><joint axis="0 -1 0"/>
<inertial pos="0 0 -1" mass="1" diaginertia="1e-13 1e-13 1e-13"/></body></worldbody></mujoco>"""

model = mujoco.MjModel.from_xml_string(MODEL)
mujoco.mj_saveLastXML(sys.argv[1], model)
with open(sys.argv[1]) as file:
    written = re.search('diaginertia="([^"]*)"', file.read())[1]
try:
    read = mujoco.MjModel.from_xml_path(sys.argv[1]).body_inertia[1].tolist()
except ValueError as error:
    read = str(error).splitlines()[0]
print("mujoco", mujoco.__version__, "has", model.body_inertia[1], "writes", written, "and reads:", read)
if mujoco.__version__ == "3.17.0":
    assert written == "0 0 0" and "mjMINVAL" in read, "changed"
else:
    assert written.split() == ["1e-13"] * 3 and read == [1e-13] * 3, "changed"
PYTHON
done
