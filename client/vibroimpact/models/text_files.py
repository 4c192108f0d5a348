"""Readers of matrices in texts: Matrix Market, lists of entries as of Abaqus, and whole rows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sparse

from vibroimpact.models.labels import Content, label
from vibroimpact_schema import matrix_market, number_tables
from vibroimpact_schema.number_tables import TextError


def market_or_list(path: Path) -> Content:
    """Read ``.mtx``: Matrix Market, or Abaqus ``*MATRIX GENERATE`` in either of its formats."""
    text = number_tables.plain(path.read_bytes())
    if matrix_market.has_header(text):
        return _market(text)
    table = number_tables.read(text, comments=b"*%#", comma=b",")
    width = table.values.shape[1]
    if width == 3:
        entries, sized = matrix_market.read_list(table)
        return Content({"": _sparse(entries)}, [] if sized else None)
    if width != 5:
        reason = f"{width} numbers; lists of entries have 3 or 5, without decimal commas"
        raise TextError(table.row(0)[0], reason)
    ends = table.whole(4).reshape(-1, 2)
    known, index = np.unique(ends, axis=0, return_inverse=True)
    pairs = index.reshape(-1, 2)
    shape = (len(known), len(known))
    matrix = sparse.coo_array((table.values[:, 4], (pairs[:, 0], pairs[:, 1])), shape=shape)
    return Content({"": matrix}, [label(int(node), int(dof)) for node, dof in known])


def rows(path: Path) -> Content:
    """Read ``.csv`` and ``.txt``: all rows, their numbers apart by blanks, commas or semicolons."""
    text = number_tables.plain(path.read_bytes())
    if matrix_market.has_header(text):
        return _market(text)
    return Content({"": numbers(text)}, [])


def numbers(text: bytes) -> Any:
    """Return the numbers of a text whose lines have as many each, shape (line, number)."""
    text = number_tables.without_comments(text, b"#%")
    comma = next((sign for sign in (b";", b",") if sign in text), b"")
    return number_tables.read(text, comma=comma).values


def _market(text: bytes) -> Content:
    matrices = list(matrix_market.read(text))
    if len(matrices) != 1:
        raise TextError(1, f"{len(matrices)} matrices in one text; expected one")
    matrix = matrices[0]
    return Content({"": matrix if isinstance(matrix, np.ndarray) else _sparse(matrix)}, [])


def _sparse(entries: matrix_market.Entries) -> Any:
    return sparse.coo_array((entries.data, (entries.row, entries.col)), shape=entries.shape)
