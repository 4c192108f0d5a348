"""Matrices as files, read by what the client reads them with, within the limits of the service.

A body is Matrix Market text or a raw .npy, with K alone (the masses are then 1), M and K, or M, K
and C one after another; or it is multipart/form-data: a part M, K or C is the file of that matrix,
parts called ``file`` are files whose names or contents tell which matrices they have. Neither
HDF5, nor what Matlab writes, nor pickles are read: crafted ones open other files or run code.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Final

from vibroimpact_schema import number_tables
from vibroimpact_schema.files import (
    array_files,
    file_bytes,
    label_texts,
    readers,
    structures,
    symmetry,
    text_files,
)
from vibroimpact_schema.files.bounds import Bounds, TooLargeError, TooManyRowsError
from vibroimpact_schema.files.labels import meaning
from vibroimpact_schema.number_tables import NotFiniteError
from vibroimpact_schema.problems import Fault
from vibroimpact_schema.systems import MatrixSystem
from vibroimpact_service import problems
from vibroimpact_service.documents import multipart, parse
from vibroimpact_service.documents.multipart import Part
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings

MATRIX_MARKET: Final = "application/x-matrix-market"
NPY: Final = "application/x-npy"

_MATRICES: Final = ("M", "K", "C")
_FILE: Final = "file"
"""Name of parts that are files of any matrices, or of labels."""
_MOST_LINES: Final = 1 << 19
"""Lines of formats that are read line by line, some microseconds each; the files of structures of
5000 degrees of freedom have a third of it."""
_LABELS: Final = frozenset(label_texts.BESIDE.values())
_BODY: Final = Part("", "", b"")
"""Stands for the whole body."""


def system(content_type: str, body: bytes, settings: Settings) -> tuple[MatrixSystem, list[str]]:
    """Return the document of the system in files, and the names of what it does not use of them.

    It has no constraints.

    Raises
    ------
    ProblemError
        400 where files have other formats than they should, 413 where they are too large, 422
        where they are no system; with the part that is wrong.
    """
    media_type = content_type.partition(";")[0].strip().lower()
    if media_type not in (MATRIX_MARKET, NPY):
        files = _files(multipart.parts(content_type, body), settings)
    else:
        files = [_alone(media_type, body, _bounds(settings, 0))]
    with _located(_BODY):
        kept = structures.once_each(files)
        matrices, _ = structures.together(kept)
    unused = [name for file in kept for name in file.unused]
    # Structural damping is viscous at one frequency only, which each request may choose.
    unused += [file.named["K4"] for file in kept if "K4" in file.matrices]
    return _document(matrices), unused


def _bounds(settings: Settings, used: int) -> Bounds:
    """Return what a file may have, of a body whose other files have some bytes."""
    return Bounds(settings.max_body_bytes - used, _MOST_LINES, settings.max_dofs)


@contextmanager
def _located(part: Part) -> Iterator[None]:
    """Turn the errors of readers into problems that name a part and its file."""
    where = f"/{part.name}" if part.name else ""
    try:
        yield
    except ValueError as error:
        said = f"{part.filename or part.name}: {error}"
        if part is _BODY:
            said = f"{str(error)[:1].upper()}{str(error)[1:]}."
        match error:
            case TooManyRowsError():
                raise problems.too_large(where, "too_many_dofs", said) from None
            case TooLargeError():
                raise problems.too_large(where, "file_too_large", said) from None
            case NotFiniteError():
                raise problems.invalid(where, "not_finite", said) from None
        raise _malformed(where, said) from None


def _malformed(where: str, said: str) -> ProblemError:
    code = problems.MALFORMED_FILE.code
    faults = [Fault(pointer=where, code=code, message=said)] if where else []
    return ProblemError(problems.MALFORMED_FILE, said, faults)


def _alone(media_type: str, body: bytes, bounds: Bounds) -> structures.File:
    """Return the matrices of a body that is one file."""
    with _located(_BODY):
        if media_type == MATRIX_MARKET:
            content = text_files.market(number_tables.plain(body), bounds)
        else:
            content = array_files.npy(body, bounds)
        keyword = "K" if list(content.matrices) == [""] else ""
        return structures.select("", content, keyword, bounds=bounds)


def _files(parts: Sequence[Part], settings: Settings) -> list[structures.File]:
    """Return the matrices of the parts of a body."""
    labels, matrices = dict[str, Part](), list[Part]()
    for part in parts:
        if part.name not in (*_MATRICES, _FILE):
            message = f"parts are called M, K, C or file, not {part.name[:40]!r}"
            raise problems.invalid("", "unknown_part", message)
        if file_bytes.suffix(part.filename) in _LABELS:
            labels[part.filename.lower()] = part
        else:
            matrices.append(part)
    files, used = list[structures.File](), 0
    for part in matrices:
        bounds = _bounds(settings, used)
        with _located(part):
            content = readers.read(part.filename, part.data, bounds)
            used += max(len(part.data), sum(map(_bytes, content.matrices.values())))
            keyword = "" if part.name == _FILE else part.name
            if not keyword and len(matrices) == len(content.matrices) == 1:
                (only,) = content.matrices
                # One matrix alone is the stiffness, unless its name says otherwise.
                keyword = "" if meaning(only or structures.said_by(part.filename)) else "K"
            file = structures.select(part.filename, content, keyword, bounds=bounds)
        files.append(_labelled(file, labels, bounds))
    _check_labels(labels, files)
    return files


def _bytes(matrix: Any) -> int:
    """Return what the numbers of a matrix take."""
    return int(getattr(matrix, "nbytes", 0) or getattr(matrix, "nnz", 0) * 8)


def _beside(file: structures.File) -> str:
    """Return the name of the file of labels that a program writes beside one of a matrix."""
    ending = label_texts.BESIDE.get(file_bytes.suffix(file.name), "")
    return f"{file_bytes.stem(file.name)}{ending}".lower()


def _labelled(file: structures.File, labels: Mapping[str, Part], bounds: Bounds) -> structures.File:
    """Return a file with the labels of its rows, where they came in a file beside it."""
    part = labels.get(_beside(file))
    if file.labels or part is None:
        return file
    with _located(part):
        rows = label_texts.read(part.filename, part.data, bounds)
        try:
            structures.fit(file.matrices, len(rows))
        except ValueError as error:
            raise ValueError(f"it {error} in {file.name}") from None
    return replace(file, labels=rows)


def _check_labels(labels: Mapping[str, Part], files: Sequence[structures.File]) -> None:
    """Refuse files of labels that belong to no matrix."""
    names = {_beside(file) for file in files}
    for name, part in labels.items():
        if name not in names:
            message = f"{part.filename}: there is no file of a matrix with the same name"
            raise problems.invalid(f"/{part.name}", "unused_file", message)


def _document(matrices: Mapping[str, Any]) -> MatrixSystem:
    """Return the document of a system; without masses, they are 1."""
    if "K" not in matrices:
        have = f"; there is {' and '.join(sorted(matrices))}" if matrices else ""
        raise problems.invalid("/K", "missing", f"no file has the stiffness K{have}")
    content: dict[str, Any] = {"constraints": []}
    for name in _MATRICES:
        if name in matrices:
            content[name] = _entries(_symmetric(name, matrices[name]))
    if "M" not in content:
        content["M"] = {"scalar": 1.0, "n": matrices["K"].shape[0]}
    return parse.document(MatrixSystem, content)


def _symmetric(name: str, given: Any) -> Any:
    where = f"/{name}"
    try:
        matrix = symmetry.square(name, given)
        symmetry.check(name, matrix)
    except symmetry.NotSquareError as error:
        raise _malformed(where, str(error)) from None
    except symmetry.NotSymmetricError as error:
        raise problems.invalid(where, "not_symmetric", str(error)) from None
    except ValueError as error:
        raise problems.invalid(where, "not_finite", str(error)) from None
    return symmetry.mean(matrix)


def _entries(matrix: Any) -> Any:
    """Return the document of a matrix: rows where it is more than half full, else its entries."""
    if 2 * matrix.nnz > matrix.shape[0] * matrix.shape[1]:
        return matrix.toarray().tolist()
    entries = matrix.tocoo()
    return {
        "shape": list(matrix.shape),
        "row": entries.row.tolist(),
        "col": entries.col.tolist(),
        "data": entries.data.tolist(),
    }
