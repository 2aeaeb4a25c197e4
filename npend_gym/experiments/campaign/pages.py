"""How large the columns of a Parquet file unpack, read from its headers and nothing else.

A part comes from a folder that others may have written, and the header of a page decides how much
memory it takes: some thousand bytes may say, and be, two gigabytes. pyarrow tells neither that nor,
for damaged files, where columns are: it ends the process. Headers are in Thrift's compact protocol:
https://github.com/apache/parquet-format, `FileMetaData` and `PageHeader`.
"""

from __future__ import annotations

from typing import Any

_TRUE, _FALSE, _BYTE, _DOUBLE, _BINARY, _LIST, _SET, _STRUCT = 1, 2, 3, 7, 8, 9, 10, 12  # kinds
_INTEGERS = (4, 5, 6)
_MAX_DEPTH = 16
_MAGIC = b"PAR1"
_ROW_GROUPS, _COLUMNS, _META = 4, 1, 3  # fields: of a file, of a group of rows, of a column
_SIZE, _FIRST_PAGE, _DICTIONARY = 7, 9, 11  # of what describes a column
_UNPACKED, _PACKED = 2, 3  # of a page


def unpacked_sizes(data: bytes) -> list[int]:
    """Return how many bytes the pages of each column say that they take, all together.

    Raises
    ------
    ValueError
        If `data` is no Parquet file of one group of rows, without dictionaries.
    """
    end = len(data) - 8
    if end < 0 or data[-4:] != _MAGIC:
        raise ValueError("it is no Parquet file")
    start = end - int.from_bytes(data[end : end + 4], "little")
    if start < 0:
        raise ValueError("it is cut off")
    try:
        (group,) = _Header(data[:end], start).struct()[_ROW_GROUPS]
        columns = [column[_META] for column in group[_COLUMNS]]
        if any(_DICTIONARY in column for column in columns):
            raise ValueError("it has a dictionary")
        spans = [(column[_FIRST_PAGE], column[_SIZE]) for column in columns]
        return [unpacked_size(data[at : at + size]) for at, size in spans if at >= 0 <= size]
    except (KeyError, TypeError) as error:
        raise ValueError("its description is incomplete") from error


def unpacked_size(column: bytes) -> int:
    """Return how many bytes the pages in `column` say that they take, all together.

    Raises
    ------
    ValueError
        If they are no pages, or go beyond the end.
    """
    total = at = 0
    while at < len(column):
        header = _Header(column, at)
        sizes = header.struct()
        unpacked, packed = sizes.get(_UNPACKED), sizes.get(_PACKED)
        if (
            not isinstance(unpacked, int)
            or not isinstance(packed, int)
            or min(unpacked, packed) < 0
        ):
            raise ValueError("the sizes of its pages are wrong")
        at = header.at + packed
        total += unpacked
    if at > len(column):
        raise ValueError("its pages are cut off")
    return total


class _Header:
    """A struct that begins at `at`; reading it moves `at` to its end."""

    def __init__(self, data: bytes, at: int) -> None:
        self.data, self.at = data, at

    def struct(self, depth: int = 0) -> dict[int, Any]:
        """Return the values of a struct by the numbers of their fields."""
        if depth > _MAX_DEPTH:
            raise ValueError("its pages, or their description, are nested too deep")
        found: dict[int, Any] = {}
        field = 0
        while byte := self._byte():
            field = field + (byte >> 4) if byte >> 4 else self._integer()
            kind = byte & 15
            found[field] = kind == _TRUE if kind <= _FALSE else self._value(kind, depth)
        return found

    def _value(self, kind: int, depth: int) -> Any:
        """Return an integer, a struct or a list; skip what nobody asks for."""
        if kind in _INTEGERS:
            return self._integer()
        if kind == _STRUCT:
            return self.struct(depth + 1)
        if kind in (_LIST, _SET):
            byte = self._byte()
            count = self._varint() if byte >> 4 == 15 else byte >> 4
            if count > len(self.data) - self.at:  # each takes a byte at least
                raise ValueError("its pages, or their description, are cut off")
            return [self._value(byte & 15, depth + 1) for _ in range(count)]
        if kind not in (_TRUE, _FALSE, _BYTE, _DOUBLE, _BINARY):
            raise ValueError("its pages, or their description, are none of Parquet's")
        size = self._varint() if kind == _BINARY else 8 if kind == _DOUBLE else 1
        self.at += size
        return None

    def _byte(self) -> int:
        if self.at >= len(self.data):
            raise ValueError("its pages, or their description, are cut off")
        self.at += 1
        return self.data[self.at - 1]

    def _varint(self) -> int:
        value = 0
        for shift in range(0, 70, 7):
            byte = self._byte()
            value |= (byte & 127) << shift
            if byte < 128:
                return value
        raise ValueError("its pages, or their description, are none of Parquet's")

    def _integer(self) -> int:
        value = self._varint()
        return (value >> 1) ^ -(value & 1)
