"""Readers of labels, coordinates and what is held: of rows of matrices, and of nodes.

The layouts: ANSYS Mechanical APDL Command Reference, HBMAT (mapping file: equation, node and
direction); CalculiX 2.20, matrixstorage.c (``node.direction`` in each line of the .dof file);
Abaqus Keywords Reference Guide, *NODE, *NSET and *BOUNDARY, which CalculiX shares.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from vibroimpact.models import file_bytes, input_decks, nastran_decks
from vibroimpact.models.labels import Nodes, direction
from vibroimpact.models.model import Label
from vibroimpact.models.text_files import numbers
from vibroimpact_schema import number_tables
from vibroimpact_schema.number_tables import TextError, shown

_BESIDE: Final[Mapping[str, str]] = {".sti": ".dof", ".mas": ".dof", ".matrix": ".mapping"}
"""Ending of a file of a matrix -> that of the labels which the program writes beside it."""
_DECKS: Final[Mapping[str, Callable[[bytes], Nodes]]] = {
    **dict.fromkeys((".bdf", ".dat", ".nas", ".fem"), nastran_decks.nodes),
    ".inp": input_decks.nodes,
}


def beside(path: Path) -> Path | None:
    """Return the file of labels that a program wrote beside a matrix; None: there is none."""
    bare = path.with_suffix("") if path.suffix.lower() == ".gz" else path
    ending = _BESIDE.get(bare.suffix.lower())
    if ending is None:
        return None
    for each in (ending, ending.upper()):
        candidate = bare.with_suffix(each)
        if candidate.is_file():
            return candidate
    return None


def read_labels(path: Path) -> list[Label]:
    """Read labels of rows: ``.dof`` of CalculiX, ``.mapping`` of ANSYS, or lines of both numbers.

    Raises
    ------
    ValueError
        With the file, the line and the reason.
    """
    reader = {".dof": _dofs, ".mapping": _mapping}.get(file_bytes.suffix(path), _pairs)
    try:
        return reader(file_bytes.lines(file_bytes.read(path)))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def read_nodes(path: str | Path) -> Nodes:
    """Read nodes of a deck of Nastran, Abaqus or CalculiX, or of a text ``node, x, y, z``.

    Raises
    ------
    ValueError
        With the file, the line and the reason.
    """
    path = Path(path)
    try:
        data = file_bytes.read(path)
        deck = _DECKS.get(file_bytes.suffix(path))
        return _table(data) if deck is None else deck(data)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _table(data: bytes) -> Nodes:
    """Read rows of a node and one to three coordinates."""
    rows = numbers(number_tables.plain(data))
    if not 2 <= rows.shape[1] <= 4 or (rows[:, 0] != np.floor(rows[:, 0])).any():
        raise ValueError("rows are not a node and one to three coordinates")
    return Nodes({int(row[0]): row[1:].tolist() for row in rows})


def _mapping(lines: Sequence[bytes]) -> list[Label]:
    """Read the mapping of HBMAT: lines of equation, node and direction such as UX."""
    labels: dict[int, Label] = {}
    for number, line in enumerate(lines, 1):
        words = line.decode("latin-1").split()
        if not words or not words[0].isdecimal():
            continue  # a title
        if len(words) < 3 or not words[1].isdecimal() or len(words[0] + words[1]) > 30:
            raise TextError(number, f"{shown(line.strip())} is no equation, node, direction")
        labels[int(words[0])] = _label(words[1], words[2], number)
    if not labels or sorted(labels) != list(range(1, len(labels) + 1)):
        raise TextError(len(lines), f"{len(labels)} equations, not numbered from 1 on")
    return [labels[row] for row in sorted(labels)]


def _dofs(lines: Sequence[bytes]) -> list[Label]:
    """Read the degrees of freedom of CalculiX: lines ``node.direction``, such as ``17.3``."""
    labels = list[Label]()
    for number, line in enumerate(lines, 1):
        node, _, part = line.decode("latin-1").strip().partition(".")
        if not line.strip():
            continue
        if not node.isdecimal() or len(node) > 15 or part not in tuple("123456"):
            raise TextError(number, f"{shown(line.strip())} is no node.direction")
        labels.append(_label(node, part, number))
    return labels


def _pairs(lines: Sequence[bytes]) -> list[Label]:
    """Read lines of node and direction, apart by blanks, commas or semicolons; a title before."""
    labels = list[Label]()
    for number, line in enumerate(lines, 1):
        text = line.partition(b"#")[0].decode("latin-1")
        words = text.replace(",", " ").replace(";", " ").split()
        if not words or (not labels and not words[0].isdecimal()):
            continue
        if len(words) != 2 or not words[0].isdecimal() or len(words[0]) > 15:
            raise TextError(number, f"{shown(line.strip())} is no node and direction")
        labels.append(_label(words[0], words[1], number))
    if not labels:
        raise TextError(max(1, len(lines)), "there are no lines of node and direction")
    return labels


def _label(node: str, part: str, line: int) -> Label:
    try:
        return int(node), direction(part)
    except ValueError as error:
        raise TextError(line, str(error)) from None
