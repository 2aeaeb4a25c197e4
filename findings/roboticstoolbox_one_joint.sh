#!/usr/bin/env bash
# roboticstoolbox-python 1.5.0 with NumPy 2.4: `Robot.accel` of a robot with two joints works; of one joint it
# raises `LinAlgError: 1-dimensional array given`, because its mass matrix loses an axis. Use `rne` for one joint.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q roboticstoolbox-python==1.5.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import tempfile
import warnings
from pathlib import Path

import numpy as np

warnings.simplefilter("ignore")
import roboticstoolbox as rtb
from importlib.metadata import version

LINK = '<link name="{0}"><inertial><origin xyz="0 0 -0.5"/><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ' \
    'ixy="0" ixz="0" iyz="0"/></inertial></link>'
JOINT = '<joint name="j{0}" type="continuous"><parent link="{0}"/><child link="{1}"/><origin xyz="0 0 -1"/>' \
    '<axis xyz="0 1 0"/></joint>'


def robot_of(*names):
    text = "".join(map(LINK.format, names))
    text += "".join(map(JOINT.format, ("base", *names), names))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.urdf"
        path.write_text(f'<robot name="r"><link name="base"/>{text}</robot>')
        return rtb.Robot.URDF(str(path))


def acceleration(robot):
    q = np.full(robot.n, 0.3)
    return robot.accel(q, 0.0 * q, 0.0 * q)


print("roboticstoolbox", version("roboticstoolbox-python"), "NumPy", np.__version__)
print("two joints:", acceleration(robot_of("a", "b")))
try:
    acceleration(robot_of("a"))
except np.linalg.LinAlgError as error:
    print("one joint: LinAlgError", error)
    assert "1-dimensional" in str(error), "changed"
else:
    raise SystemExit("changed: a robot of one joint works")
PYTHON
