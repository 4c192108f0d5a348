"""Matrix Market texts, and lists of entries without its header.

::

    %%MatrixMarket matrix coordinate real symmetric
    % comments
    3 3 4                  rows, columns, entries
    1 1 2.5                row, column, value; rows and columns from 1
    ...

or ``array`` in place of ``coordinate``: ``rows columns``, then the values column by column, of
symmetric matrices those from the diagonal down. The format is told by the header alone, and every
token is checked. Read although they are wrong, because they can mean one matrix only: exponents of
Fortran; entries counted from 0, where (0, 0) is among them and the last index is not; one triangle
of a ``general`` matrix, or all entries of a ``symmetric`` one. Refused with line and reason is
everything else: patterns, which have no values; imaginary parts other than 0; another number of
entries than announced.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroimpact_schema import number_tables
from vibroimpact_schema.imaginary import LOST
from vibroimpact_schema.number_tables import Floats, NumberTable, TextError

Indices = NDArray[np.int64]

_BANNER: Final = re.compile(rb"^[ \t]*%+[ \t]*MatrixMarket\b[^\n]*$", re.IGNORECASE | re.MULTILINE)
_SIZES: Final = re.compile(rb"[0-9]{1,15}(?:[ \t\v\f]+[0-9]{1,15})*")
_WHOLE: Final = re.compile(rb"[0-9]+")
_FIELDS: Final = ("real", "double", "integer", "unsigned-integer", "complex")
_SYMMETRIES: Final = ("general", "symmetric", "hermitian")
LARGEST: Final = 2**31 - 1
"""Rows that a matrix can have."""


@dataclass(frozen=True, eq=False)
class Entries:
    """The entries of a matrix; symmetric ones are both given.

    Parameters
    ----------
    shape : tuple of int
        Rows and columns.
    row, col : array of int, shape (entry,)
        From 0.
    data : array, shape (entry,)
        Values; those at one place add up.
    """

    shape: tuple[int, int]
    row: Indices
    col: Indices
    data: Floats


Matrix = Entries | Floats
"""A matrix as a text gives it: its entries, or all of its rows."""
CheckShape = Callable[[int, int], None]


def has_header(text: bytes) -> bool:
    """Return whether a text, as `plain` returns it, has the header of Matrix Market."""
    return _BANNER.search(text) is not None


def read(text: bytes, check_shape: CheckShape = lambda rows, columns: None) -> Iterator[Matrix]:
    """Yield the matrices of texts that follow one another.

    Parameters
    ----------
    text : bytes
        As `number_tables.plain` returns it.
    check_shape : callable
        Called with rows and columns before entries are read.

    Raises
    ------
    TextError
        With line and reason.
    """
    starts = [banner.start() for banner in _BANNER.finditer(text)]
    before = text[: starts[0]] if starts else text
    if not starts or number_tables.without_comments(before, b"%").strip():
        raise TextError(1, "it is not the header %%MatrixMarket matrix …, which tells the format")
    for start, end in zip(starts, [*starts[1:], len(text)], strict=True):
        yield _one(text[start:end], 1 + text.count(b"\n", 0, start), check_shape)


def _one(text: bytes, first_line: int, check_shape: CheckShape) -> Matrix:
    banner, _, _ = text.partition(b"\n")
    coordinates, field, symmetry = _header(banner, first_line)
    line, start, words = _first_words(text, first_line)
    if _SIZES.fullmatch(words) is None:
        wanted = "rows, columns and entries" if coordinates else "rows and columns"
        raise TextError(line, f"{number_tables.shown(words)} instead of {wanted}")
    sizes = [int(word) for word in words.split()]
    if len(sizes) != (3 if coordinates else 2):
        wanted = "rows, columns and entries" if coordinates else "rows and columns"
        raise TextError(line, f"{len(sizes)} numbers instead of {wanted}")
    rows, columns = sizes[:2]
    if max(rows, columns) > LARGEST or min(rows, columns) < 1:
        raise TextError(line, f"a matrix of {rows} rows and {columns} columns")
    if symmetry == "symmetric" and rows != columns:
        raise TextError(line, f"a matrix of {rows} x {columns} is not symmetric")
    check_shape(rows, columns)
    numbers = 1 + (field == "complex")
    width = 2 * coordinates + numbers
    body, following = text[start:], line + 1
    if coordinates:
        table = number_tables.read(body, first_line=following, comments=b"%", width=width)
        _check_count(len(table.values), sizes[2], "entries", line)
        _check_real(table)
        places = _from_zero(table.whole(2), (rows, columns), table)
        entries = Entries((rows, columns), places[:, 0], places[:, 1], table.values[:, 2].copy())
        return _mirrored(entries, symmetry == "symmetric", table)
    values = number_tables.stream(body, first_line=following, comments=b"%")
    return _array(values, (rows, columns), symmetry, numbers, line)


def _header(banner: bytes, line: int) -> tuple[bool, str, str]:
    """Return whether entries have coordinates, the kind of numbers, and the symmetry."""
    words = banner.decode("latin-1").lower().split("matrixmarket", 1)[1].split()[:4]
    if len(words) < 4 or words[0] != "matrix" or words[1] not in ("coordinate", "array"):
        raise TextError(
            line,
            "the header is not complete: %%MatrixMarket matrix, coordinate or array, real, "
            "integer or complex, general or symmetric",
        )
    _, layout, field, symmetry = words
    if field == "pattern":
        raise TextError(line, "a pattern tells where entries are, but has no values")
    if field not in _FIELDS:
        raise TextError(line, f"{field!r} is none of {', '.join(_FIELDS)}")
    if symmetry == "skew-symmetric":
        raise TextError(line, "a skew-symmetric matrix is no mass, stiffness or damping")
    if symmetry not in _SYMMETRIES:
        raise TextError(line, f"{symmetry!r} is none of {', '.join(_SYMMETRIES)}")
    return layout == "coordinate", field, "general" if symmetry == "general" else "symmetric"


def _first_words(text: bytes, first_line: int) -> tuple[int, int, bytes]:
    """Return the first line that is no comment: its number, the next one's start, its content."""
    start, number = 0, first_line
    while start < len(text):
        end = text.find(b"\n", start)
        end = len(text) if end < 0 else end
        words = text[start:end].partition(b"%")[0].strip()
        if words:
            return number, end + 1, words
        start, number = end + 1, number + 1
    raise TextError(number - 1, "the text ends before the sizes of the matrix")


