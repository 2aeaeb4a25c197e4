"""The draw of a trial, the same in the release experiment, in campaigns and in mode "passive".

Trial t (from 0) of seed s is what the environment draws when it is reset with seed s + t:

    start = amplitude + spread * np.random.Generator(np.random.PCG64(s + t)).random()

It depends on nothing else: not on N, on the other trials, or on how they are divided among workers.
So trial t of every chain starts from the same angle, and seeds that differ by less than the number
of trials share trials.

Making a generator takes 20 us, a quarter of a release of one rod, and each is used once. NumPy
never changes the two algorithms; here they are computed for many seeds at once, in 0.2 us a draw:
SeedSequence, which hashes a seed into 256 bits, and the first output of PCG64.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray

_Words = NDArray[np.uint32]
_Longs = NDArray[np.uint64]
_POOL = 4  # words of SeedSequence's entropy pool
_CHUNK = 65536  # draws at once: some MB of memory
_MULTIPLIER = 0x2360ED051FC65DA44385DF649FCCF645  # of PCG64
_LOW = np.uint64(2**32 - 1)


def starts(seed: int, first: int, count: int, amplitude: float, spread: float) -> FloatArray:
    """Return the starting angles of trials `first` to `first` + `count` - 1, counted from 0.

    Parameters
    ----------
    seed : int
        At least 0; `seed` + `first` + `count` must stay below 2^64.
    first, count : int
    amplitude, spread : float
        A trial starts at `amplitude` plus one draw from [0, spread) [rad].

    Returns
    -------
    ndarray, shape (count,)
        [rad]
    """
    draws = np.empty(count)
    for begin in range(0, count, _CHUNK):
        end = min(begin + _CHUNK, count)
        seeds = np.arange(end - begin, dtype=np.uint64) + np.uint64(seed + first + begin)
        draws[begin:end] = (_first_outputs(seeds) >> np.uint64(11)) * 2.0**-53
    return amplitude + spread * draws


def _first_outputs(seeds: _Longs) -> _Longs:
    """Return the first 64 bits that PCG64(seed) gives, for each of `seeds`."""
    high, low, increment_high, increment_low = _seed_sequence(seeds)
    increment_high = (increment_high << np.uint64(1)) | (increment_low >> np.uint64(63))
    increment = increment_high, (increment_low << np.uint64(1)) | np.uint64(1)
    state = _add((high, low), increment)
    for _ in range(2):  # one step ends the seeding, one makes the output
        state = _add(_multiply(*state), increment)
    high, low = state
    rotation = high >> np.uint64(58)
    mixed = high ^ low
    return (mixed >> rotation) | (mixed << (-rotation & np.uint64(63)))


def _add(a: tuple[_Longs, _Longs], b: tuple[_Longs, _Longs]) -> tuple[_Longs, _Longs]:
    """Return the sum of two 128-bit numbers, each given by its high and low half."""
    low = a[1] + b[1]
    return a[0] + b[0] + (low < b[1]), low


def _multiply(high: _Longs, low: _Longs) -> tuple[_Longs, _Longs]:
    """Return the product with PCG64's multiplier, modulo 2^128."""
    factor_high, factor_low = np.uint64(_MULTIPLIER >> 64), np.uint64(_MULTIPLIER & (2**64 - 1))
    half, f0, f1 = np.uint64(32), factor_low & _LOW, factor_low >> np.uint64(32)
    l0, l1 = low & _LOW, low >> half
    middle = l1 * f0 + ((l0 * f0) >> half)
    carry = (l0 * f1 + (middle & _LOW)) >> half
    product_high = l1 * f1 + (middle >> half) + carry
    return product_high + high * factor_low + low * factor_high, low * factor_low


def _seed_sequence(seeds: _Longs) -> _Longs:
    """Return SeedSequence(seed).generate_state(4, uint64) of each of `seeds`, shape (4, count)."""
    constant = 0x43B0D7E5

    def hashed(word: _Words, multiplier: int) -> _Words:
        nonlocal constant
        word = word ^ np.uint32(constant)
        constant = constant * multiplier % 2**32
        word = word * np.uint32(constant)
        return word ^ (word >> np.uint32(16))

    zero = np.zeros(seeds.size, np.uint32)
    words = (seeds & _LOW).astype(np.uint32), (seeds >> np.uint64(32)).astype(np.uint32), zero, zero
    pool = [hashed(word, 0x931E8875) for word in words]
    for source in range(_POOL):
        for target in range(_POOL):
            if source != target:
                other = hashed(pool[source], 0x931E8875)
                mixed = np.uint32(0xCA01F9DD) * pool[target] - np.uint32(0x4973F715) * other
                pool[target] = mixed ^ (mixed >> np.uint32(16))
    constant = 0x8B51F9DD
    state = [hashed(pool[k % _POOL], 0x58F38DED).astype(np.uint64) for k in range(2 * _POOL)]
    return np.array(
        [low | (high << np.uint64(32)) for low, high in zip(state[::2], state[1::2], strict=True)]
    )
