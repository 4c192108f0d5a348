"""Readers of Nastran's matrices: DMIG cards and formatted OUTPUT4."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import scipy.sparse as sparse

from vibroimpact.models.labels import Content, label
from vibroimpact_schema import number_tables
from vibroimpact_schema.matrix_market import LOST
from vibroimpact_schema.number_tables import TextError, shown

# Also 1.5-3, an exponent without its letter.
_NUMBER: Final = re.compile(
    r"([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))(?:[eEdD]([+-]?[0-9]+)|([+-][0-9]+))?"
)
_WHOLE: Final = re.compile(r"[+-]?[0-9]{1,15}")
_FORMAT: Final = re.compile(r"([0-9]+)[EeDd]([0-9]+)\.[0-9]+")
_MOST_ROWS: Final = 2**31 - 1
End = tuple[int, int]
"""A node and a component, 1 to 6, or 0 of a scalar point."""


class ComplexMatrix:
    """A matrix with imaginary parts, which can be left out but not used."""

    def __init__(self, name: str, line: int) -> None:
        self.reason = f"line {line}: {name} is complex: its imaginary part {LOST}"


def number(text: str, line: int) -> float:
    """Return a number such as ``1.5-3``, ``1.5D-3`` or ``1.5E-3``."""
    match = _NUMBER.fullmatch(text)
    if match is None:
        raise TextError(line, number_tables.why_no_number(text.encode("latin-1")))
    value = float(f"{match[1]}e{match[2] or match[3] or 0}")
    if abs(value) == float("inf"):
        raise number_tables.NotFiniteError(line, f"{text!r} is beyond double precision")
    return value


def whole(text: str, line: int) -> int:
    """Return a whole number."""
    if _WHOLE.fullmatch(text) is None:
        raise TextError(line, f"{shown(text.encode('latin-1'))} is not a whole number")
    return int(text)


def _lines(path: Path) -> list[str]:
    return number_tables.plain(path.read_bytes()).decode("latin-1").split("\n")


# -- DMIG ----------------------------------------------------------------------------------


@dataclass
class _Cards:
    """The entries of a matrix while its cards are read."""

    entries: dict[tuple[End, End], float] = field(default_factory=dict)
    complex_line: int = 0
    column: End | None = None

    def add(self, fields: Sequence[str], line: int) -> None:
        """Add the entries of a line: groups of node, component, real and imaginary part."""
        for start in range(0, len(fields), 4):
            node, component, real, imaginary = [*fields[start : start + 4], "", "", "", ""][:4]
            if not any((node, component, real, imaginary)):
                continue
            row = whole(node, line), whole(component or "0", line)
            if self.column is None:
                raise TextError(line, "an entry before the first column")
            if (row, self.column) in self.entries:
                raise TextError(line, f"the entry of node {row[0]}, {row[1]} is given twice")
            self.entries[row, self.column] = number(real, line)
            if imaginary and number(imaginary, line) and not self.complex_line:
                self.complex_line = line


def dmig(path: Path) -> Content:
    """Read cards DMIG: a head, and for every column its entries, in small, large or free fields."""
    cards: dict[str, _Cards] = {}
    current: _Cards | None = None
    lines = _lines(path)
    for line, text in enumerate(lines, 1):
        name, fields = _fields(text)
        if name == "DMIG" and fields[1] == "0":
            current = None  # a head, which large fields continue in the next line
            cards.setdefault(fields[0].upper(), _Cards())
        elif name == "DMIG":
            current = cards.setdefault(fields[0].upper(), _Cards())
            current.column = whole(fields[1], line), whole(fields[2] or "0", line)
            current.add(fields[4:], line)
        elif name:
            current = None  # another card
        elif current is not None:
            current.add(fields, line)
    if not any(each.entries for each in cards.values()):
        raise TextError(len(lines), "there are no cards DMIG with entries")
    _check_last(lines)
    ends = sorted({end for each in cards.values() for pair in each.entries for end in pair})
    place = {end: row for row, end in enumerate(ends)}
    return Content(
        {name: _assembled(name, each, place) for name, each in cards.items()},
        [label(*end) for end in ends],
    )


def _assembled(name: str, cards: _Cards, place: dict[End, int]) -> Any:
    if cards.complex_line:
        return ComplexMatrix(name, cards.complex_line)
    rows = [place[row] for row, _ in cards.entries]
    columns = [place[column] for _, column in cards.entries]
    shape = (len(place), len(place))
    return sparse.coo_array((list(cards.entries.values()), (rows, columns)), shape=shape)


def _fields(line: str) -> tuple[str, list[str]]:
    """Return the name of a card, "" of what continues one, and its data fields without blanks."""
    line = line.partition("$")[0].rstrip().expandtabs(8)
    if not line:
        return "", []
    large = "*" in line[:8]
    count = 4 if large else 8
    if "," in line:
        first, *fields = (part.strip() for part in line.split(","))
    else:
        width = 16 if large else 8
        first, data = line[:8].strip(), line[8:72]
        fields = [data[k : k + width].strip() for k in range(0, len(data), width)]
    first = first.rstrip("*").strip()
    name = "" if first.startswith(("+", "*")) else first.upper()
    padded = 8 if name else count
    return name, [*fields, *[""] * padded][:padded]


def _check_last(lines: Sequence[str]) -> None:
    """Refuse a last line of fixed fields that was cut off: without an end, and shorter."""
    last = lines[-1].rstrip()
    if not last or "," in last:
        return
    alike = {len(text.rstrip()) for text in lines[:-1] if text[:1] == last[:1] and "," not in text}
    if alike and len(last) < min(alike):
        raise TextError(len(lines), "the file ends within this line")


# -- OUTPUT4 -------------------------------------------------------------------------------


def output4(path: Path) -> Content:
    """Read formatted OUTPUT4: heads of matrices, of columns and of strings, and their numbers."""
    if b"\0" in path.read_bytes()[:64]:
        raise ValueError("it is binary: let Nastran write it FORMATTED")
    lines = _Lines(_lines(path))
    content: dict[str, Any] = {}
    while not lines.at_end():
        name, matrix = _matrix(lines)
        if name in content:
            raise TextError(lines.number, f"there are two matrices {name}")
        content[name] = matrix
    return Content(content, [])


class _Lines:
    """The lines of a file, one after the other."""

    def __init__(self, lines: Sequence[str]) -> None:
        self._lines = lines
        self.number = 0

    def at_end(self) -> bool:
        """Return whether nothing but blanks follows."""
        return not any(line.strip() for line in self._lines[self.number :])

    def next(self) -> str:
        """Return the next line."""
        if self.number >= len(self._lines):
            raise TextError(self.number, "the file ends within a matrix")
        self.number += 1
        return self._lines[self.number - 1].rstrip()

    def next_words(self) -> list[str]:
        """Return the fields of eight characters of the line that is read next."""
        line = self.next()
        self.number -= 1
        return [line[k : k + 8].strip() for k in range(0, len(line), 8)]

    def numbers(self, width: int) -> Iterator[float]:
        """Yield the numbers of the lines that follow, in fields of a width."""
        while self.number < len(self._lines) and "." in self._lines[self.number]:
            line = self.next()
            for start in range(0, len(line), width):
                yield number(line[start : start + width].strip(), self.number)


def _matrix(lines: _Lines) -> tuple[str, Any]:
    """Read a matrix: its name, and its entries."""
    head = lines.next()
    began = lines.number
    columns, rows, _, kind = (whole(head[k : k + 8].strip(), began) for k in range(0, 32, 8))
    name, form = head[32:40].strip(), _FORMAT.search(head[40:])
    rows = abs(rows)
    if not name or form is None or not 0 < columns <= _MOST_ROWS or not 0 < rows <= _MOST_ROWS:
        raise TextError(began, "it is no head of a matrix: columns, rows, form, type, name, format")
    width = int(form[2])
    places = list[tuple[int, int]]()
    values = list[float]()
    per_number = set[float]()
    column, row, words = _column_head(lines)
    while column <= columns:
        for start, count in _strings(lines, row, words):
            numbers = list(lines.numbers(width))
            # Either numbers are counted, or words, of which double precision has two.
            per_number.add(count / len(numbers) if numbers else 0.0)
            if kind <= 2 and per_number not in ({1.0}, {2.0}):
                raise TextError(lines.number, f"{len(numbers)} numbers in {count} words")
            if start < 1 or (kind <= 2 and start + len(numbers) - 1 > rows):
                raise TextError(lines.number, f"rows from {start} on, of {rows}")
            places += [(start - 1 + k, column - 1) for k in range(len(numbers))]
            values += numbers
        last, (column, row, words) = column, _column_head(lines)
        if column <= last:
            raise TextError(lines.number, f"column {column} behind column {last}")
    ending = lines.next()  # a number, of a column behind the last
    number(ending[:width].strip(), lines.number)
    if kind > 2:
        return name, ComplexMatrix(name, began)
    entries = [(place, value) for place, value in zip(places, values, strict=True) if value]
    index = [tuple(place[side] for place, _ in entries) for side in (0, 1)]
    return name, sparse.coo_array(([v for _, v in entries], (index[0], index[1])), (rows, columns))


def _column_head(lines: _Lines) -> tuple[int, int, int]:
    words = lines.next_words()
    lines.next()
    if len(words) != 3:
        raise TextError(lines.number, "it is no head of a column: column, first row, words")
    column, row, count = (whole(word, lines.number) for word in words)
    return column, row, count


def _strings(lines: _Lines, row: int, words: int) -> Iterator[tuple[int, int]]:
    """Yield first row and number of words of the parts of a column, each before its numbers."""
    if row:
        yield row, words
        return
    count = length_of_all = 0
    while len(parts := lines.next_words()) < 3:
        lines.next()
        values = [whole(part, lines.number) for part in parts]
        if len(values) == 2:  # a matrix with more than 65535 rows
            length, start = values[0] - 1, values[1]
        else:
            length, start = values[0] // 65536 - 1, values[0] % 65536
        count, length_of_all = count + 1, length_of_all + length
        yield start, length
    # The head of a string counts as one word or as two.
    if words - length_of_all not in (count, 2 * count):
        raise TextError(lines.number, f"a column of {words} words has others behind it")
