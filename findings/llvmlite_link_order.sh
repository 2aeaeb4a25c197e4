#!/usr/bin/env bash
# llvmlite 0.50.0 (LLVM): a function with linkage `linkonce_odr`, as Numba gives all that it links, is left
# out without a word where its module is linked before that of its caller. The caller then calls a
# function that is only declared, and machine code made of the module lacks it. Link callers first.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q llvmlite==0.50.0
"$folder/venv/bin/python" - <<'PYTHON'
import llvmlite
from llvmlite import binding

CALLER = "declare double @part(double)\ndefine double @whole(double %x) {\n" \
    "  %y = call double @part(double %x)\n  ret double %y\n}"
PART = "define linkonce_odr double @part(double %x) {\n  %y = fmul double %x, 2.0\n  ret double %y\n}"


def has_part(*texts):
    """Link modules in this order, and return whether the called function is defined."""
    module = binding.parse_assembly("")
    for text in texts:
        module.link_in(binding.parse_assembly(text))
    return not module.get_function("part").is_declaration


print("llvmlite", llvmlite.__version__, "LLVM", ".".join(map(str, binding.llvm_version_info)))
found = {"caller first": has_part(CALLER, PART), "caller last": has_part(PART, CALLER)}
print("the function that is called is defined:", found)
assert found == {"caller first": True, "caller last": False}, "changed"
PYTHON
