"""Files of labels, coordinates and what is held: of rows of matrices, and of nodes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

import numpy as np

from vibroimpact.models import input_decks, nastran_decks
from vibroimpact.models.nodes import Nodes
from vibroimpact_schema import number_tables
from vibroimpact_schema.files import file_bytes, label_texts
from vibroimpact_schema.files.labels import Label
from vibroimpact_schema.files.text_files import numbers

_DECKS: Final[Mapping[str, Callable[[bytes], Nodes]]] = {
    **dict.fromkeys((".bdf", ".dat", ".nas", ".fem"), nastran_decks.nodes),
    ".inp": input_decks.nodes,
}


def beside(path: Path) -> Path | None:
    """Return the file of labels that a program wrote beside a matrix; None: there is none."""
    bare = path.with_suffix("") if path.suffix.lower() == ".gz" else path
    ending = label_texts.BESIDE.get(bare.suffix.lower())
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
    try:
        data = file_bytes.unpacked(path.name, path.read_bytes())
        return label_texts.read(path.name, data)
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
        data = file_bytes.unpacked(path.name, path.read_bytes())
        deck = _DECKS.get(file_bytes.suffix(path.name))
        return _table(data) if deck is None else deck(data)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _table(data: bytes) -> Nodes:
    """Read rows of a node and one to three coordinates."""
    rows = numbers(number_tables.plain(data))
    if not 2 <= rows.shape[1] <= 4 or (rows[:, 0] != np.floor(rows[:, 0])).any():
        raise ValueError("rows are not a node and one to three coordinates")
    return Nodes({int(row[0]): row[1:].tolist() for row in rows})
