"""The structure in several files: which matrix each has, and their rows beside one another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import scipy.sparse as sparse

from vibroimpact_schema.files import file_bytes
from vibroimpact_schema.files.bounds import LOCAL, Bounds
from vibroimpact_schema.files.labels import Content, Label, chosen, meaning, of_file
from vibroimpact_schema.imaginary import real

_BY_ENDING: Final[Mapping[str, str]] = {".sti": "K", ".mas": "M"}
"""Ending -> which matrix such a file has."""
_ROWS: Final = 1 << 20
_ROWS_EACH: Final = 100
"""Rows of a matrix of any file, and more for each of its entries: so many more are damage. Memory
goes by the rows, which one wrong digit of an index may multiply."""


@dataclass(frozen=True, eq=False)
class File:
    """What one file gives to a structure.

    Parameters
    ----------
    name : str
        Of the file, or its path.
    matrices : dict
        M, K, C or K4 -> the matrix.
    labels : sequence of (int, str), optional
        As of `Content`.
    by_keyword : bool
        Whether the caller said which matrix it has.
    named : mapping
        M, K, C or K4 -> its name in the file.
    available : sequence of str
        All names in the file.
    unused : list of str
        Those of what is not used.
    """

    name: str
    matrices: dict[str, Any]
    labels: Sequence[Label] | None
    by_keyword: bool
    named: Mapping[str, str]
    available: Sequence[str]
    unused: list[str] = field(default_factory=list)


def select(
    name: str,
    content: Content,
    keyword: str = "",
    names: Mapping[str, str] | None = None,
    bounds: Bounds = LOCAL,
) -> File:
    """Return the matrices of a file as M, K, C and K4.

    Parameters
    ----------
    name : str
        Of the file, which tells what its matrix is where it has one without a name.
    content : Content
    keyword : str
        Which matrix the caller says it has; "": none is said.
    names : mapping, optional
        M, K or C -> the name that it has in the file.
    bounds : Bounds

    Raises
    ------
    TooLargeError
        If a matrix has more rows than the bounds allow.
    ValueError
        If it is not clear which matrix is which, or one is none of real numbers.
    """
    available = list(content.matrices)
    if available == [""]:
        own = said_by(name)
        content = Content({own: content.matrices[""]}, content.labels)
        available = [own]
    selected = chosen(_usable(content, names), names)
    if keyword and (len(available) == 1 or keyword in selected):
        selected = {keyword: selected.get(keyword, available[0])}
    elif keyword:
        raise ValueError(f"it has {', '.join(available[:10])}; expected one matrix")
    elif len(available) == 1 and not selected and not meaning(available[0]):
        raise ValueError("its name does not tell which matrix it is: use M=, K= or C=")
    used = {own: _numbers(each, content.matrices[each], bounds) for own, each in selected.items()}
    unused = [each for each in available if each not in selected.values()]
    return File(name, used, content.labels, bool(keyword), selected, available, unused)


def said_by(name: str) -> str:
    """Return what the name of a file says of its only matrix; its stem, where it says nothing."""
    return _BY_ENDING.get(file_bytes.suffix(name)) or of_file(file_bytes.stem(name))


def fit(matrices: dict[str, Any], n: int) -> None:
    """Give matrices the size of their labels: the last rows of entries may be missing.

    Raises
    ------
    ValueError
        If there are fewer labels than rows.
    """
    for name, matrix in matrices.items():
        if matrix.shape[0] > n:
            raise ValueError(f"has {n} rows; the matrix has {matrix.shape[0]}")
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


def _numbers(name: str, matrix: Any, bounds: Bounds) -> Any:
    """Return a matrix of real numbers; a row or a column of them is a diagonal."""
    lost = getattr(matrix, "reason", "")
    if lost:
        raise ValueError(lost)
    shape = getattr(matrix, "shape", ())
    if not 1 <= len(shape) <= 2 or getattr(matrix, "dtype", np.dtype(object)).kind not in "biufc":
        raise ValueError(f"{name} is no matrix of numbers")
    if min(shape) < 1:
        raise ValueError(f"{name} is empty")
    filled = matrix.nnz if hasattr(matrix, "nnz") else matrix.size
    if max(shape) > _ROWS + _ROWS_EACH * filled:
        size = " x ".join(map(str, shape))
        reason = f"{size}, but only {filled} of its entries are given"
        raise ValueError(f"{name} is {reason}: a size or an index is wrong")
    bounds.check_rows(max(shape))
    if len(shape) == 1 or (min(shape) == 1 and max(shape) > 1):
        dense = matrix.toarray() if hasattr(matrix, "toarray") else matrix
        matrix = sparse.coo_array(sparse.diags_array(np.ravel(dense)))
    return real(name or "the matrix", matrix)


def once_each(files: Sequence[File]) -> list[File]:
    """Return the files with each matrix in one of them: that of a keyword counts.

    Raises
    ------
    ValueError
        If two files have the same matrix and no keyword tells which one counts.
    """
    kept = list[File]()
    for file in files:
        for earlier in kept:
            twice = sorted(earlier.matrices.keys() & file.matrices.keys())
            if not twice:
                continue
            if earlier.by_keyword or not file.by_keyword:
                raise ValueError(f"{', '.join(twice)} in both {earlier.name} and {file.name}")
            earlier.unused.extend(earlier.named[name] for name in twice)
            for name in twice:
                del earlier.matrices[name]
        kept.append(file)
    return kept


def together(files: Sequence[File]) -> tuple[dict[str, Any], list[Label]]:
    """Return the matrices of all files and their labels.

    Files of nonzero entries leave out what has no mass, or no damping: there, the labels of the
    stiffness count, and its size.

    Raises
    ------
    ValueError
        If another matrix has rows that the stiffness has not.
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
                raise ValueError(f"{file.name} has other nodes or directions than the stiffness")
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
