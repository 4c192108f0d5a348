"""Readers of matrices: files of finite-element programs, of Matlab, numpy and scipy, and texts.

The service reads the same files by the same code, see `vibroimpact_schema.files.readers`, but for
those of Matlab:

========  =======================================================================================
``.mat``  Matlab up to 7.3, with M, K and C, also as fields of a structure
========  =======================================================================================
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import scipy.sparse as sparse

from vibroimpact.models import label_files, matlab
from vibroimpact.models.model import Model
from vibroimpact.models.nodes import Nodes
from vibroimpact_schema.files.labels import DIRECTIONS, Label
from vibroimpact_schema.files.readers import READERS as SHARED
from vibroimpact_schema.files.readers import Reader, read, reader_of
from vibroimpact_schema.files.structures import File, fit, once_each, select, together
from vibroimpact_schema.files.symmetry import ROUNDING

READERS: Final[Mapping[str, Reader]] = {
    **SHARED,
    ".mat": lambda data, _: matlab.mat(data),
}
_NAMED: Final = 10
"""Names of what is not used that a warning lists."""


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
    kept = once_each(files)
    for file in kept:
        _warn_of_unused(file)
    assembled, own = together(kept)
    missing = {"M", "K"} - set(assembled)
    if missing:
        have = f"; there is {' and '.join(sorted(assembled))}" if assembled else ""
        raise _of_files(files, f"{' and '.join(sorted(missing))} missing{have}")
    C = _damping(assembled, structural_at, files)
    known = _nodes(coordinates, nodes)
    rows = _labels(labels, own, known, assembled["K"].shape[0])
    try:
        model = Model(
            assembled["M"], assembled["K"], C, rows, known.coordinates, units, rounding, symmetrize,
            known.elements,
        )  # fmt: skip
    except ValueError as error:
        raise _of_files(files, error) from None
    if not supports:
        return model
    free = [row for row, each in enumerate(model.labels) if each not in known.held]
    return model.part(free)


def _of_files(files: Sequence[File], reason: object) -> ValueError:
    """Return an error of what files have together."""
    paths = ", ".join(dict.fromkeys(str(file.name) for file in files))
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
    assembled: Mapping[str, Any], structural_at: float | None, files: Sequence[File]
) -> Any:
    """Return the matrix of viscous damping, with structural damping at a frequency."""
    C, structural = assembled.get("C"), assembled.get("K4")
    if structural_at is None:
        if structural is not None:
            path, name = next((f.name, f.named["K4"]) for f in files if "K4" in f.matrices)
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


def _read(path: Path, name: str, names: Mapping[str, str] | None) -> File:
    """Return the matrices of a file as M, K and C; `name`: which one it is to give."""
    labels = label_files.beside(path)
    try:
        reader_of(path.name, READERS)  # before the file is looked at
        content = read(path.name, path.read_bytes(), known=READERS)
        file = select(str(path), content, name, names)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    if content.labels or labels is None:
        return file
    own = label_files.read_labels(labels)
    try:
        fit(file.matrices, len(own))
    except ValueError as error:
        raise ValueError(f"{labels} {error}") from None
    return replace(file, labels=own)


def _warn_of_unused(file: File) -> None:
    if file.unused:
        more = f" and {len(file.unused) - _NAMED} more" if len(file.unused) > _NAMED else ""
        message = f"{file.name}: not used: {', '.join(file.unused[:_NAMED])}{more}"
        warnings.warn(message, UserWarning, stacklevel=3)
