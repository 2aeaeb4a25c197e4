"""Damage done to files, for the tests and the long runs that see whether it is noticed."""

from collections.abc import Iterable, Iterator


def flipped(whole: bytes, positions: Iterable[int]) -> Iterator[bytes]:
    """Yield `whole` with the bit at each of the positions flipped, one at a time."""
    for position in positions:
        damaged = bytearray(whole)
        damaged[position // 8] ^= 1 << (position % 8)
        yield bytes(damaged)
