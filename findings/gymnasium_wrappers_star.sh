#!/usr/bin/env bash
# Gymnasium 1.4.0: `from gymnasium.wrappers import *` raises an error where array-api-compat is missing,
# though every other import of the package works: `__all__` names wrappers that convert between arrays,
# and a star import loads all of them. Import wrappers by their names.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q gymnasium==1.4.0
"$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version
from importlib.util import find_spec

from gymnasium.wrappers import RecordEpisodeStatistics, TimeLimit

print("gymnasium", version("gymnasium"))
assert find_spec("array_api_compat") is None, "array-api-compat comes with Gymnasium now"
print("by name:", TimeLimit.__name__, RecordEpisodeStatistics.__name__)
try:
    exec("from gymnasium.wrappers import *")
except Exception as error:
    print("by star:", type(error).__name__, error)
else:
    raise SystemExit("changed: the star import works")
PYTHON
