"""Readers of matrices in texts: Matrix Market, lists of entries as of Abaqus, and whole rows."""

from __future__ import annotations

import itertools
import re
from typing import Any, Final

import numpy as np
import scipy.sparse as sparse

from vibroimpact_schema import matrix_market, number_tables
from vibroimpact_schema.files.bounds import LOCAL, Bounds
from vibroimpact_schema.files.labels import STACKS, Content, label
from vibroimpact_schema.number_tables import NumberTable, TextError

_INSTANCE: Final = re.compile(rb"(?<![\w.\-])[\"']?([A-Za-z][\w\-]*)[\"']?\.(?=[0-9])")
"""The name of a part before a node, as Abaqus writes it: ``PART-1-1.17``."""
_OF_ENTRIES: Final = (b"row", b"i", b"node", b"node1")
"""First titles of lists of entries."""


def market_or_list(data: bytes, bounds: Bounds = LOCAL) -> Content:
    """Read ``.mtx``: Matrix Market, or Abaqus ``*MATRIX GENERATE`` in any of its formats."""
    text = number_tables.plain(data)
    if matrix_market.has_header(text):
        return market(text, bounds)
    text = _without_part(number_tables.without_comments(text, b"*%#"))
    return entries(number_tables.read(text, comma=b","))


def entries(table: NumberTable) -> Content:
    """Return the matrix of rows ``row, column, value`` or ``node, dof, node, dof, value``."""
    width = table.values.shape[1]
    if width == 3:
        listed, sized = matrix_market.read_list(table)
        return Content({"": _sparse(listed)}, [] if sized else None)
    if width != 5:
        reason = f"{width} numbers; lists of entries have 3 or 5, without decimal commas"
        raise TextError(table.row(0)[0], reason)
    ends = table.whole(4).reshape(-1, 2)
    if np.abs(ends[:, 0]).max() >= 2**40 or np.abs(ends[:, 1]).max() >= 2**20:
        raise TextError(table.row(0)[0], "a node or a direction has too large a number")
    known, index = np.unique(ends[:, 0] * 2**21 + ends[:, 1], return_inverse=True)
    first = np.zeros(len(known), dtype=np.int64)
    first[index] = np.arange(len(ends))
    pairs = index.reshape(-1, 2)
    shape = (len(known), len(known))
    matrix = sparse.coo_array((table.values[:, 4], (pairs[:, 0], pairs[:, 1])), shape=shape)
    return Content({"": matrix}, [label(int(node), int(dof)) for node, dof in ends[first]])


def triangle(data: bytes, bounds: Bounds = LOCAL) -> Content:
    """Read ``.sti`` and ``.mas`` of CalculiX: ``row column value`` of the upper triangle."""
    return entries(number_tables.read(number_tables.plain(data)))


def rows(data: bytes, bounds: Bounds = LOCAL) -> Content:
    """Read ``.csv`` and ``.txt``: all rows, or entries, apart by blanks, commas or semicolons.

    A line of titles may come before, and a column of numbers of rows, as pandas writes both.
    """
    text = number_tables.plain(data)
    if matrix_market.has_header(text):
        return market(text, bounds)
    table, titles = _table(text)
    count, width = table.values.shape
    listed = bool(titles) and titles[0].lower() in _OF_ENTRIES
    if width in (3, 5) and (listed or (count != width and not (titles and width == count + 1))):
        return entries(table)
    values = table.values
    if titles and width == count + 1 and _counts(values[:, 0]):
        values = values[:, 1:]
    return Content({"": values}, [])


def _counts(column: Any) -> bool:
    """Return whether numbers are those of rows, from 0 or from 1 on."""
    return bool((np.diff(column) == 1.0).all()) and column[0] in (0.0, 1.0)


def numbers(text: bytes) -> Any:
    """Return the numbers of a text whose lines have as many each, shape (line, number)."""
    return _table(text)[0].values


def _table(text: bytes) -> tuple[NumberTable, list[bytes]]:
    """Return the numbers of a text, and the titles that stood before them."""
    text = number_tables.without_comments(text, b"#%")
    comma = next((sign for sign in (b";", b",") if sign in text), b"")
    first = re.search(rb"\S[^\n]*", text)
    head = first[0] if first else b""
    words = [word.strip(b" \t\"'") for word in (head.split(comma) if comma else head.split())]
    titled = (any(words) and all(map(_is_title, words))) or _numbers_columns(words)
    if first and titled:
        end = text.find(b"\n", first.start())
        end = len(text) if end < 0 else end
        text = text[: first.start()] + b" " * (end - first.start()) + text[end:]
    return number_tables.read(text, comma=comma), words if titled else []


def _is_title(word: bytes) -> bool:
    """Return whether a word names a column: it begins with a letter, or is empty."""
    return (word[:1].isalpha() and word.lower() not in (b"nan", b"inf", b"infinity")) or not word


def _numbers_columns(words: list[bytes]) -> bool:
    """Return whether a line is blank and then 0, 1, 2, ... as pandas numbers columns."""
    counted = [b"%d" % k for k in range(len(words) - 1)]
    return len(words) > 1 and not words[0] and words[1:] == counted


def _without_part(text: bytes) -> bytes:
    """Return a text without the name of a part before nodes.

    Raises
    ------
    TextError
        If there are several: their nodes have the same numbers.
    """
    parts = set(_INSTANCE.findall(text))
    if len(parts) > 1:
        shown = b", ".join(sorted(parts)[:3]).decode("latin-1")
        raise TextError(1, f"nodes of several parts, {shown}: number them in one assembly")
    return _INSTANCE.sub(b"", text) if parts else text


def market(text: bytes, bounds: Bounds = LOCAL) -> Content:
    """Read a text of Matrix Market: a matrix, or M and K, or M, K and C, behind another."""

    def check_shape(rows: int, columns: int) -> None:
        bounds.check_rows(max(rows, columns))

    most = max(STACKS)
    matrices = list(itertools.islice(matrix_market.read(text, check_shape), most + 1))
    if len(matrices) > most:
        raise TextError(1, f"more than {most} matrices in one text: M K, or M K C are expected")
    given = [each if isinstance(each, np.ndarray) else _sparse(each) for each in matrices]
    return Content(dict(zip(STACKS[len(given)], given, strict=True)), [])


def _sparse(given: matrix_market.Entries) -> Any:
    return sparse.coo_array((given.data, (given.row, given.col)), shape=given.shape)
