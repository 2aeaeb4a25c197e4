#!/usr/bin/env bash
# Newton 1.8.0: `ModelBuilder.add_mjcf` reads other options of MuJoCo (`parse_mujoco_options` is True), but not
# the `gravity` of `<option>`: a model made for the moon falls as on Earth, without a warning.
# Give the builder the gravity.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q newton==1.8.0
"$folder/venv/bin/python" - <<'PYTHON'
import newton
import warp as wp

wp.config.quiet = True
MODEL = """<mujoco model="m"><option gravity="0 0 -1.62"/><worldbody><body name="a"><joint axis="0 1 0"/>
<inertial mass="1" pos="0 0 -1" diaginertia="1 1 1"/></body></worldbody></mujoco>"""


def gravity_of(**options):
    with wp.ScopedDevice("cpu"):
        builder = newton.ModelBuilder(**options)
        builder.add_mjcf(MODEL, parse_mujoco_options=True)
        return builder.finalize().gravity.numpy().ravel()[:3].tolist()


found = gravity_of(), gravity_of(gravity=(0.0, 0.0, -1.62))
print("newton", newton.__version__, "of the file:", found[0], "of the builder:", found[1])
assert abs(found[0][2] + 9.81) < 1e-5, "changed"
assert abs(found[1][2] + 1.62) < 1e-5, "changed"
PYTHON
