"""The files of policies: float32 arrays by name, and what describes them, checked when read.

A policy is one `.safetensors` file: numbers, and in its header a description as JSON. Nothing is
executed when it is read, and no error can leave numbers beside the description of others. The
description is the only entry of the header's metadata, because the library writes several entries
in any order. It has a checksum, because the format has none.
"""

from __future__ import annotations

import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._files import parse_json, replacing

MAX_BYTES = 20_000_000  # of a file
POLICY_FILE = "policy.safetensors"  # of a repository of the Hugging Face Hub
_SUFFIX = ".safetensors"
_ABOUT = "npend_gym"  # the entry of the header that has the description
CHECKSUM = "crc32"  # the entry of the description that has the checksum

PRETRAINED = Path(__file__).parent / "pretrained"  # the policies that come with the package

Float32Array = NDArray[np.float32]


def pretrained_names() -> tuple[str, ...]:
    """Return the names of the policies that come with the package.

    Examples
    --------
    >>> from npend_gym import rl
    >>> "swingup-4" in rl.pretrained_names()
    True
    """
    return tuple(sorted(path.stem for path in PRETRAINED.glob(f"*{_SUFFIX}")))


def pretrained_path(name: str) -> Path:
    """Return the file of a policy that comes with the package."""
    return PRETRAINED / f"{_checks.choice('pretrained', name, pretrained_names())}{_SUFFIX}"


def write_policy(path: Path, arrays: dict[str, Float32Array], about: dict[str, Any]) -> None:
    """Write arrays, and a description of plain values; the same content gives the same bytes.

    Nothing is written that `read_policy` would refuse.
    """
    from safetensors.numpy import save  # here, so that importing the package does not take longer

    _check_suffix(path)
    try:
        described = about | {CHECKSUM: _checksum(arrays, about)}
        text = json.dumps(described, indent=2, allow_nan=False)
    except (TypeError, ValueError, RecursionError) as error:
        raise TypeError(f"env and provenance must hold what JSON can: {error}") from error
    try:
        parse_json(text)
    except ValueError as error:
        raise ValueError(f"env and provenance could not be read again: {error}") from error
    # `save` writes the memory of an array as it lies, also that of a transposed one
    rows = {name: np.asarray(array, order="C") for name, array in arrays.items()}
    content = save(rows, {_ABOUT: text})
    if len(content) > MAX_BYTES:
        raise ValueError(
            f"a policy must have at most {MAX_BYTES} bytes, got {len(content)}: use fewer neurons"
        )
    with replacing(path, binary=True) as file:
        file.write(content)


def read_policy(path: Path) -> tuple[dict[str, Float32Array], dict[str, Any]]:
    """Return the arrays, all of float32 numbers, and the description, which has an "env"."""
    if path.suffix == ".npz":
        raise ValueError(f"policies are {_SUFFIX} files, got {path}; {_conversion(path)}")
    _check_suffix(path)
    try:
        arrays, text = _read_parts(path)
    except ValueError as error:
        raise ValueError(f"{path} is no policy: {error}") from error
    try:
        about = parse_json(text)
        if not isinstance(about.get("env"), dict):
            raise ValueError("its env must be an object, names and values")
    except ValueError as error:
        raise ValueError(f"{path} does not describe a policy: {error}") from error
    checksum = about.pop(CHECKSUM, None)  # other programs may write none
    if checksum is not None and checksum != _checksum(arrays, about):
        raise ValueError(f"{path} is no policy: it is damaged, its {CHECKSUM} does not fit")
    return arrays, about


def _read_parts(path: Path) -> tuple[dict[str, Float32Array], str]:
    """Return the arrays of a file, and its description."""
    from safetensors import SafetensorError, safe_open

    if path.exists() and not path.is_file():  # a FIFO would wait for ever
        raise ValueError("it is no file")
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise ValueError(f"{size} bytes, at most {MAX_BYTES}")
    try:
        opened: Any = safe_open(path, framework="np")
        with opened as file:
            metadata: dict[str, str] = file.metadata() or {}
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    # an error of Python is about a type that NumPy lacks
    except (SafetensorError, TypeError, AttributeError) as error:
        raise ValueError(str(error)) from error
    if any(array.dtype != np.float32 for array in arrays.values()):
        raise ValueError("its arrays must be float32 numbers")
    if _ABOUT not in metadata:
        raise ValueError(f'its header has no description, the entry "{_ABOUT}" of its metadata')
    return arrays, metadata[_ABOUT]


def _checksum(arrays: dict[str, Float32Array], about: dict[str, Any]) -> int:
    """Return the CRC-32 of a description and of arrays, as they stand in a file."""
    found = zlib.crc32(json.dumps(about).encode())
    for name in sorted(arrays):
        stored = arrays[name].astype(arrays[name].dtype.newbyteorder("<"), copy=False)
        found = zlib.crc32(stored.tobytes(), found)
    return found


def _check_suffix(path: Path) -> None:
    if path.suffix != _SUFFIX:
        raise ValueError(f"path must end in {_SUFFIX}, got {path}")


def _conversion(path: Path) -> str:
    """Return how a policy of an earlier version becomes one of today."""
    return (
        "Python converts one of an earlier version: import json, numpy, pathlib; from "
        f"{__name__} import write_policy; arrays = dict(numpy.load({str(path)!r})); "
        'about = json.loads(str(arrays.pop("about"))); '
        f"write_policy(pathlib.Path({str(path.with_suffix(_SUFFIX))!r}), arrays, about)"
    )
