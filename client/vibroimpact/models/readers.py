"""Readers of matrices: files of finite-element programs, of Matlab, numpy and scipy, and texts.

==============================  ==================================================================
``.mtx``                        Matrix Market, or Abaqus ``*MATRIX GENERATE`` in any of its formats
``.sti``, ``.mas``              CalculiX, with the labels of the ``.dof`` file beside
``.matrix``, ``.hb``, ``.rb``,  Harwell-Boeing and Rutherford-Boeing; ``.matrix`` of ANSYS HBMAT
``.rsa``, ``.rua``              with the labels of the ``.mapping`` file beside
``.op4``                        Nastran OUTPUT4, formatted or binary
``.bdf``, ``.dat``, ``.nas``,   Nastran DMIG: nodes and directions are kept
``.pch``
``.mat``                        Matlab up to 7.3, with M, K and C, also as fields of a structure
``.npz``, ``.npy``              of `scipy.sparse.save_npz`, `numpy.savez` or `numpy.save`
``.csv``, ``.txt``              all rows as text, or entries ``row, column, value``
==============================  ==================================================================

All but the last but one may be compressed: ``K.mtx.gz``.
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
from vibroimpact.models import (
    array_files,
    file_bytes,
    harwell_boeing,
    label_files,
    matlab,
    nastran,
    output4,
    text_files,
)
from vibroimpact.models.labels import Content, Nodes, chosen, meaning, of_file
from vibroimpact.models.model import ROUNDING, Label, Model
from vibroimpact.models.motion_files import DIRECTIONS

READERS: Final[Mapping[str, Callable[[bytes], Content]]] = {
    ".npz": array_files.npz,
    ".npy": array_files.npy,
    ".mat": matlab.mat,
    ".mtx": text_files.market_or_list,
    **dict.fromkeys((".sti", ".mas"), text_files.triangle),
    **dict.fromkeys((".matrix", ".hb", ".rb", ".rsa", ".rua"), harwell_boeing.matrix),
    **dict.fromkeys((".csv", ".txt"), text_files.rows),
    ".op4": output4.output4,
    **dict.fromkeys((".bdf", ".dat", ".nas", ".pch"), nastran.dmig),
}
_BY_ENDING: Final[Mapping[str, str]] = {".sti": "K", ".mas": "M"}
"""Ending -> which matrix such a file has."""
_NAMED: Final = 10
"""Names of what is not used that a warning lists."""
_ROWS: Final = 1 << 20
_ROWS_EACH: Final = 100
"""Rows of a matrix of any file, and more for each of its entries: so many more are damage. Memory
goes by the rows, which one wrong digit of an index may multiply."""


@dataclass(frozen=True, eq=False)
class _File:
    """What one file gives to a model."""

    path: Path
    matrices: dict[str, Any]
    labels: Sequence[Label] | None
    by_keyword: bool
    named: Mapping[str, str]
    """M, K, C or K4 -> its name in the file."""
    available: Sequence[str]


def read_model(
    *paths: str | Path,
    coordinates: Mapping[int, Any] | str | Path | None = None,
    nodes: str | Path | None = None,
    labels: Sequence[Label] | str | Path | None = None,
    supports: bool = False,
    units: Mapping[str, str] | None = None,
    names: Mapping[str, str] | None = None,
    rounding: float = ROUNDING,
    symmetrize: bool = False,
    structural_at: float | None = None,
    **matrices: str | Path,
) -> Model:
    """Return the model in one file, or in a file for each matrix.

    Matrices have the names that programs give them: ``K``, ``stiffness``, ``KAAX`` and so
    on, ``K`` before ``k`` before others. Whatever a file has besides is not used, and a warning
    names it.

    Parameters
    ----------
    *paths : path
        Files that name their matrices: ``read_model("model.mat")``; or are named like them:
        ``read_model("M.mtx", "K.mtx")``, ``read_model("job_STIF1.mtx", "job_MASS1.mtx")``.
    coordinates : mapping or path, optional
        Node -> coordinates, or a text file with rows ``node, x, y, z``.
    nodes : path, optional
        Instead: the deck of the model, of Nastran (GRID, SPC, SPC1, CORD2R, -C, -S) or of Abaqus
        and CalculiX (*NODE, *BOUNDARY). With a deck of Nastran, matrices without labels get them
        where their size tells which: all degrees of freedom of all nodes, or those not held, or
        of these the displacements alone.
    labels : sequence of (int, str) or path, optional
        Of the rows of matrices without any: or a file, ``.dof`` of CalculiX, ``.mapping`` of
        ANSYS, or a text with rows ``node, direction``.
    supports : bool
        Whether what the deck of `nodes` holds is held fixed.
    units : mapping, optional
        ``{"length": "m", "mass": "kg", "time": "s"}``.
    names : mapping, optional
        Names that matrices have in the files, where others or several could be meant:
        ``{"C": "B2GG"}``.
    rounding, symmetrize
        As of `Model`.
    structural_at : float, optional
        Angular frequency at which structural damping, such as ``K4AAX``, becomes viscous:
        ``C = B + K4/structural_at`` loses as much there. Default: it is not used.
    **matrices : path or str
        ``M=``, ``K=`` and ``C=``: files of one matrix each, or names of matrices in `paths`.

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
    by_name = {
        name: str(given) for name, given in matrices.items() if paths and not Path(given).is_file()
    }
    wanted = {**(names or {}), **by_name}
    files = [_read(Path(path), "", wanted) for path in paths]
    for name, given in by_name.items():
        if not any(file.named.get(name) == given for file in files):
            have = ", ".join(each for file in files for each in file.available if each)
            raise ValueError(f"{name}={given!r} is no file and no matrix of the others: {have}")
    files += [_read(Path(path), name, names) for name, path in matrices.items()
              if name not in by_name]  # fmt: skip
    together, own = _together(_once_each(files))
    missing = {"M", "K"} - set(together)
    if missing:
        have = f"; there is {' and '.join(sorted(together))}" if together else ""
        raise _of_files(files, f"{' and '.join(sorted(missing))} missing{have}")
    C = _damping(together, structural_at, files)
    known = _nodes(coordinates, nodes)
    rows = _labels(labels, own, known, together["K"].shape[0])
    try:
        model = Model(
            together["M"], together["K"], C, rows, known.coordinates, units, rounding, symmetrize,
            known.elements,
        )  # fmt: skip
    except ValueError as error:
        raise _of_files(files, error) from None
    if not supports:
        return model
    free = [row for row, each in enumerate(model.labels) if each not in known.held]
    return model.part(free)


