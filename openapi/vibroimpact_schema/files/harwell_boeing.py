"""Reader of Harwell-Boeing and Rutherford-Boeing files, as of ANSYS' HBMAT.

The layout: I. S. Duff, R. G. Grimes, J. G. Lewis, Users' Guide for the Harwell-Boeing Sparse
Matrix Collection, 1992, section 2. A head of three or four lines, or five with right-hand sides,
then where each column begins, the rows of its entries, and their values, each in a format of
Fortran.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import scipy.sparse as sparse

from vibroimpact_schema.files import file_bytes, fixed_fields
from vibroimpact_schema.files.bounds import LOCAL, Bounds
from vibroimpact_schema.files.labels import ComplexMatrix, Content
from vibroimpact_schema.number_tables import TextError, shown

_MOST_ROWS: Final = 2**31 - 1


def matrix(data: bytes, bounds: Bounds = LOCAL) -> Content:
    """Read the matrix of a file; a symmetric one has one triangle.

    Raises
    ------
    TextError
        If it has no values, is not assembled, or ends too early.
    """
    lines = file_bytes.lines(data, bounds)
    if len(lines) < 4:
        raise TextError(len(lines), "the file ends within the head of a matrix")
    counts = _whole(lines[1], 2)
    kind = lines[2][:3].decode("latin-1").upper()
    rows, columns, entries = _whole(lines[2][3:], 3)[:3]
    _check(kind, rows, columns, entries)
    if kind[0] == "C":
        return Content({"": ComplexMatrix("the matrix", 3)}, [])
    # Rutherford-Boeing has no fourth count for right-hand sides: its head is four lines too.
    right = len(counts) > 4 and counts[4] > 0
    at = 5 if right else 4
    formats = _formats(lines[3])
    parts, sizes = list[Any](), (columns + 1, entries, entries)
    for (per_line, width), size, what in zip(
        formats, sizes, ("starts of columns", "rows", "values"), strict=True
    ):
        count = -(-size // per_line)
        chosen, numbers = lines[at : at + count], range(at + 1, at + count + 1)
        values = fixed_fields.numbers([each[: per_line * width] for each in chosen], width, numbers)
        if values.size != size:
            last = min(at + count, len(lines))
            raise TextError(last, f"{values.size} {what} instead of {size}")
        parts.append(values)
        at += count
    starts, index, values = parts[0], parts[1], parts[2]
    _check_places(starts, index, rows, entries)
    column = np.repeat(np.arange(columns), np.diff(starts.astype(np.int64)))
    entries_of: Any = (values, (index.astype(np.int64) - 1, column))
    whole: Any = sparse.coo_array(entries_of, shape=(rows, columns))
    if kind[1] == "S":  # one triangle, whichever, or both of them as of ANSYS 9
        lower, upper = sparse.tril(whole, -1), sparse.triu(whole, 1)
        if not (lower.nnz and upper.nnz):
            whole = sparse.coo_array(whole + lower.T + upper.T)
    return Content({"": whole}, [])


def _whole(text: bytes, line: int) -> list[int]:
    words = text.split()
    if len(words) < 3 or not all(word.isdigit() and len(word) < 16 for word in words):
        raise TextError(line, f"{shown(text.strip())} instead of whole numbers")
    return [int(word) for word in words]


def _check(kind: str, rows: int, columns: int, entries: int) -> None:
    """Refuse matrices that have no values, are not assembled, or are not square."""
    if len(kind) < 3 or kind[0] not in "RCPI" or kind[1] not in "SUHZR" or kind[2] not in "AE":
        raise TextError(3, f"{kind!r} is no type of a matrix, such as RSA or RUA")
    if kind[0] == "P":
        raise TextError(3, "a pattern tells where entries are, but has no values")
    if kind[2] == "E":
        raise TextError(3, "element matrices are not read: let the program assemble them")
    if kind[1] == "Z":
        raise TextError(3, "a skew-symmetric matrix is no mass, stiffness or damping")
    if not 0 < max(rows, columns) <= _MOST_ROWS or min(rows, columns) < 1 or entries < 0:
        raise TextError(3, f"a matrix of {rows} x {columns} with {entries} entries")


def _formats(line: bytes) -> list[tuple[int, int]]:
    """Return numbers in a line and their widths, of starts, rows and values."""
    text = line.decode("latin-1")
    words = [text[:16], text[16:32], text[32:52]]
    layouts = [fixed_fields.layout(word) for word in words]
    if None in layouts:
        layouts = [fixed_fields.layout(word) for word in text.split()[:3]]
    if len(layouts) != 3 or None in layouts:
        raise TextError(4, f"{shown(line.strip())} are no formats of three kinds of numbers")
    return [each for each in layouts if each is not None]


def _check_places(starts: Any, index: Any, rows: int, entries: int) -> None:
    """Refuse entries outside of the matrix."""
    whole = bool((starts == np.floor(starts)).all() and (index == np.floor(index)).all())
    ordered = starts.size and starts[0] == 1 and starts[-1] == entries + 1
    if not (whole and ordered and bool((np.diff(starts) >= 0).all())):
        raise TextError(5, f"columns do not begin in order from 1 to {entries + 1}")
    if entries and not (index.min() >= 1 and index.max() <= rows):
        raise TextError(5, f"rows of entries from {index.min():g} to {index.max():g}, of {rows}")
