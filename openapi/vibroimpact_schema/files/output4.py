"""Reader of formatted OUTPUT4: heads of matrices, of columns and of strings, and their numbers.

The layout: MSC Nastran 2012 DMAP Programmer's Guide, module OUTPUT4, remarks 1 to 5. Columns are
whole, from the first to the last entry that is not zero, or in strings of entries. The head of a
string is ``IROW + 65536 (L + 1)``, or ``L + 1`` and IROW where a matrix has more than 65,535 rows.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import scipy.sparse as sparse

from vibroimpact_schema.files import file_bytes, fixed_fields, output4_binary
from vibroimpact_schema.files.bounds import LOCAL, Bounds, check_count
from vibroimpact_schema.files.labels import ComplexMatrix, Content
from vibroimpact_schema.number_tables import TextError

_FORMAT: Final = re.compile(rb"(?<![0-9])([0-9]{1,3})[EeDd]([0-9]{1,2})\.[0-9]")
_MOST_ROWS: Final = 2**31 - 1
_REAL: Final = (1, 2)
"""Types of real matrices, single and double precision; 3 and 4 are complex."""
_WIDTHS: Final = (8, 16)
"""Characters of a whole number: of usual files, and of those of large models."""


def output4(data: bytes, bounds: Bounds = LOCAL) -> Content:
    """Read OUTPUT4, formatted or binary."""
    if b"\0" in data[:64]:
        return Content(output4_binary.matrices(data), [])
    reader = _Reader(file_bytes.lines(data, bounds))
    content: dict[str, Any] = {}
    while not reader.at_end():
        line = reader.at + 1
        name, matrix = reader.matrix()
        if name in content:
            raise TextError(line, f"there are two matrices {name}")
        check_count(len(content) + 1)
        content[name] = matrix
    return Content(content, [])


@dataclass(frozen=True)
class _Head:
    """The first line of a matrix."""

    name: str
    rows: int
    columns: int
    kind: int
    width: int
    """Characters of a number."""
    whole_width: int
    """Characters of a whole number."""


@dataclass
class _Strings:
    """The strings of a matrix: where their numbers stand."""

    row: array[int] = field(default_factory=lambda: array("q"))
    """Row of the first entry, from 0."""
    column: array[int] = field(default_factory=lambda: array("q"))
    words: array[int] = field(default_factory=lambda: array("q"))
    first: array[int] = field(default_factory=lambda: array("q"))
    """First line of the numbers, from 0."""
    stop: array[int] = field(default_factory=lambda: array("q"))
    """The line behind them."""


class _Reader:
    """The lines of a file, one after the other."""

    def __init__(self, lines: Sequence[bytes]) -> None:
        self._lines = lines
        self.at = 0

    def at_end(self) -> bool:
        """Return whether nothing but blanks follows."""
        while self.at < len(self._lines) and not self._lines[self.at].strip():
            self.at += 1
        return self.at >= len(self._lines)

    def matrix(self) -> tuple[str, Any]:
        """Read a matrix: its name, and its entries."""
        head, began = self._head(), self.at
        strings, last = _Strings(), 0
        while True:
            column, row, words = self._whole(head, 3)
            if column <= last:
                raise TextError(self.at, f"column {column} behind column {last}")
            if column > head.columns:
                break
            last = column
            if row:
                self._numbers(strings, (row - 1, column - 1), words)
            else:
                self._column(head, strings, column, words)
        self._ending(head)
        if head.kind not in _REAL:
            return head.name, ComplexMatrix(head.name, began)
        return head.name, self._assembled(head, strings)

    def _head(self) -> _Head:
        text = self._next()
        for whole_width in _WIDTHS:
            sizes = 4 * whole_width
            form = _FORMAT.search(text, sizes + 8)
            name = text[sizes : sizes + 8].decode("latin-1").strip()
            if form is None or not name or " " in name:
                continue
            try:
                columns, rows, _, kind = fixed_fields.whole_numbers(
                    text[:sizes], whole_width, 4, self.at
                )
            except TextError:
                continue
            if 0 <= columns <= _MOST_ROWS and abs(rows) <= _MOST_ROWS and 1 <= kind <= 4:
                width = int(form[2]) or 1
                return _Head(name, abs(rows), columns, kind, width, whole_width)
        raise TextError(
            self.at, "it is no head of a matrix: columns, rows, form, type, name, format"
        )

    def _whole(self, head: _Head, count: int) -> list[int]:
        return fixed_fields.whole_numbers(self._next(), head.whole_width, count, self.at)

    def _next(self) -> bytes:
        if self.at >= len(self._lines):
            raise TextError(self.at, "the file ends within a matrix")
        self.at += 1
        return self._lines[self.at - 1]

    def _numbers(self, strings: _Strings, start: tuple[int, int], words: int) -> None:
        """Take the lines of numbers that follow: they have points, heads do not."""
        first = self.at
        while self.at < len(self._lines) and b"." in self._lines[self.at]:
            self.at += 1
        strings.row.append(start[0])
        strings.column.append(start[1])
        strings.words.append(words)
        strings.first.append(first)
        strings.stop.append(self.at)

    def _column(self, head: _Head, strings: _Strings, column: int, words: int) -> None:
        """Take the strings of a column."""
        before, width = len(strings.words), head.whole_width
        while self.at < len(self._lines):
            count = len(self._lines[self.at].split())
            if count > 2 or len(self._lines[self.at].rstrip()) > max(2 * width, 11):
                break
            if count == 2:
                length, row = self._whole(head, 2)
                length -= 1
            else:
                # As MSC writes it in eleven characters: it exceeds eight from 1,525 words on.
                (both,) = fixed_fields.whole_numbers(self._next(), 16, 1, self.at)
                length, row = both // 65536 - 1, both % 65536
            self._numbers(strings, (row - 1, column - 1), length)
        count = len(strings.words) - before
        beside = words - sum(strings.words[before:])
        # The head of a string counts as one word or as two; some programs count it once a column.
        if beside not in (count, 2 * count, 1, 0):
            raise TextError(self.at, f"a column of {words} words has others behind it")

    def _ending(self, head: _Head) -> None:
        """Take the numbers, usually one, of a column behind the last."""
        first = self.at
        while self.at < len(self._lines) and b"." in self._lines[self.at][: head.width]:
            if _FORMAT.search(self._lines[self.at]):
                break
            self.at += 1
        rows = self._lines[first : self.at]
        if not rows:
            raise TextError(self.at, "the file ends within a matrix")
        fixed_fields.numbers(rows, head.width, range(first + 1, self.at + 1))

    def _assembled(self, head: _Head, strings: _Strings) -> Any:
        """Return the matrix of strings."""
        shape = (head.rows, head.columns)
        if not strings.words:
            return sparse.coo_array(shape)
        first = np.array(strings.first)
        taken = np.array(strings.stop) - first
        at = np.repeat(first - np.cumsum(taken) + taken, taken) + np.arange(taken.sum())
        rows = [self._lines[line].rstrip() for line in at.tolist()]
        values = fixed_fields.numbers(rows, head.width, (at + 1).tolist())
        fields = -(-np.fromiter(map(len, rows), np.int64, len(rows)) // head.width)
        ends = np.concatenate([[0], np.cumsum(fields)])
        counts = np.diff(ends[np.concatenate([[0], np.cumsum(taken)])])
        self._check(head, strings, counts, values.size)
        within = np.arange(values.size) - np.repeat(np.cumsum(counts) - counts, counts)
        row = np.repeat(np.array(strings.row), counts) + within
        column = np.repeat(np.array(strings.column), counts)
        filled = values != 0.0
        return sparse.coo_array((values[filled], (row[filled], column[filled])), shape=shape)

    def _check(self, head: _Head, strings: _Strings, counts: Any, total: int) -> None:
        """Check that strings have as many numbers as they say, and lie within the matrix."""
        words, start, last = (np.array(x) for x in (strings.words, strings.row, strings.stop))
        # Either numbers are counted, or words, of which double precision has two.
        alike = [(words == counts * ratio).all() for ratio in (1, 2)]
        if not any(alike) or total != counts.sum():
            ratio = 2 if (words == 2 * counts).sum() > (words == counts).sum() else 1
            wrong = int(np.argmax(words != ratio * counts))
            raise TextError(int(last[wrong]), f"{counts[wrong]} numbers in {words[wrong]} words")
        outside = (start < 0) | (start + counts > head.rows)
        if outside.any():
            wrong = int(np.argmax(outside))
            raise TextError(int(last[wrong]), f"rows from {start[wrong] + 1} on, of {head.rows}")
