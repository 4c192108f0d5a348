"""Reader of binary OUTPUT4: records of Fortran, with their length before and behind them.

The layout: MSC Nastran 2012 DMAP Programmer's Guide, module OUTPUT4. A word has four bytes, or
eight in files of programs compiled with whole numbers of that size; either byte comes first.
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import scipy.sparse as sparse

from vibroimpact_schema.files.bounds import check_count
from vibroimpact_schema.files.labels import ComplexMatrix

_HEADS: Final = {24: 4, 48: 8}
"""Bytes of the head of a matrix -> bytes of a word."""
_MOST_ROWS: Final = 2**31 - 1
_KINDS: Final = {4: {1: ("f4", 1), 2: ("f8", 2)}, 8: {1: ("f8", 1), 2: ("f8", 1)}}
"""Bytes of a word -> type of a matrix -> numbers, and words of each; others are complex."""


def matrices(data: bytes) -> dict[str, Any]:
    """Return the matrices of a file by their names.

    Raises
    ------
    ValueError
        With the byte at fault.
    """
    order = next((o for o in "<>" if _number(data, 0, o) in _HEADS), None)
    if order is None:
        raise ValueError("it is binary, but no OUTPUT4: it begins with no head of a matrix")
    file = _Records(data, order)
    content: dict[str, Any] = {}
    while file.at < len(data):
        began = file.at
        name, matrix = _matrix(file)
        if name in content:
            raise _wrong(began, f"there are two matrices {name}")
        check_count(len(content) + 1)
        content[name] = matrix
    return content


def _number(data: bytes, at: int, order: str) -> int:
    return int.from_bytes(data[at : at + 4], "little" if order == "<" else "big")


def _wrong(at: int, reason: str) -> ValueError:
    return ValueError(f"byte {at}: {reason}")


class _Records:
    """The records of a file, one after the other."""

    def __init__(self, data: bytes, order: str) -> None:
        self.data, self.order, self.at = data, order, 0

    def next(self) -> tuple[int, int]:
        """Return where the next record begins and ends."""
        start = self.at + 4
        size = _number(self.data, self.at, self.order)
        end = start + size
        if size % 4:
            raise _wrong(self.at, f"a record of {size} bytes is no whole number of words")
        if end + 4 > len(self.data):
            raise _wrong(self.at, "the file ends within a record")
        if _number(self.data, end, self.order) != size:
            raise _wrong(end, f"a record of {size} bytes does not end here")
        self.at = end + 4
        return start, end

    def words(self, start: int, count: int, word: int) -> Any:
        """Return whole numbers that begin at a byte."""
        return np.frombuffer(self.data, f"{self.order}i{word}", count, start)


@dataclass
class _Strings:
    """The strings of a matrix: where they begin, rows and columns from 0, and their numbers."""

    byte: array[int] = field(default_factory=lambda: array("q"))
    row: array[int] = field(default_factory=lambda: array("q"))
    column: array[int] = field(default_factory=lambda: array("q"))
    count: array[int] = field(default_factory=lambda: array("q"))


def _matrix(file: _Records) -> tuple[str, Any]:
    start, end = file.next()
    word = _HEADS.get(end - start)
    if word is None:
        raise _wrong(start, f"a head of a matrix has 24 bytes or 48, not {end - start}")
    columns, rows, _, kind = (int(each) for each in file.words(start, 4, word))
    name = file.data[start + 4 * word : end].decode("latin-1").strip()
    big, rows = rows < 0 or rows > 65535, abs(rows)
    if not (0 <= columns <= _MOST_ROWS and rows <= _MOST_ROWS and 1 <= kind <= 4 and name):
        raise _wrong(start, "it is no head of a matrix: columns, rows, form, type, name")
    number = _KINDS[word].get(kind)
    place, last = _Strings(), 0
    while True:
        start, end = file.next()
        if end - start < 3 * word:
            raise _wrong(start, "a column begins with its number, its first row and its words")
        column, row, words = (int(each) for each in file.words(start, 3, word))
        if column <= last:
            raise _wrong(start, f"column {column} behind column {last}")
        if column > columns:
            break
        last = column
        if number is None:
            continue
        body = start + 3 * word
        if words < 0 or body + words * word > end:
            raise _wrong(start, f"a column of {words} words in a record of {end - start} bytes")
        if row:
            _add(place, (body, row - 1, words), number[1], rows)
        else:
            _add_strings(place, file, (body, words, word), (number[1], big, rows))
        place.column.extend([column - 1] * (len(place.row) - len(place.column)))
    if number is None:
        return name, ComplexMatrix(name, 0)
    return name, _assembled(file, place, (rows, columns), number[0])


def _add(place: _Strings, string: tuple[int, int, int], words_each: int, rows: int) -> None:
    """Add a string: its first byte, its first row and its words."""
    byte, row, words = string
    count, rest = divmod(words, words_each)
    if rest or row < 0 or row + count > rows:
        raise _wrong(byte, f"{words} words from row {row + 1} on, of {rows}")
    place.byte.append(byte)
    place.row.append(row)
    place.count.append(count)


def _add_strings(
    place: _Strings, file: _Records, column: tuple[int, int, int], form: tuple[int, bool, int]
) -> None:
    """Add the strings of a column: its first byte, its words, and the bytes of one."""
    start, words, word = column
    words_each, big, rows = form
    whole, at = file.words(start, words, word), 0
    while at < words:
        if big and at + 1 < words:
            length, row = int(whole[at]) - 1, int(whole[at + 1]) - 1
            at += 2
        else:
            length, row = int(whole[at]) // 65536 - 1, int(whole[at]) % 65536 - 1
            at += 1
        if length < 1 or at + length > words:
            raise _wrong(start + at * word, f"a string of {length} words in a column of {words}")
        _add(place, (start + at * word, row, length), words_each, rows)
        at += length


def _assembled(file: _Records, place: _Strings, shape: tuple[int, int], kind: str) -> Any:
    counts = np.array(place.count, dtype=np.int64)
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    # Numbers begin at any multiple of four bytes: so do records.
    size = np.dtype(kind).itemsize
    units = np.frombuffer(file.data, "V4", len(file.data) // 4)
    first = np.repeat(np.array(place.byte, dtype=np.int64) // 4, counts) + within * (size // 4)
    taken = np.stack([units[first + part] for part in range(size // 4)], axis=-1)
    values = taken.view(f"{file.order}{kind}").ravel().astype(np.float64)
    row = np.repeat(np.array(place.row, dtype=np.int64), counts) + within
    column = np.repeat(np.array(place.column, dtype=np.int64), counts)
    filled = values != 0.0
    return sparse.coo_array((values[filled], (row[filled], column[filled])), shape=shape)