def _of_files(files: Sequence[_File], reason: object) -> ValueError:
    """Return an error of what files have together."""
    paths = ", ".join(dict.fromkeys(str(file.path) for file in files))
    return ValueError(f"{paths}: {reason}" if paths else str(reason))


def _nodes(coordinates: Mapping[int, Any] | str | Path | None, nodes: str | Path | None) -> Nodes:
    """Return the nodes, of whichever is given."""
    if coordinates is not None and nodes is not None:
        raise ValueError("coordinates and nodes both give the places of nodes: give one of them")
    given = coordinates if nodes is None else nodes
    if isinstance(given, str | Path):
        return label_files.read_nodes(Path(given))
    return Nodes(given or {})


def _damping(
    together: Mapping[str, Any], structural_at: float | None, files: Sequence[_File]
) -> Any:
    """Return the matrix of viscous damping, with structural damping at a frequency."""
    C, structural = together.get("C"), together.get("K4")
    if structural_at is None:
        if structural is not None:
            path, name = next((f.path, f.named["K4"]) for f in files if "K4" in f.matrices)
            warnings.warn(
                f"{path}: not used: {name}, structural damping: as viscous damping at one angular "
                "frequency it is read by structural_at=",
                UserWarning,
                stacklevel=3,
            )
        return C
    if structural is None:
        raise ValueError("structural_at: no file has structural damping, such as K4AAX")
    if not 0.0 < structural_at < float("inf"):
        raise ValueError(f"structural_at is no positive angular frequency: {structural_at}")
    viscous = structural / structural_at
    return viscous if C is None else sparse.csr_array(C) + viscous


def _labels(
    given: Sequence[Label] | str | Path | None, own: Sequence[Label], nodes: Nodes, n: int
) -> Sequence[Label]:
    """Return the labels of the rows: those given, of the files, or of the nodes by their number."""
    if isinstance(given, str | Path):
        given = label_files.read_labels(Path(given))
    if given is not None:
        if len(given) != n:
            raise ValueError(f"{len(given)} labels for {n} degrees of freedom")
        return given
    if own or not nodes.labels:
        return own
    moved = [each for each in nodes.labels if each[1] in DIRECTIONS[:3]]
    for all_of in (nodes.labels, moved):
        free = [each for each in all_of if each not in nodes.held]
        for rows in (all_of, free):
            if len(rows) == n:
                return rows
    raise ValueError(
        f"the deck has {len(nodes.labels)} degrees of freedom, {len(nodes.held)} of them held; the "
        f"matrices have {n}: say by labels= which these are"
    )


