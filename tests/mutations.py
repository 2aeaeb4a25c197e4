"""Mutations of files: of their bytes, and of what stands inside their containers.

A flipped bit of an archive meets its checksum and gets no further. Archives are therefore also
opened, and closed again with one member changed, as if nothing had happened.
"""

from __future__ import annotations

import io
import json
import random
import re
import struct
import zipfile
from collections.abc import Callable
from functools import lru_cache

import numpy as np

NUMBERS = (
    b"0", b"-1", b"1", b"1e308", b"-1e308", b"1e-320", b"1e999", b"NaN", b"Infinity", b"-0.0",
    b"nan", b"2147483648", b"-9223372036854775809", b"1" * 400, b"0.1", b"3.5", b"1e30", b"true",
    b"null", b'"x"', b"[]", b"{}", b"[[[1]]]", b"1_0", b"0x10", b"1000000", b"255", b"65536",
)  # fmt: skip
TOKENS = (
    b"[" * 3000, b"{", b"}", b"]", b",", b":", b'"', b"\\", b"\\ud800", b"\n", b"\r\n", b"\x00",
    b"\xff\xfe", b"\xef\xbb\xbf", b"nan", b"null", b"&a *a", b"!!python/object:os.system",
    b"!!timestamp x", b"inf", b"=", b"#", b"'", b'"""', b"time", b"theta0", b"theta1", b"tau0",
    b"piece", b"n=", b"<f8", b"|O", b"(2,)", b"(", b"True", b"F32", b"F64", b"BOOL",
    b"data_offsets", b"__metadata__", b"env", b"mode", b"1979-05-27T07:32:00Z", b"--- ", b"? ",
    b"- ",
)  # fmt: skip
_NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
_MAX_BYTES = 300_000

Mutation = Callable[[bytes, random.Random], bytes]


def of_bytes(data: bytes, rng: random.Random) -> bytes:
    """Return `data` with one to four random changes."""
    changed = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        _change(changed, rng)
    return bytes(changed[:_MAX_BYTES])


def _change(data: bytearray, rng: random.Random) -> None:
    at = rng.randrange(len(data) + 1)
    end = min(len(data), at + 1 + int(rng.expovariate(0.05)))
    kind = rng.randrange(9)
    if kind == 0 and data:
        data[min(at, len(data) - 1)] ^= 1 << rng.randrange(8)
    elif kind == 1:
        data[at:end] = rng.randbytes(end - at)
    elif kind == 2:
        del data[at:end]
    elif kind == 3:
        data[at:at] = data[at:end] * rng.choice((1, 2, 50))
    elif kind == 4:
        data[at:at] = rng.choice(TOKENS)
    elif kind == 5:
        del data[at:]
    elif kind == 6 and len(data) > 8:
        value = rng.choice((0, 1, 127, 128, 255, 2**15, 2**31 - 1, 2**31, 2**32 - 1, 2**63))
        size = rng.choice((1, 2, 4, 8))
        data[at : at + size] = (value % 256**size).to_bytes(size, rng.choice(("little", "big")))
    else:
        one = _NUMBER.search(data, at) or _NUMBER.search(data)
        if one:
            data[one.start() : one.end()] = rng.choice(NUMBERS)


def of_json(data: bytes, rng: random.Random) -> bytes:
    """Return JSON with a value, key or entry changed; of bytes where it is no JSON any more."""
    try:
        value = json.loads(data)
    except (ValueError, RecursionError):
        return of_bytes(data, rng)
    if rng.random() < 0.3:
        return of_bytes(data, rng)
    for _ in range(rng.randint(1, 3)):
        value = _changed_value(value, rng)
    try:
        return json.dumps(value).encode()
    except (ValueError, RecursionError):
        return of_bytes(data, rng)


def _changed_value(value: object, rng: random.Random) -> object:
    if isinstance(value, dict) and value and rng.random() < 0.9:
        key, kind = rng.choice(list(value)), rng.random()
        rest = {name: each for name, each in value.items() if name != key}
        if kind < 0.1:
            return rest
        if kind < 0.2:
            return rest | {rng.choice(("", "n", "x", "mode", "render_mode", "a" * 300)): value[key]}
        return value | {key: _changed_value(value[key], rng)}
    if isinstance(value, list) and value and rng.random() < 0.8:
        at, kind = rng.randrange(len(value)), rng.random()
        if kind < 0.15:
            return value[:at] + value[at + 1 :]
        if kind < 0.3:
            return value[:at] + value[at:] * rng.choice((2, 20))
        return [*value[:at], _changed_value(value[at], rng), *value[at + 1 :]]
    return rng.choice((
        None, True, False, 0, -1, 1, 1.5, 1e308, -1e308, 1e-320, float("nan"), float("inf"),
        10**400, 2**63, "", "x", "\ud800", "os:system", "swingup", "balance", [], {}, [[1]],
        [1, "x"], {"a": 1}, [0.0] * 100, 1_000_000, 1e-9, "9" * 5000, [None], -0.0, [value],
        {"x": value},
    ))  # fmt: skip


