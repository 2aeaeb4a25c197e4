"""How large the pages of a Parquet column unpack, read from their headers and nothing else.

A part comes from a folder that others may have written, and a header decides how much memory its
page takes: a thousand bytes may say, and be, two gigabytes. Headers are in Thrift's compact
protocol: https://github.com/apache/parquet-format, `PageHeader`.
"""

from __future__ import annotations

_TRUE, _FALSE, _BYTE, _DOUBLE, _BINARY, _STRUCT = 1, 2, 3, 7, 8, 12  # kinds of a field
_INTEGERS = (4, 5, 6)
_MAX_DEPTH = 8
_UNCOMPRESSED, _COMPRESSED = 2, 3  # fields of a PageHeader


def unpacked_size(column: bytes) -> int:
    """Return how many bytes the pages of a column chunk say that they take, all together.

    Raises
    ------
    ValueError
        If they are no pages, or go beyond the end.
    """
    total = at = 0
    while at < len(column):
        header = _Header(column, at)
        sizes = header.integers()
        unpacked, packed = sizes.get(_UNCOMPRESSED, -1), sizes.get(_COMPRESSED, -1)
        at = header.at + packed
        if unpacked < 0 or packed < 0 or at > len(column):
            raise ValueError("the sizes of its pages are wrong")
        total += unpacked
    return total


class _Header:
    """A header that begins at `at`; `integers` goes to its end."""

    def __init__(self, data: bytes, at: int) -> None:
        self.data, self.at = data, at

    def integers(self, depth: int = 0) -> dict[int, int]:
        """Return the integers of a struct by the numbers of their fields."""
        if depth > _MAX_DEPTH:
            raise ValueError("the headers of its pages are nested too deep")
        found: dict[int, int] = {}
        field = 0
        while byte := self._byte():
            field = field + (byte >> 4) if byte >> 4 else self._integer()
            kind = byte & 15
            if kind in _INTEGERS:
                found[field] = self._integer()
            elif kind not in (_TRUE, _FALSE):
                self._skip(kind, depth)
        return found

    def _skip(self, kind: int, depth: int) -> None:
        if kind == _STRUCT:
            self.integers(depth + 1)
        elif kind == _BINARY:
            size = self._varint()
            self.at += size
        elif kind == _DOUBLE:
            self.at += 8
        elif kind == _BYTE:
            self.at += 1
        else:  # PageHeader has no lists, sets and maps
            raise ValueError("the headers of its pages are none of Parquet's")

    def _byte(self) -> int:
        if self.at >= len(self.data):
            raise ValueError("its pages are cut off")
        self.at += 1
        return self.data[self.at - 1]

    def _varint(self) -> int:
        value = 0
        for shift in range(0, 70, 7):
            byte = self._byte()
            value |= (byte & 127) << shift
            if byte < 128:
                return value
        raise ValueError("the headers of its pages are none of Parquet's")

    def _integer(self) -> int:
        value = self._varint()
        return (value >> 1) ^ -(value & 1)