def _read(path: Path, name: str, names: Mapping[str, str] | None) -> _File:
    """Return the matrices of a file as M, K and C; `name`: which one it is to give."""
    read = READERS.get(file_bytes.suffix(path))
    if read is None:
        raise ValueError(f"{path}: known are files ending in {', '.join(READERS)}")
    try:
        content = read(file_bytes.read(path))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    available = list(content.matrices)
    if available == [""]:
        own = _BY_ENDING.get(file_bytes.suffix(path)) or of_file(file_bytes.stem(path))
        content = Content({own: content.matrices[""]}, content.labels)
        available = [own]
    try:
        selected = chosen(_usable(content, names), names)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    if name and (len(available) == 1 or name in selected):
        selected = {name: selected.get(name, available[0])}
    elif name:
        raise ValueError(f"{path} has {', '.join(available)}; expected one matrix")
    elif len(available) == 1 and not selected and not meaning(available[0]):
        raise ValueError(f"{path}: its name does not tell which matrix it is: use M=, K= or C=")
    used = {own: _numbers(path, each, content.matrices[each]) for own, each in selected.items()}
    _warn_of_unused(path, [each for each in available if each not in selected.values()])
    labels = content.labels
    beside = None if labels else label_files.beside(path)
    if beside is not None:
        labels = label_files.read_labels(beside)
        _fit(used, len(labels), beside)
    return _File(path, used, labels, bool(name), selected, available)


def _fit(matrices: dict[str, Any], n: int, labels: Path) -> None:
    """Give matrices the size of their labels: the last rows of entries may be missing."""
    for name, matrix in matrices.items():
        if matrix.shape[0] > n:
            raise ValueError(f"{labels} has {n} rows; the matrix has {matrix.shape[0]}")
        matrices[name] = _placed(matrix, range(matrix.shape[0]), n)


def _usable(content: Content, names: Mapping[str, str] | None) -> list[str]:
    """Return the names of matrices that can be meant.

    Complex and rectangular matrices and those without entries are not, where another one or none
    at all will do: programs write them beside what is asked for.
    """
    given = set((names or {}).values())
    usual = {name for name, matrix in content.matrices.items() if _is_square(matrix)}
    meant = {meaning(name) for name in usual} | {"C", "K4"}
    return [
        name
        for name, matrix in content.matrices.items()
        if name in usual or name in given or meaning(name) not in meant
        or (hasattr(matrix, "reason") and not usual & set(content.matrices))
        or (meaning(name) in ("C", "K4") and hasattr(matrix, "reason"))
    ]  # fmt: skip


def _is_square(matrix: Any) -> bool:
    """Return whether a matrix is square, or a diagonal, and has entries."""
    shape = getattr(matrix, "shape", ())
    if not shape or getattr(matrix, "dtype", np.dtype(object)).kind not in "biufc":
        return False
    if len(shape) == 2 and shape[0] != shape[1] and min(shape) > 1:
        return False
    return bool(matrix.nnz) if hasattr(matrix, "nnz") else bool(np.any(matrix))


def _numbers(path: Path, name: str, matrix: Any) -> Any:
    """Return a matrix of real numbers; a row or a column of them is a diagonal."""
    lost = getattr(matrix, "reason", "")
    if lost:
        raise ValueError(f"{path}: {lost}")
    shape = getattr(matrix, "shape", ())
    if not 1 <= len(shape) <= 2 or getattr(matrix, "dtype", np.dtype(object)).kind not in "biufc":
        raise ValueError(f"{path}: {name} is no matrix of numbers")
    filled = matrix.nnz if hasattr(matrix, "nnz") else matrix.size
    if max(shape) > _ROWS + _ROWS_EACH * filled:
        size = " x ".join(map(str, shape))
        reason = f"{size}, but only {filled} of its entries are given"
        raise ValueError(f"{path}: {name} is {reason}: a size or an index is wrong")
    if len(shape) == 1 or (min(shape) == 1 and max(shape) > 1):
        dense = matrix.toarray() if hasattr(matrix, "toarray") else matrix
        matrix = sparse.coo_array(sparse.diags_array(np.ravel(dense)))
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