def _check_count(follow: int, announced: int, what: str, line: int) -> None:
    if follow != announced:
        cut = "; is the file cut short?" if follow < announced else ""
        raise TextError(line, f"{announced} {what} are announced, {follow} follow{cut}")


def _check_real(table: NumberTable) -> None:
    """Refuse imaginary parts, which structures have as damping."""
    wrong = np.flatnonzero(table.values[:, 3:].any(axis=1))
    if wrong.size:
        line, words = table.row(wrong[0])
        raise TextError(line, f"the imaginary part {number_tables.shown(words[3])} {LOST}")


def _from_zero(indices: Indices, shape: tuple[int, int], table: NumberTable) -> Indices:
    """Return indices from 0, whichever way they are counted."""
    if not len(indices):
        return indices
    low, high = indices.min(axis=0), indices.max(axis=0)
    counted_from_zero = (
        low.min() == 0
        and bool((high < shape).all())
        and bool((indices == 0).all(axis=1).any())
        and high.max() == max(shape) - 1
    )
    if counted_from_zero:
        return indices
    wrong = (indices < 1) | (indices > np.asarray(shape))
    if wrong.any():
        entry, side = np.argwhere(wrong)[0]
        what = f"{('row', 'column')[side]} {indices[entry, side]}"
        raise TextError(table.row(entry)[0], f"{what} of {shape[side]}, counted from 1")
    return indices - 1


def _mirrored(entries: Entries, symmetric: bool, table: NumberTable) -> Entries:
    """Return all entries, where one triangle stands for the whole."""
    if entries.shape[0] != entries.shape[1]:
        return entries
    given = entries.data != 0.0
    lower, upper = given & (entries.row > entries.col), given & (entries.row < entries.col)
    both = bool(lower.any() and upper.any())
    if both and (not symmetric or _both_given(entries, lower, upper, table)):
        return entries
    beside = lower | upper
    return Entries(
        entries.shape,
        np.concatenate([entries.row, entries.col[beside]]),
        np.concatenate([entries.col, entries.row[beside]]),
        np.concatenate([entries.data, entries.data[beside]]),
    )


