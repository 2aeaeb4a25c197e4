"""Random numbers without a state: Philox4x64-10, bit for bit that of NumPy.

All that is random in an environment is a function of five integers: the seed (the key), the number
of the episode, the step in it, the purpose, and the place in that stream. Block b, from 0, of a
stream is four words of 64 bits, those that NumPy draws as number 4 b to 4 b + 3 from

    np.random.Philox(key=[seed % 2**64, seed >> 64], counter=[0, step, purpose, episode])

whose counter NumPy raises by 1 before each block. Nothing has to be kept, made or advanced: lanes
are independent of each other, and what one purpose draws does not change what another does.

Salmon, Moraes, Dror and Shaw, *Parallel random numbers: as easy as 1, 2, 3*, SC11 (2011).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.compiled.jit import inlined_kernel, kernel

Keys = NDArray[np.uint64]

_MASK = 2**64 - 1
# Above 2^63, so that Numba takes them as unsigned
_FACTOR_0, _FACTOR_1 = 0xD2E7470EE14C6C93, 0xCA5A826395121157
_BUMP_LOW, _BUMP_HIGH = 0x9E3779B97F4A7C15, 0xBB67AE8584CAA73B


def word(number: float) -> int:
    """Return a number as an unsigned integer of 64 bits, modulo 2^64."""
    return int(number) & _MASK


def product(a: int, b: int) -> tuple[int, int]:
    """Return the high and the low word of a product."""
    return (a * b) >> 64, (a * b) & _MASK


@inlined_kernel
def _round(c: tuple[int, int, int, int], low: int, high: int) -> tuple[int, int, int, int]:
    """Return the counter words after one round with the key (`low`, `high`)."""
    high_0, low_0 = product(_FACTOR_0, c[0])
    high_1, low_1 = product(_FACTOR_1, c[2])
    return high_1 ^ c[1] ^ low, low_1, high_0 ^ c[3] ^ high, low_0


@inlined_kernel
def philox(
    key_low: int, key_high: int, block: int, step: float, purpose: int, episode: float
) -> tuple[int, int, int, int]:
    """Return the four words of 64 bits of one block of a stream, for other kernels.

    Parameters
    ----------
    key_low, key_high : int
        The key of the seed: `key_of`.
    block : int
        Place in the stream, from 0, in blocks of four words.
    step, purpose, episode : int
        Which stream. Whole numbers that are kept as floats serve too.

    Returns
    -------
    tuple of four uint64
    """
    low, high = word(key_low), word(key_high)
    c = (word(block + 1), word(step), word(purpose), word(episode))
    for _ in range(10):
        c = _round(c, low, high)
        low, high = word(low + _BUMP_LOW), word(high + _BUMP_HIGH)
    return c


@inlined_kernel
def unit(number: int) -> float:
    """Return a word as a number in [0, 1), as NumPy's `Generator.random` does: its 53 high bits."""
    return (word(number) >> 11) * 2.0**-53


@kernel
def _fill_first_units(keys: Keys, step: int, purpose: int, episode: int, units: FloatArray) -> None:
    for k in range(units.size):
        units[k] = unit(philox(keys[0, k], keys[1, k], 0, step, purpose, episode)[0])


def first_units(keys: Keys, step: int, purpose: int, episode: int) -> FloatArray:
    """Return the first number in [0, 1) of a stream, for each of `keys` (2, count): (count,)."""
    units = np.empty(keys.shape[1])
    _fill_first_units(keys, int(step), int(purpose), int(episode), units)
    return units


def key_of(seed: int) -> tuple[int, int]:
    """Return the low and the high word of the key that belongs to a seed.

    Below 2^128 the key is the seed itself, `(seed % 2**64, seed >> 64)`, and different seeds have
    different keys. A larger seed is folded: its pieces of 128 bits are combined by exclusive or.
    """
    rest = _checks.count("seed", seed, low=0)
    key = 0
    while rest:
        key ^= rest % 2**128
        rest >>= 128
    return key & _MASK, key >> 64


def keys_of(seed: int, count: int) -> Keys:
    """Return the keys of `seed`, `seed` + 1, ..., as rows of low and high words (2, count).

    Lane k of what is seeded with s has the key of s + k.
    """
    keys = np.empty((2, count), np.uint64)
    first = 0
    while first < count:  # a second time only where the low words overflow
        low = (seed + first) & _MASK
        end = min(count, first + 2**64 - low)
        fold_low, fold_high = key_of(seed + first - low)
        words = np.arange(end - first, dtype=np.uint64) + np.uint64(low)
        keys[0, first:end], keys[1, first:end] = words ^ np.uint64(fold_low), fold_high
        first = end
    return keys


def generator(seed: int, step: int, purpose: int, episode: int) -> np.random.Generator:
    """Return NumPy's generator of a stream, at its beginning."""
    key: Any = np.array(key_of(seed), np.uint64)
    counter: Any = np.array([0, step, purpose, episode], np.uint64)
    return np.random.Generator(np.random.Philox(key=key, counter=counter))
