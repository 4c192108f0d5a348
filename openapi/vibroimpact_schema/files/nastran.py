"""Reader of Nastran's cards DMIG, in small, large and free fields.

The layout: MSC Nastran Quick Reference Guide, entry DMIG. A card has eight characters for its
name and then eight fields of 8 characters, or four of 16 where an asterisk follows its name, or
fields between commas; lines that begin with a blank, ``+`` or ``*`` continue the one before them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy.sparse as sparse

from vibroimpact_schema.files import file_bytes, fixed_fields
from vibroimpact_schema.files.bounds import LOCAL, Bounds, check_count
from vibroimpact_schema.files.labels import ComplexMatrix, Content, label
from vibroimpact_schema.number_tables import TextError

_NAME, _DATA, _WIDTH = 8, 64, 32
"""Characters of a name, of the fields of a line, and of a field in memory."""
_SYMMETRIC: Final = 6
_LONGEST: Final = 1000
"""Characters of a line in free fields; what stands behind them is no field of a card."""
_MOST_NODE: Final = 2**40
_ZERO: Final = np.frombuffer(b"0", dtype=np.uint8)[0]


def dmig(data: bytes, bounds: Bounds = LOCAL) -> Content:
    """Read cards DMIG: a head, and for every column its entries."""
    lines = file_bytes.lines(data, bounds)
    cards = _cards(lines)
    matrices = _matrices(cards)
    if not any(each.values.size for each in matrices.values()):
        raise TextError(len(lines), "there are no cards DMIG with entries")
    _check_last(lines)
    ends = np.concatenate([each.ends for each in matrices.values()]).reshape(-1, 2)
    known, index = np.unique(ends, axis=0, return_inverse=True)
    index, start = index.reshape(-1, 2), 0
    content: dict[str, Any] = {}
    for name, each in matrices.items():
        stop = start + each.values.size
        content[name] = _assembled(name, each, index[start:stop], len(known))
        start = stop
    return Content(content, [label(int(node), int(part)) for node, part in known])


def fields_of(line: bytes) -> tuple[bytes, list[bytes]]:
    """Return the name of a card, b"" of what continues one, and its data fields without blanks."""
    line = line.partition(b"$")[0].rstrip()[:_LONGEST].expandtabs(8)
    if not line:
        return b"", []
    large = b"*" in line[:_NAME]
    count = 4 if large else 8
    if b"," in line:
        first, *fields = map(bytes.strip, line.split(b","))
    else:
        width, data = _DATA // count, line[_NAME : _NAME + _DATA]
        first = line[:_NAME].strip()
        fields = [data[k : k + width].strip() for k in range(0, len(data), width)]
    first = first.rstrip(b"*").strip()
    name = b"" if first.startswith((b"+", b"*")) else first.upper()
    padded = 8 if name and b"," in line else count
    return name, [*fields, *[b""] * padded][:padded]


@dataclass(frozen=True, eq=False)
class _Cards:
    """Lines of cards, as many fields in each.

    Parameters
    ----------
    name : array of bytes, shape (line,)
        In capitals; b"" of what continues a card.
    fields : array of characters, shape (line, 8, width)
        Blank where a line has four.
    line : array of int, shape (line,)
        From 1.
    """

    name: Any
    fields: Any
    line: Any


def _cards(lines: Sequence[bytes]) -> _Cards:
    """Return the fields of lines that are not blank."""
    usual = [b"$" not in line and b"," not in line and b"\t" not in line for line in lines]
    at = np.flatnonzero(np.fromiter(map(bool, map(bytes.strip, lines)), bool, len(lines)))
    regular = np.array(usual, dtype=bool)[at]
    texts: Any = np.array([lines[k] for k in at.tolist()], dtype=f"S{_NAME + _DATA}")
    characters = fixed_fields.table(texts, _NAME + _DATA, 1)[:, 0]
    first = characters[:, :_NAME].copy().view(f"S{_NAME}").ravel()
    large = (characters[:, :_NAME] == ord("*")).any(axis=1)
    name = np.strings.upper(np.strings.strip(np.strings.rstrip(np.strings.strip(first), b"*")))
    name = np.where(np.isin(name.astype("S1"), [b"+", b"*"]), b"", name)
    width = 16 if regular.all() else _WIDTH
    fields = np.full((len(at), 8, width), ord(" "), dtype=np.uint8)
    data = characters[:, _NAME:]
    small = ~large
    fields[small, :, :8] = data[small].reshape(-1, 8, 8)
    fields[large, :4, :16] = data[large].reshape(-1, 4, 16)
    others, names, flat = np.flatnonzero(~regular), list[bytes](), list[bytes]()
    for number in at[others].tolist():
        given, parts = fields_of(lines[number])
        names.append(given)
        flat += parts[:8]
        flat += [b""] * (8 - len(parts))
    if names:
        name[others] = names
        free: Any = np.array(flat, dtype=f"S{width}").view(np.uint8)
        fields[others] = np.where(free == 0, np.uint8(ord(" ")), free).reshape(-1, 8, width)
    return _Cards(name, fields, at + 1)


@dataclass(frozen=True, eq=False)
class _Matrix:
    """The entries of a matrix as cards give them.

    Parameters
    ----------
    ends : array of int, shape (entry, 4)
        Node and component of row and column.
    values, imaginary : array, shape (entry,)
    line : array of int, shape (entry,)
    symmetric : bool
        Whether entries on one side of the diagonal stand for both.
    """

    ends: Any
    values: Any
    imaginary: Any
    line: Any
    symmetric: bool


def _matrices(cards: _Cards) -> dict[str, _Matrix]:
    """Return the matrices of all cards by their names."""
    words = cards.fields.reshape(len(cards.line), -1).copy().view(f"S{cards.fields.shape[2]}")
    starts = np.flatnonzero(cards.name != b"")
    owner = np.full(len(cards.line), -1)
    owner[starts] = starts
    owner = np.maximum.accumulate(owner) if len(owner) else owner
    named = np.flatnonzero(cards.name == b"DMIG")
    texts = np.strings.upper(np.strings.strip(words[named, :3]))
    is_head = texts[:, 1] == b"0"
    forms = {name: form for name, _, form in texts[is_head].tolist()}
    names, number = np.unique(texts[:, 0], return_inverse=True)
    check_count(len(names))
    matrix_of = np.full(len(cards.line), -1)
    matrix_of[named[~is_head]] = number[~is_head]
    used = np.flatnonzero((owner >= 0) & (matrix_of[owner] >= 0))
    entries = _entries(cards, used, owner)
    belongs = matrix_of[entries.card]
    order = np.argsort(belongs, kind="stable")
    parts = np.split(order, np.searchsorted(belongs[order], np.arange(1, len(names))))
    return {
        name.decode("latin-1"): _Matrix(
            entries.ends[part], entries.values[part, 0], entries.values[part, 1],
            entries.line[part], forms.get(name) == b"%d" % _SYMMETRIC,
        )
        for name, part in zip(names.tolist(), parts, strict=False)
    }  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Entries:
    """Entries of all matrices: as of `_Matrix`, with the card of each column."""

    ends: Any
    values: Any
    line: Any
    card: Any


def _entries(cards: _Cards, rows: Any, owner: Any) -> _Entries:
    """Return the entries in lines, of which each has one or two groups of four fields."""
    fields = cards.fields[rows]
    is_head = owner[rows] == rows
    groups = fields.reshape(len(rows), 2, 4, -1)
    filled = ~fixed_fields.is_blank(groups).all(axis=2)
    filled[is_head, 0] = False  # name, node and component of the column
    at, group = np.nonzero(filled)
    numbers = _filled(groups[at, group])
    line, card = cards.line[rows[at]], owner[rows[at]]
    values = fixed_fields.parsed(numbers, line).reshape(-1, 4)
    heads = np.unique(card)
    column = fixed_fields.parsed(_filled(cards.fields[heads][:, 1:3]), cards.line[heads])
    column = column.reshape(-1, 2)[np.searchsorted(heads, card)]
    ends = np.concatenate([values[:, :2], column], axis=1)
    wrong = (ends != np.floor(ends)).any(axis=1)
    if wrong.any():
        raise TextError(int(line[np.argmax(wrong)]), "a node or component is no whole number")
    large = (np.abs(ends) >= _MOST_NODE).any(axis=1)
    if large.any():
        raise TextError(int(line[np.argmax(large)]), "a node or component has too large a number")
    return _Entries(ends.astype(np.int64), values[:, 2:], line, card)


def _filled(fields: Any) -> Any:
    """Return fields with a zero in blank ones."""
    fields = fields.copy()
    fields[..., 0] = np.where(fixed_fields.is_blank(fields), _ZERO, fields[..., 0])
    return fields


def _assembled(name: str, given: _Matrix, index: Any, n: int) -> Any:
    lost = np.flatnonzero(given.imaginary)
    if lost.size:
        return ComplexMatrix(name, int(given.line[lost[0]]))
    row, column = index[:, 0], index[:, 1]
    _, first = np.unique(row * n + column, return_index=True)
    if first.size < row.size:
        again = int(np.setdiff1d(np.arange(row.size), first)[0])
        node, part = given.ends[again, :2]
        raise TextError(int(given.line[again]), f"the entry of node {node}, {part} is given twice")
    matrix = sparse.coo_array((given.values, (row, column)), shape=(n, n))
    if not given.symmetric:
        return matrix
    # Entries may stand on either side of the diagonal, or on both.
    larger, smaller = np.maximum(row, column), np.minimum(row, column)
    place, first, index = np.unique(larger * n + smaller, return_index=True, return_inverse=True)
    if (given.values != given.values[first][index]).any():
        return matrix  # not symmetric, which the model refuses
    beside = larger[first] != smaller[first]
    rows, columns = np.divmod(place, n)
    values = given.values[first]
    ends = np.concatenate([rows, columns[beside]]), np.concatenate([columns, rows[beside]])
    return sparse.coo_array((np.concatenate([values, values[beside]]), ends), shape=(n, n))


def _check_last(lines: Sequence[bytes]) -> None:
    """Refuse a last line of fixed fields that was cut off: without an end, and shorter."""
    last = lines[-1].rstrip()
    if not last or b"," in last:
        return
    alike = {
        len(text.rstrip())
        for text in lines[:-1]
        if text[:1] == last[:1] and b"," not in text
    }  # fmt: skip
    if alike and len(last) < min(alike):
        raise TextError(len(lines), "the file ends within this line")
