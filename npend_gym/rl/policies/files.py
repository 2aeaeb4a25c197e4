"""The files of policies: float32 arrays by name, and what describes them, checked when read.

Both formats hold numbers and text alone, so that nothing is executed when a file is read: `.npz` of
NumPy, with the description as the array "about", and `.safetensors`, with the description in its
header. A policy is one file, so that no error can leave numbers beside the description of others.
A `.npz` of version 0.1 has its description beside it, as `.json`, which is still read.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._extras import require
from npend_gym._files import parse_json, read_arrays, read_text, replacing

MAX_BYTES = 10_000_000  # of a file once unpacked
SUFFIXES = ".npz", ".safetensors"
_ABOUT = "npend_gym"  # the entry of a safetensors header that has the description
_ABOUT_ARRAY = "about"  # the array of a .npz that has it

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
    return tuple(sorted(path.stem for path in PRETRAINED.glob("*.npz")))


def pretrained_path(name: str) -> Path:
    """Return the file of a policy that comes with the package."""
    return PRETRAINED / f"{_checks.choice('pretrained', name, pretrained_names())}.npz"


def write_policy(path: Path, arrays: dict[str, Float32Array], about: dict[str, Any]) -> None:
    """Write arrays, and a description of plain values, in the format that the suffix names.

    Raises
    ------
    ValueError
        If the suffix names no format.
    ImportError
        If the suffix is .safetensors and the library is not installed.
    """
    _check_suffix(path)
    text = json.dumps(about, indent=2, allow_nan=False)
    if path.suffix == ".safetensors":
        content = _safetensors("safetensors.numpy").save(arrays, {_ABOUT: text})
        with replacing(path, binary=True) as file:
            file.write(content)
        return
    whole: dict[str, Any] = arrays | {_ABOUT_ARRAY: np.array(text)}
    with replacing(path, binary=True) as file:
        np.savez_compressed(file, **whole)


def read_policy(path: Path) -> tuple[dict[str, Float32Array], dict[str, Any]]:
    """Return the arrays, all of finite float32 numbers, and the description, {} without any.

    Raises
    ------
    ValueError
        If it is no such file: pickled, too large, of another type, or not described by JSON.
    OSError
        If it cannot be opened.
    """
    arrays, text = _read_parts(path)
    if any(a.dtype != np.float32 or not np.isfinite(a).all() for a in arrays.values()):
        raise ValueError(f"{path} is no policy: its arrays must be finite float32 numbers")
    return arrays, _description(path, text)


def is_described(path: Path) -> bool:
    """Return whether the file itself says what its policy is made for.

    Raises
    ------
    ValueError, OSError
        As `read_policy`.
    """
    return _read_parts(path)[1] is not None


def _read_parts(path: Path) -> tuple[dict[str, NDArray[Any]], str | None]:
    """Return the arrays of a file, not checked, and the text in it, None without any."""
    _check_suffix(path)
    try:
        if path.suffix == ".safetensors":
            return _read_safetensors(path)
        arrays = read_arrays(path, MAX_BYTES)
        about = arrays.pop(_ABOUT_ARRAY, None)
        if about is not None and (about.dtype.kind != "U" or about.ndim > 0):
            raise ValueError(f"its {_ABOUT_ARRAY} must be one text")
        return arrays, None if about is None else str(about)
    except ValueError as error:
        raise ValueError(f"{path} is no policy: {error}") from error


def _description(path: Path, text: str | None) -> dict[str, Any]:
    """Return what `text` says of the policy in `path`, by default the text of the file beside."""
    whence = path if text is not None else path.with_suffix(".json")
    try:
        if text is None:
            text = read_text(whence) if whence.exists() else "{}"
        about = parse_json(text)
        if not isinstance(about.get("env", {}), dict):
            raise ValueError("its env must be an object, names and values")
    except ValueError as error:
        raise ValueError(f"{whence} does not describe a policy: {error}") from error
    return about


def _check_suffix(path: Path) -> None:
    if path.suffix not in SUFFIXES:
        raise ValueError(f"path must end in {' or '.join(SUFFIXES)}, got {path}")


def _safetensors(module: str) -> Any:
    return require(module, "hub", "policies as .safetensors")


def _read_safetensors(path: Path) -> tuple[dict[str, Float32Array], str]:
    library = _safetensors("safetensors")
    if path.exists() and not path.is_file():  # a FIFO would wait for ever
        raise ValueError("it is no file")
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise ValueError(f"{size} bytes, at most {MAX_BYTES}")
    try:
        with library.safe_open(path, framework="np") as file:
            metadata: dict[str, str] = file.metadata() or {}
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (library.SafetensorError, TypeError) as error:  # a TypeError: of a type NumPy lacks
        raise ValueError(str(error)) from error
    return arrays, metadata.get(_ABOUT, "{}")
