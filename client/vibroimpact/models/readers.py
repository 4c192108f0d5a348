"""Readers of matrices: scipy, Matlab, Matrix Market, Abaqus, Nastran and text.

=========================  =====================================================================
``.npz``                   of `scipy.sparse.save_npz`, or of `numpy.savez` with M, K and C
``.mat``                   Matlab, with M, K and C
``.mtx``                   Matrix Market, or Abaqus ``*MATRIX GENERATE`` (either format)
``.csv``, ``.txt``         all rows as text
``.op4``                   Nastran OUTPUT4, formatted
``.bdf``, ``.dat``, ``.pch``  Nastran DMIG: nodes and directions are kept
=========================  =====================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import scipy.io
import scipy.sparse as sparse

from vibroimpact.models.model import DIRECTIONS, Label, Model

Matrices = dict[str, Any]
Parts = tuple[Matrices, list[Label] | None]
"""Matrices and their labels; none: numbers of rows alone, the last of which may be missing."""
_NAMES: Final[Mapping[str, str]] = {
    **dict.fromkeys(("M", "MASS", "MAA", "MAAX", "MGG", "MXX"), "M"),
    **dict.fromkeys(("K", "STIFFNESS", "KAA", "KAAX", "KGG", "KXX", "STIF"), "K"),
    **dict.fromkeys(("C", "D", "DAMPING", "BAA", "BGG", "BXX", "VISCOUSDAMPING"), "C"),
}
"""Names of matrices in files, in capitals."""


def read_model(
    *paths: str | Path,
    coordinates: Mapping[int, Any] | str | Path | None = None,
    units: Mapping[str, str] | None = None,
    **matrices: str | Path,
) -> Model:
    """Return the model in one file, or in a file for each matrix.

    Parameters
    ----------
    *paths : path
        Files that name their matrices: ``read_model("model.mat")``.
    coordinates : mapping or path, optional
        Node -> coordinates, or a text file with rows ``node, x, y, z``.
    units : mapping, optional
        ``{"length": "m", "mass": "kg", "time": "s"}``.
    **matrices : path
        ``M=``, ``K=`` and ``C=``: files of one matrix each.

    Raises
    ------
    ValueError
        If a file has no known format, or M or K is missing.
    """
    read = list[tuple[Path, Matrices, list[Label] | None]]()
    for name, path in [*(("", path) for path in paths), *matrices.items()]:
        content, own = _read(Path(path))
        if name:
            if len(content) != 1:
                raise ValueError(f"{path} has {', '.join(content)}; expected one matrix")
            content = {name: next(iter(content.values()))}
        read.append((Path(path), content, own))
    together, labels = _together(read)
    missing = {"M", "K"} - set(together)
    if missing:
        raise ValueError(f"{' and '.join(sorted(missing))} missing; there are {list(together)}")
    if isinstance(coordinates, str | Path):
        rows = np.loadtxt(coordinates, delimiter=_delimiter(Path(coordinates)), ndmin=2)
        coordinates = {int(row[0]): row[1:].tolist() for row in rows}
    return Model(together["M"], together["K"], together.get("C"), labels, coordinates or {}, units)


def _together(
    read: list[tuple[Path, Matrices, list[Label] | None]],
) -> tuple[Matrices, list[Label]]:
    """Return the matrices of all files and their labels.

    Files of nonzero entries leave out what has no mass, or no damping: there, the labels of the
    stiffness count, and its size.
    """
    stiff = [(content["K"], own) for _, content, own in read if "K" in content]
    labelled = [own for _, own in stiff if own] + [own for _, _, own in read if own]
    labels = labelled[0] if labelled else []
    place = {label: row for row, label in enumerate(labels)}
    together: Matrices = {}
    for path, content, own in read:
        places = None
        if own and own != labels:
            if "K" in content or not set(own) <= place.keys():
                raise ValueError(f"{path} has other nodes or directions than the files before")
            places = [place[label] for label in own]
        for name, matrix in content.items():
            if own is None and stiff and matrix.shape[0] < stiff[0][0].shape[0]:
                together[name] = _placed(matrix, range(matrix.shape[0]), stiff[0][0].shape[0])
            else:
                together[name] = matrix if places is None else _placed(matrix, places, len(labels))
    return together, labels


def _placed(matrix: Any, places: Sequence[int], n: int) -> Any:
    """Return a larger matrix with the rows and columns of a smaller one at some places."""
    entries, index = sparse.coo_array(matrix), np.asarray(places)
    return sparse.coo_array((entries.data, (index[entries.row], index[entries.col])), shape=(n, n))


def _read(path: Path) -> Parts:
    readers: dict[str, Callable[[Path], Parts]] = {
        ".npz": _npz,
        ".mat": _mat,
        ".mtx": _mtx,
        ".csv": _text,
        ".txt": _text,
        ".op4": _op4,
        ".bdf": _dmig,
        ".dat": _dmig,
        ".pch": _dmig,
    }
    if path.suffix.lower() not in readers:
        raise ValueError(f"{path}: known are files ending in {', '.join(readers)}")
    return readers[path.suffix.lower()](path)


def _named(given: Mapping[str, Any]) -> Matrices:
    return {_NAMES[name.upper()]: value for name, value in given.items() if name.upper() in _NAMES}


def _npz(path: Path) -> Parts:
    with np.load(path) as file:
        if "format" not in file:
            return _named(dict(file)), []
    return {path.stem: sparse.load_npz(path)}, []


def _mat(path: Path) -> Parts:
    return _named(scipy.io.loadmat(path, spmatrix=False)), []


def _mtx(path: Path) -> Parts:
    with path.open(encoding="utf-8") as file:
        first = file.readline()
    if first.startswith("%%MatrixMarket"):
        return {path.stem: scipy.io.mmread(path, spmatrix=False)}, []
    return _abaqus(path)


def _abaqus(path: Path) -> Parts:
    """Read rows ``node, dof, node, dof, value``, or ``row, column, value``."""
    lines = path.read_text(encoding="utf-8").splitlines()
    kept = [line.replace(",", " ") for line in lines if line.strip() and line[0] not in "*%"]
    rows = np.loadtxt(kept, ndmin=2)
    if rows.shape[1] == 3:
        places, values = rows[:, :2].astype(np.int64) - 1, rows[:, 2]
        n = int(places.max()) + 1
        return {path.stem: sparse.coo_array((values, tuple(places.T)), shape=(n, n))}, None
    if rows.shape[1] != 5:
        raise ValueError(f"{path}: rows of {rows.shape[1]} numbers, not of 3 or 5")
    ends = rows[:, :4].astype(np.int64).reshape(-1, 2)
    known, index = np.unique(ends, axis=0, return_inverse=True)
    pairs = index.reshape(-1, 2)
    matrix = sparse.coo_array((rows[:, 4], (pairs[:, 0], pairs[:, 1])), shape=(len(known),) * 2)
    return {path.stem: matrix}, [_label(int(node), int(dof)) for node, dof in known]


def _label(node: int, component: int) -> Label:
    """Return the label of component 1 to 6, or of a scalar point, which has 0."""
    direct = DIRECTIONS[component - 1] if 1 <= component <= 6 else f"{component}"
    return node, "x" if component == 0 else direct


def _delimiter(path: Path) -> str | None:
    return "," if "," in path.read_text(encoding="utf-8") else None


def _text(path: Path) -> Parts:
    return {path.stem: np.loadtxt(path, delimiter=_delimiter(path), ndmin=2)}, []


def _op4(path: Path) -> Parts:
    """Read formatted OUTPUT4: heads of matrices, of columns and of strings, and their numbers."""
    if b"\0" in path.read_bytes()[:64]:
        raise ValueError(f"{path} is binary: let Nastran write it FORMATTED")
    content: dict[str, Output4] = {}
    matrix, row, column, width = Output4(0), 0, 0, 0
    for line in path.read_text(encoding="ascii").splitlines():
        if "." in line and not line[32:40].strip().isidentifier():
            if column < matrix.columns:
                numbers = [line[k : k + width] for k in range(0, len(line.rstrip()), width)]
                matrix.add(row, column, [_nastran(number) for number in numbers])
                row += len(numbers)
            continue
        words = [line[k : k + 8].strip() for k in range(0, len(line.rstrip()), 8)]
        if len(words) > 4:  # a matrix
            if int(words[3]) > 2:
                raise ValueError(f"{path}: {words[4]} is complex")
            matrix = content[words[4]] = Output4(int(words[0]))
            width = int(line.partition("E")[2].partition(".")[0])
        elif len(words) == 3:  # a column
            column, row = int(words[0]) - 1, int(words[1]) - 1
        else:  # a string of nonzeros: its length and row, in two words or in one
            row = (int(words[1]) if len(words) == 2 else int(line) % 65536) - 1
    return _named({name: matrix.whole() for name, matrix in content.items()}), []


class Output4:
    """A matrix of an OUTPUT4 file while it is read."""

    def __init__(self, columns: int) -> None:
        self.columns = columns
        self._parts: list[tuple[int, int, float]] = []

    def add(self, row: int, column: int, numbers: Sequence[float]) -> None:
        """Add the numbers of a column from a row on."""
        self._parts += [(row + k, column, number) for k, number in enumerate(numbers) if number]

    def whole(self) -> Any:
        """Return the matrix."""
        rows, columns, values = zip(*self._parts, strict=True)
        return sparse.coo_array((values, (rows, columns)), shape=(self.columns, self.columns))


def _dmig(path: Path) -> Parts:
    """Read cards DMIG: a head, and for every column its entries, real, in small or large fields."""
    columns: dict[str, list[tuple[tuple[int, int], tuple[int, int], float]]] = {}
    name, column = "", (0, 0)
    for line in path.read_text(encoding="utf-8").splitlines():
        fields = _fields(line)
        if fields[0] == "DMIG" and fields[2] == "0":
            continue  # the head
        if fields[0] == "DMIG":
            name, column = fields[1].upper(), (int(fields[2]), int(fields[3] or 0))
            fields = ["", *fields[5:]]
        elif fields[0] or not name:
            name = ""  # another card
            continue
        for k in range(1, len(fields) - 2, 4):
            if fields[k]:
                row = int(fields[k]), int(fields[k + 1] or 0)
                columns.setdefault(name, []).append((row, column, _nastran(fields[k + 2])))
    known = {part: entries for part, entries in columns.items() if part in _NAMES}
    ends = sorted({end for entries in known.values() for *pair, _ in entries for end in pair})
    index, shape = {end: place for place, end in enumerate(ends)}, (len(ends), len(ends))
    matrices = {
        part: sparse.coo_array(
            ([v for *_, v in entries],
             ([index[i] for i, _, _ in entries], [index[j] for _, j, _ in entries])), shape=shape,
        )
        for part, entries in known.items()
    }  # fmt: skip
    return _named(matrices), [_label(*end) for end in ends]


def _fields(line: str) -> list[str]:
    """Return the name of a card, or what continues one as empty, and its fields without blanks."""
    line = line.partition("$")[0].rstrip()
    if "," in line:
        first, *rest = (part.strip() for part in line.split(","))
    else:
        width = 16 if "*" in line[:8] else 8
        first = line[:8].strip()
        rest = [line[k : k + width].strip() for k in range(8, max(len(line), 9), width)]
    first = first.rstrip("*").strip()
    return ["" if first.startswith(("+", "*")) or not first else first.upper(), *rest, "", ""]


def _nastran(text: str) -> float:
    """Return a number such as ``1.5-3``, ``1.5D-3`` or ``1.5E-3``."""
    plain = text.upper().replace("D", "E")
    if "E" not in plain:
        plain = plain[:1] + plain[1:].replace("-", "E-").replace("+", "E+")
    return float(plain)