def of_archive(data: bytes, rng: random.Random) -> bytes:
    """Return an npz archive with one member changed, its checksum right; or change its bytes."""
    if rng.random() < 0.2:
        return of_bytes(data, rng)
    try:
        members = dict(_members(data))
    except Exception:  # noqa: BLE001 - it was damaged before
        return of_bytes(data, rng)
    if members:
        name = rng.choice(sorted(members))
        kind = rng.random()
        if kind < 0.05:
            del members[name]
        elif kind < 0.1:
            members[rng.choice(("x.npy", "status.npy", "bias9.npy", name[:-4]))] = members[name]
        else:
            members[name] = of_array(members[name], rng)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return out.getvalue()


def _remembered(function):
    """Return `function` of bytes with a memory; large ones are not likely to be changed again."""
    cached = lru_cache(1000)(function)
    return lambda data: cached(data) if len(data) < 10_000 else function(data)


@_remembered
def _members(data: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


@_remembered
def _array(data: bytes) -> np.ndarray:
    array = np.load(io.BytesIO(data), allow_pickle=False)
    array.flags.writeable = False
    return array


def of_array(data: bytes, rng: random.Random) -> bytes:
    """Return an npy file with its header, shape, type, numbers or text changed."""
    kind = rng.random()
    try:
        array = _array(data)
    except Exception:  # noqa: BLE001 - it was damaged before
        return of_bytes(data, rng)
    if array.dtype.kind == "U" and array.ndim == 0 and kind < 0.8:
        text = of_json(str(array).encode("utf-8", "replace"), rng).decode("utf-8", "replace")
        array = np.array(text)
    elif kind < 0.2:
        return of_bytes(data, rng)
    elif kind < 0.4:
        shapes = ((), (0,), (-1, 1), (1, -1), (1, 1, -1))
        shape = rng.choice(shapes)
        array = array.ravel()[:1].reshape(()) if shape == () and array.size else array.ravel()
        array = array[:0] if shape == (0,) else array.reshape(shape) if shape else array
    elif kind < 0.55:
        with np.errstate(all="ignore"):
            array = np.array(
                array, dtype=rng.choice(("f4", "f8", ">f8", "i8", "c16", "?", "S3", "f2"))
            )
    elif array.dtype.kind in "iuf" and array.size:
        array = np.array(array)
        value = rng.choice((0.0, -1.0, np.nan, np.inf, 1e38, -1e300, 1e-320, 1e20, 7.0))
        with np.errstate(all="ignore"):
            for _ in range(rng.choice((1, 1, 3, array.size))):
                array.flat[rng.randrange(array.size)] = (
                    value if array.dtype.kind == "f" else rng.choice((0, 1, 99))
                )
    out = io.BytesIO()
    np.save(out, array, allow_pickle=False)
    return out.getvalue()


def of_tensors(data: bytes, rng: random.Random) -> bytes:
    """Return a safetensors file with its header or its numbers changed."""
    if len(data) < 8 or rng.random() < 0.2:
        return of_bytes(data, rng)
    size = struct.unpack("<Q", data[:8])[0]
    header, numbers = data[8 : 8 + size], data[8 + size :]
    if rng.random() < 0.7:
        header = _of_header(header, rng)
    else:
        numbers = of_bytes(numbers, rng)
    return struct.pack("<Q", len(header)) + header + numbers


def _of_header(header: bytes, rng: random.Random) -> bytes:
    try:
        value = json.loads(header)
        text = value["__metadata__"]["npend_gym"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return of_json(header, rng)
    if rng.random() < 0.5:
        return of_json(header, rng)
    value["__metadata__"]["npend_gym"] = of_json(text.encode("utf-8", "replace"), rng).decode(
        "utf-8", "replace"
    )
    return json.dumps(value).encode()


def of_lines(data: bytes, rng: random.Random) -> bytes:
    """Return text with a line of JSON, or of cells, changed."""
    lines = data.split(b"\n")
    if rng.random() < 0.3 or not lines:
        return of_bytes(data, rng)
    at = rng.randrange(len(lines))
    line = lines[at]
    lines[at] = of_json(line, rng) if line.startswith(b"{") else of_bytes(line, rng)
    return b"\n".join(lines)
