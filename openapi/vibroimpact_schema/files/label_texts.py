"""Readers of labels: the nodes and directions of the rows of matrices.

The layouts: ANSYS Mechanical APDL Command Reference, HBMAT (mapping file: equation, node and
direction); CalculiX 2.20, matrixstorage.c (``node.direction`` in each line of the .dof file).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from vibroimpact_schema.files import file_bytes
from vibroimpact_schema.files.bounds import LOCAL, Bounds
from vibroimpact_schema.files.labels import Label, direction
from vibroimpact_schema.number_tables import TextError, shown

BESIDE: Final[Mapping[str, str]] = {".sti": ".dof", ".mas": ".dof", ".matrix": ".mapping"}
"""Ending of a file of a matrix -> that of the labels which the program writes beside it."""


def read(name: str, data: bytes, bounds: Bounds = LOCAL) -> list[Label]:
    """Read labels of rows: ``.dof`` of CalculiX, ``.mapping`` of ANSYS, or lines of both numbers.

    Raises
    ------
    TextError
        With the line and the reason.
    TooLargeError
        If there are more lines than the bounds allow.
    """
    reader = _READERS.get(file_bytes.suffix(name), _pairs)
    return reader(file_bytes.lines(data, bounds))


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


_READERS: Final[Mapping[str, Callable[[Sequence[bytes]], list[Label]]]] = {
    ".dof": _dofs,
    ".mapping": _mapping,
}
