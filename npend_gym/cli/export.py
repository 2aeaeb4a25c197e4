"""Write a policy, a controller or a chain for other programs.

A policy becomes a C99 header, which needs no library and allocates nothing. It computes torques
from measured angles and velocities. The controllers LQR, damping and plan become such headers too.
Files of ONNX and PyTorch have the network, with its memory as a tensor; LQR and damping become
networks there. A chain becomes a model of MuJoCo, a robot in URDF, a world in SDF, or a stage in
USD. These formats lack terms such as drag: fit the chain without them, or drop them. See
docs/howto/export.md and docs/howto/mujoco.md.

Examples
--------
  npend export swingup-2 --to c -o policy.h
  npend export mine.safetensors --to c --prefix arm --relative -o arm.h
  npend export --controller plan --task swingup-2 --to c -o plan.h
  npend export swingup-3-robust --to torch -o policy.pt2
  npend export --chain results/fit.json --to mjcf --drop quadratic_drag --motors 0 -o chain.xml
  npend export --chain acrobot --to urdf --for drake -o chain.urdf
  npend export --chain "multiarm 2" --to usd --for newton -o chain.usda
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from npend_gym.cli.common import OK, show_file, warn
from npend_gym.cli.evaluate import chosen

if TYPE_CHECKING:
    from npend_gym.chain import Chain

FILLS: dict[str, tuple[str, ...]] = {
    "npend_gym.cli.evaluate:run": ("trust", "task", "env"),
    "npend_gym.export.mjcf:to_mjcf": ("motors", "limits", "timestep"),
}
_IN_C = "LQR", "damping", "plan"  # controllers that a header can have
_SUFFIXES = {
    "c": ".h", "onnx": ".onnx", "torch": ".pt2", "mjcf": ".xml", "urdf": ".urdf", "sdf": ".sdf",
    "usd": ".usda",
}  # fmt: skip


def run(
    policy: str | None = None,
    *,
    to: Literal["c", "onnx", "torch", "mjcf", "urdf", "sdf", "usd"],
    out: Path,
    chain: Chain | Mapping[str, Any] | str | None = None,
    prefix: str | None = None,
    relative: bool = False,
    drop: Sequence[str] = (),
    trust: bool = False,
    controller: str | None = None,
    task: str | None = None,
    env: Sequence[tuple[str, Any]] = (),
    for_engine: str | None = None,
    **model: Any,
) -> int:
    """Write the file; return the exit code.

    Parameters
    ----------
    policy : policy, optional
        The name of a policy in the package, or a file (.safetensors).
    to : format
        Format: c (a header), onnx or torch (a network), mjcf, urdf, sdf or usd (a chain).
    out : file
        File to write, .h, .onnx, .pt2, .xml, .urdf, .sdf or .usda; missing folders are created.
    chain : Chain, optional
        The chain, for mjcf, urdf, sdf and usd: a preset or a JSON file.
    prefix : name, optional
        Prefix of the names in the header (default npend).
    relative : bool
        Sensors show the angle of each rod relative to the rod above it.
    drop : sequence of str
        Terms of the chain to drop: drag, quadratic_drag; for mjcf and usd gear, for urdf and sdf
        armature, for all but mjcf stiffness.
    controller : name, optional
        A controller in place of a policy: LQR, damping or, for c, plan.
    for_engine : name, optional
        Print what this engine loses of the file, and the line that mends it: mujoco, mjx,
        mujoco_warp, newton, genesis, drake, dart, pinocchio, idyntree, pybullet, sapien, brax or
        roboticstoolbox.
    """
    from npend_gym import _checks, export
    from npend_gym._files import replacing
    from npend_gym.chain import as_chain
    from npend_gym.export import mjcf, readers, sdf, urdf, usd
    from npend_gym.report import prepare_file

    prepare_file(out, (_SUFFIXES[to],))
    formats: dict[str, Any] = {"mjcf": mjcf, "urdf": urdf, "sdf": sdf, "usd": usd}
    of_c = {"prefix": prefix, "relative": relative or None}
    _refuse(of_c | {"controller plan": controller if controller == "plan" else None}, to, "c")
    _refuse(model, to, "mjcf")
    _refuse({"for": for_engine, "drop": drop or None, "chain": chain}, to, *formats)
    if controller is None and (task is not None or env):
        raise ValueError("--task and --env are for a --controller: a policy has its environment")
    if to in formats:
        if chain is None:
            raise ValueError(f"--to {to} needs --chain")
        if policy is not None or controller is not None or trust:
            raise ValueError(
                f"policy and --controller must be left out with --to {to}, which writes a chain"
            )
        given, lacks = as_chain(chain), formats[to].LACKS
        whole = mjcf.without(given, drop, f"--to {to}", lacks)
        for name, value in mjcf.held(given, drop).items():
            warn(f"npend export: drops {name} = {value}: the {to} moves otherwise than the chain")
        said = [] if for_engine is None else readers.advice(for_engine, to, whole)
        text = getattr(formats[to], f"to_{to}")(whole, **model)
        with replacing(out) as file:
            file.write(text)
        for line in said:
            warn(f"npend export: {line}")
    else:
        if controller is not None:
            _checks.choice("--controller", controller, _IN_C)
            if controller == "plan" and str(task).startswith("transition"):
                raise ValueError(
                    "--controller plan must have a task with one goal, such as swingup-2: a header "
                    "has one plan; give rl.planned_transition(...) to export.to_c in Python"
                )
        found: Any = chosen(policy, controller, task, dict(env), trust=trust)[1]
        if to == "c":
            export.to_c(found, out, "npend" if prefix is None else prefix, relative=relative)
        elif to == "onnx":
            export.to_onnx(found, out)
        else:
            export.to_torch(found, out)
    show_file(out)
    return OK


def _refuse(options: Mapping[str, Any], to: str, *formats: str) -> None:
    """Raise an error for the first option that is given, and for other formats than `to`."""
    for name in (name for name, value in options.items() if value is not None):
        if to not in formats:
            *others, last = formats
            raise ValueError(
                f"--{name} is for --to {', '.join(others)}{' or ' * bool(others)}{last}"
            )