def _both_given(entries: Entries, lower: Any, upper: Any, table: NumberTable) -> bool:
    """Return whether a matrix that is called symmetric has all entries beside its diagonal.

    Raises
    ------
    TextError
        If some of them are given twice and others once, or differ.
    """
    n = entries.shape[0]
    below = entries.row[lower] * n + entries.col[lower]
    above = entries.col[upper] * n + entries.row[upper]
    twice = np.isin(above, below)
    if not twice.any():
        return False  # each is given once, on either side
    first, second = np.argsort(below, kind="stable"), np.argsort(above, kind="stable")
    same = below.size == above.size and bool(
        (below[first] == above[second]).all()
        and (entries.data[lower][first] == entries.data[upper][second]).all()
    )
    if not same:
        entry = int(np.flatnonzero(upper)[np.argmax(twice)])
        place = f"({entries.row[entry] + 1}, {entries.col[entry] + 1})"
        reason = f"entry {place} of a symmetric matrix is given on both sides of the diagonal"
        raise TextError(table.row(entry)[0], reason)
    return True


def _array(
    values: Floats, shape: tuple[int, int], symmetry: str, numbers: int, line: int
) -> Floats:
    """Return the rows of a matrix that is given column by column."""
    rows, columns = shape
    count = rows * columns if symmetry == "general" else rows * (rows + 1) // 2
    _check_count(values.size, count * numbers, "numbers", line)
    values = values.reshape(count, numbers)
    if values[:, 1:].any():
        raise TextError(line, f"the imaginary part of a number below {LOST}")
    if symmetry == "general":
        matrix = values[:, 0].reshape(columns, rows).T.copy()
        beside = matrix - np.diag(np.diagonal(matrix)) if rows == columns else matrix
        one_triangle = rows == columns and bool(np.triu(beside).any() != np.tril(beside).any())
        return matrix + beside.T if one_triangle else matrix
    matrix = np.zeros(shape)
    # The lower triangle column by column is the upper one row by row.
    matrix[np.triu_indices(rows)] = values[:, 0]
    return matrix + np.triu(matrix, 1).T


def read_list(table: NumberTable) -> tuple[Entries, bool]:
    """Return the matrix of rows ``row, column, value``, and whether its size is given.

    A first line ``n n entries`` is the size of a matrix whose header was lost where it announces
    the number of lines that follow, and cannot be an entry: its place occurs again, or other
    values are not written as whole numbers.

    Raises
    ------
    TextError
        Where it could be either, or indices are wrong.
    """
    if table.values.shape[1] != 3:
        raise TextError(table.row(0)[0], f"{table.values.shape[1]} numbers instead of 3")
    indices = table.whole(2)
    shape = None
    if _begins_with_sizes(table, indices):
        rows, columns = (int(size) for size in indices[0])
        if rows != columns:
            line, _ = table.row(0)
            raise TextError(line, f"a matrix of {rows} x {columns} is not square")
        shape, table, indices = (rows, columns), table.after_first(), indices[1:]
    if shape is None and indices.min() == 0 and (indices == 0).all(axis=1).any():
        places = indices  # counted from 0
    else:
        places = _from_zero(indices, shape or (LARGEST, LARGEST), table)
    n = int(places.max()) + 1
    entries = Entries(shape or (n, n), places[:, 0], places[:, 1], table.values[:, 2].copy())
    return _mirrored(entries, False, table), shape is not None


def _begins_with_sizes(table: NumberTable, indices: Indices) -> bool:
    """Return whether the first of three columns of numbers is ``rows columns entries``."""
    first, others = indices[0], indices[1:]
    line, words = table.row(0)
    if not (
        len(others) and (first >= others.max(axis=0)).all() and all(map(_WHOLE.fullmatch, words))
    ):
        return False
    announced, follow = int(table.values[0, 2]), len(others)
    repeated = bool((others == first).all(axis=1).any())
    all_alike = all(_WHOLE.fullmatch(each[2].lstrip(b"+-")) for _, each in table.lines())
    if announced == follow and (repeated or not all_alike):
        return True
    cut = follow < announced <= int(first[0]) * int(first[1]) and not all_alike
    if announced == follow or repeated or cut:
        raise TextError(
            line,
            f"it can be an entry, or the size of a matrix whose header was lost, with {announced} "
            f"entries, of which {follow} follow. Put %%MatrixMarket matrix coordinate real general "
            "before it, or write its value with a decimal point",
        )
    return False
