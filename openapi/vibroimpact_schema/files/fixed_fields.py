"""Numbers in fields of fixed width, as Fortran writes them: without separators between them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from vibroimpact_schema import number_tables
from vibroimpact_schema.number_tables import Floats, TextError, shown

_LETTERLESS: Final = re.compile(rb"([0-9.])([+-][0-9]+)(?=\s)")
"""An exponent without its letter, as in 1.5-300."""
_ROWS: Final = 1 << 15
"""Lines that are taken apart at once, for the sake of memory."""
_LONGEST: Final = 1000
"""Characters of a line, to which all lines are filled up; programs write 80 to 132."""
_FORMAT: Final = re.compile(r"(?<![0-9])([0-9]{0,4})[A-Z]{1,2}([0-9]{1,4})(?![0-9])")
_SCALE: Final = re.compile(r"(?<![0-9])[0-9]{1,4}[Pp]")
_WIDEST: Final = 100
"""Characters of a number."""
_WHOLE: Final = re.compile(rb"[+-]?[0-9]{1,15}")
_BLANK: Final = ord(" ")


def numbers(rows: Sequence[bytes], width: int, lines: Sequence[int]) -> Floats:
    """Return the numbers of lines, one behind the other; blank fields are left out.

    Parameters
    ----------
    rows : sequence of bytes
        The lines, without zero bytes.
    width : int
        Characters in each field.
    lines : sequence of int
        Their numbers, for messages.

    Raises
    ------
    TextError
        With the first line that has a field that is no number, or is too long for fields.
    """
    parts = [np.zeros(0)]
    for row, line in zip(rows, lines, strict=False):
        if len(row) > _LONGEST:
            raise TextError(line, f"{len(row)} characters; fields end after {_LONGEST} at most")
    for start in range(0, len(rows), _ROWS):
        fields = table(rows[start : start + _ROWS], width)
        parts.append(parsed(fields, lines[start : start + _ROWS]))
    return np.concatenate(parts)


def table(rows: Sequence[bytes], width: int, count: int = 0) -> Any:
    """Return the characters of the fields of lines, shape (line, field, width)."""
    count = count or max(1, -(-max(map(len, rows), default=1) // width))
    text = np.array(rows, dtype=f"S{count * width}").view(np.uint8)
    return np.where(text == 0, np.uint8(_BLANK), text).reshape(len(rows), count, width)


def is_blank(fields: Any) -> Any:
    """Return which fields have no characters but blanks."""
    return (fields == _BLANK).all(axis=-1)


def parsed(fields: Any, lines: Sequence[int]) -> Floats:
    """Return the numbers of fields, shape (line, field, width), row by row without blank ones."""
    rows, count, width = fields.shape
    spaced = np.full((rows, count, width + 1), _BLANK, dtype=np.uint8)
    spaced[:, :, :width] = fields
    spaced[:, -1, -1] = ord("\n")
    text = spaced.tobytes()
    if _LETTERLESS.search(text):
        text = _LETTERLESS.sub(rb"\1E\2", text)
    try:
        return number_tables.stream(text)
    except TextError as error:
        place = type(error)(int(lines[error.line - 1]), error.reason)
        raise place from None


def whole_numbers(line: bytes, width: int, count: int, number: int) -> list[int]:
    """Return the whole numbers of a line: words, or fields of a width where they touch.

    Raises
    ------
    TextError
        If there are others than `count`.
    """
    words = line.split()
    if len(words) != count:
        words = [line[k : k + width].strip() for k in range(0, len(line.rstrip()), width)]
    if len(words) != count or not all(map(_WHOLE.fullmatch, words)):
        raise TextError(number, f"{shown(line.strip())} instead of {count} whole numbers")
    return [int(word) for word in words]


def layout(form: str) -> tuple[int, int] | None:
    """Return the numbers in a line and their width by a format of Fortran: ``(1P,3E23.16)``."""
    match = _FORMAT.search(_SCALE.sub("", form[:_LONGEST].upper()))
    if match is None:
        return None
    per_line, width = int(match[1] or 1), int(match[2])
    return (per_line, width) if per_line >= 1 and 1 <= width <= _WIDEST else None
