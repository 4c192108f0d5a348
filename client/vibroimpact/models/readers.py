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

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import scipy.sparse as sparse

from vibroimpact.arguments import real
from vibroimpact.models import array_files, matlab, nastran, text_files
from vibroimpact.models.labels import Content, chosen
from vibroimpact.models.model import ROUNDING, Label, Model
from vibroimpact_schema import number_tables

READERS: Final[Mapping[str, Callable[[Path], Content]]] = {
    ".npz": array_files.npz,
    ".mat": matlab.mat,
    ".mtx": text_files.market_or_list,
    ".csv": text_files.rows,
    ".txt": text_files.rows,
    ".op4": nastran.output4,
    ".bdf": nastran.dmig,
    ".dat": nastran.dmig,
    ".pch": nastran.dmig,
}
_NAMED: Final = 10
"""Names of what is not used that a warning lists."""


@dataclass(frozen=True, eq=False)
class _File:
    """What one file gives to a model."""

    path: Path
    matrices: dict[str, Any]
    labels: Sequence[Label] | None
    by_keyword: bool


def read_model(
    *paths: str | Path,
    coordinates: Mapping[int, Any] | str | Path | None = None,
    units: Mapping[str, str] | None = None,
    names: Mapping[str, str] | None = None,
    rounding: float = ROUNDING,
    **matrices: str | Path,
) -> Model:
    """Return the model in one file, or in a file for each matrix.

    Matrices have the names that programs give them: ``K``, ``stiffness``, ``KAAX`` and so
    on, ``K`` before ``k`` before others. Whatever a file has besides is not used, and a warning
    names it: structural damping such as ``K4AAX``, which is none of M, K and C, among it.

    Parameters
    ----------
    *paths : path
        Files that name their matrices: ``read_model("model.mat")``; or are named like them:
        ``read_model("M.mtx", "K.mtx")``.
    coordinates : mapping or path, optional
        Node -> coordinates, or a text file with rows ``node, x, y, z``.
    units : mapping, optional
        ``{"length": "m", "mass": "kg", "time": "s"}``.
    names : mapping, optional
        Names that matrices have in the files, where others or several could be meant:
        ``{"C": "B2GG"}``.
    rounding : float
        As of `Model`.
    **matrices : path
        ``M=``, ``K=`` and ``C=``: files of one matrix each.

    Raises
    ------
    ValueError
        If a file has no known format, with the line at fault; if M or K is missing, occurs in two
        files or has an imaginary part, or two matrices of one file can be meant.

    Warns
    -----
    UserWarning
        Naming what files have and the model does not use.
    """
    unknown = set(matrices) - {"M", "K", "C"}
    if unknown:
        raise ValueError(f"{', '.join(sorted(unknown))}: matrices are given as M=, K= and C=")
    files = [_read(Path(path), "", names) for path in paths]
    files += [_read(Path(path), name, names) for name, path in matrices.items()]
    together, labels = _together(_once_each(files))
    missing = {"M", "K"} - set(together)
    if missing:
        raise ValueError(f"{' and '.join(sorted(missing))} missing; there are {list(together)}")
    if isinstance(coordinates, str | Path):
        coordinates = _coordinates(Path(coordinates))
    M, K, C = together["M"], together["K"], together.get("C")
    return Model(M, K, C, labels, coordinates or {}, units, rounding)


def _read(path: Path, name: str, names: Mapping[str, str] | None) -> _File:
    """Return the matrices of a file as M, K and C; `name`: which one it is to give."""
    read = READERS.get(path.suffix.lower())
    if read is None:
        raise ValueError(f"{path}: known are files ending in {', '.join(READERS)}")
    try:
        content = read(path)
        available = list(content.matrices)
        selected = chosen(available, names)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    if name and (len(available) == 1 or name in selected):
        selected = {name: selected.get(name, available[0])}
    elif name:
        raise ValueError(f"{path} has {', '.join(available)}; expected one matrix")
    elif available == [""]:
        selected = dict.fromkeys(chosen([path.stem]), "")
        if not selected:
            raise ValueError(f"{path}: its name does not tell which matrix it is: use M=, K= or C=")
    _warn_of_unused(path, [each for each in available if each not in selected.values()])
    used = {own: _numbers(path, each, content.matrices[each]) for own, each in selected.items()}
    return _File(path, used, content.labels, bool(name))


def _numbers(path: Path, name: str, matrix: Any) -> Any:
    """Return a matrix of real numbers."""
    lost = getattr(matrix, "reason", "")
    if lost:
        raise ValueError(f"{path}: {lost}")
    shape = getattr(matrix, "shape", ())
    if len(shape) != 2 or getattr(matrix, "dtype", np.dtype(object)).kind not in "biufc":
        raise ValueError(f"{path}: {name} is no matrix of numbers")
    return real(f"{path}: {name or 'the matrix'}", matrix)


def _warn_of_unused(path: Path, names: Sequence[str]) -> None:
    if names:
        more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
        message = f"{path}: not used: {', '.join(names[:_NAMED])}{more}"
        warnings.warn(message, UserWarning, stacklevel=4)


def _once_each(files: Sequence[_File]) -> list[_File]:
    """Return the files with each matrix in one of them: that of a keyword counts."""
    kept = list[_File]()
    for file in files:
        for earlier in kept:
            twice = sorted(earlier.matrices.keys() & file.matrices.keys())
            if not twice:
                continue
            if earlier.by_keyword or not file.by_keyword:
                raise ValueError(f"{', '.join(twice)} in both {earlier.path} and {file.path}")
            _warn_of_unused(earlier.path, twice)
            for name in twice:
                del earlier.matrices[name]
        kept.append(file)
    return kept


def _coordinates(path: Path) -> dict[int, list[float]]:
    """Return the coordinates of nodes in a text file."""
    try:
        rows = text_files.numbers(number_tables.plain(path.read_bytes()))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    if not 2 <= rows.shape[1] <= 4 or (rows[:, 0] != np.floor(rows[:, 0])).any():
        raise ValueError(f"{path}: rows are not a node and one to three coordinates")
    return {int(row[0]): row[1:].tolist() for row in rows}


def _together(files: Sequence[_File]) -> tuple[dict[str, Any], list[Label]]:
    """Return the matrices of all files and their labels.

    Files of nonzero entries leave out what has no mass, or no damping: there, the labels of the
    stiffness count, and its size.
    """
    stiff = [(file.matrices["K"], file.labels) for file in files if "K" in file.matrices]
    labelled = [own for _, own in stiff if own] + [file.labels for file in files if file.labels]
    labels = list(labelled[0]) if labelled else []
    place = {label: row for row, label in enumerate(labels)}
    together: dict[str, Any] = {}
    for file in files:
        own, places = file.labels, None
        if own and list(own) != labels:
            if "K" in file.matrices or not set(own) <= place.keys():
                raise ValueError(f"{file.path} has other nodes or directions than the stiffness")
            places = [place[label] for label in own]
        for name, matrix in file.matrices.items():
            if own is None and stiff and matrix.shape[0] < stiff[0][0].shape[0]:
                together[name] = _placed(matrix, range(matrix.shape[0]), stiff[0][0].shape[0])
            else:
                together[name] = matrix if places is None else _placed(matrix, places, len(labels))
    return together, labels


def _placed(matrix: Any, places: Sequence[int], n: int) -> Any:
    """Return a larger matrix with the rows and columns of a smaller one at some places."""
    entries, index = sparse.coo_array(matrix), np.asarray(places)
    return sparse.coo_array((entries.data, (index[entries.row], index[entries.col])), shape=(n, n))
