#!/usr/bin/env bash
# Pinocchio 4.1.0: an MJCF body with two joints becomes one composite joint, "Composite_" and the name of the
# first. The joints' own names are gone, and `getJointId` of a name that does not exist raises nothing: it
# returns `njoints`, one past the last, so that both names seem to be one joint. Ask `existJointName` first.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q pin==4.1.0
"$folder/venv/bin/python" - <<'PYTHON'
import tempfile
from pathlib import Path

import pinocchio as pin

MODEL = """<mujoco model="m"><worldbody><body name="a"><joint name="turn" type="hinge" axis="0 1 0"/>
<joint name="slide" type="slide" axis="0 0 1"/><inertial mass="1" pos="0 0 -1" diaginertia="1 1 1"/>
</body></worldbody></mujoco>"""
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "model.xml"
    path.write_text(MODEL)
    model = pin.buildModelFromMJCF(str(path))
names = [*model.names]
ids = {name: model.getJointId(name) for name in ("turn", "slide", "no such joint")}
print("pinocchio", pin.__version__, "names", names, "njoints", model.njoints, "ids", ids)
assert names == ["universe", "Composite_turn"], "changed"
assert set(ids.values()) == {model.njoints}, "changed"
assert not model.existJointName("turn"), "changed"
PYTHON
