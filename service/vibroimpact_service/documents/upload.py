"""Matrices as files: Matrix Market text and raw .npy, checked by their headers first.

No memory is allocated by what a header claims, and no library reads what was not checked.

A body holds the matrices of M x'' + C x' + K x = f one after another: K alone (the masses are
then 1), M and K, or M, K and C. Neither HDF5 nor pickles nor archives are read: crafted ones
open other files, run code, or unpack to any size.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from vibroimpact_schema import matrix_market as market
from vibroimpact_schema import number_tables
from vibroimpact_schema.number_tables import NotFiniteError, TextError
from vibroimpact_schema.systems import MatrixSystem
from vibroimpact_service import problems
from vibroimpact_service.documents import limits, parse
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings

MATRIX_MARKET: Final = "application/x-matrix-market"
NPY: Final = "application/x-npy"

_NAMES: Final[Mapping[int, Sequence[str]]] = {1: ("K",), 2: ("M", "K"), 3: ("M", "K", "C")}
# numpy's own reader evaluates the header as an expression; these are all that it writes.
_HEADER: Final = re.compile(
    rb"\{ *'descr': *'([<>][fiu][248]|[|][iu]1)', *'fortran_order': *(True|False), *"
    rb"'shape': *\(([0-9]{1,9}(?:, *[0-9]{1,9}){0,3},?)\),? *\}\s*"
)
_LONGEST_HEADER: Final = 4096  # of .npy; real ones have some 120 bytes


def system(media_type: str, body: bytes, settings: Settings) -> MatrixSystem:
    """Return the document of the system in a file, without constraints.

    Raises
    ------
    ProblemError
        400 where it is no such file, 413 where it is too large, 422 where it is no system.
    """
    matrices = READERS[media_type](body, settings)
    names = _NAMES.get(len(matrices))
    if names is None:
        raise _malformed(f"It holds {len(matrices)} matrices instead of K, of M K, or of M K C.")
    content: dict[str, Any] = dict(zip(names, matrices, strict=True))
    if "M" not in content:
        content["M"] = {"scalar": 1.0, "n": _rows(content["K"])}
    return parse.document(MatrixSystem, {**content, "constraints": []})


def matrix_market(body: bytes, settings: Settings) -> list[Any]:
    """Return the matrices of Matrix Market texts that follow one another."""
    matrices = list[Any]()
    try:
        for matrix in market.read(
            number_tables.plain(body), lambda *shape: _check_square(shape, settings)
        ):
            matrices.append(_document(matrix))
            if len(matrices) > len(_NAMES):
                break
    except NotFiniteError as error:
        raise problems.invalid("", "not_finite", _sentence(error)) from None
    except TextError as error:
        raise _malformed(_sentence(error)) from None
    return matrices


def _document(matrix: market.Matrix) -> Any:
    if isinstance(matrix, np.ndarray):
        return matrix.tolist()
    entries = sparse.coo_array((matrix.data, (matrix.row, matrix.col)), shape=matrix.shape)
    entries.sum_duplicates()
    row, col = entries.coords
    return {
        "shape": list(entries.shape),
        "row": row.tolist(),
        "col": col.tolist(),
        "data": entries.data.tolist(),
    }


def _sentence(error: TextError) -> str:
    return f"Line {error.line}: {error.reason}."


def numpy_array(body: bytes, settings: Settings) -> list[Any]:
    """Return the matrices of a .npy file of shape (n, n), (1, n, n), (2, n, n) or (3, n, n)."""
    width = {b"\x93NUMPY\x01\x00": 2, b"\x93NUMPY\x02\x00": 4}.get(body[:8])
    if width is None:
        raise _malformed("It is no .npy file of version 1 or 2.")
    start = 8 + width
    end = start + int.from_bytes(body[8:start], "little")
    header = _HEADER.fullmatch(body[start:end]) if end - start <= _LONGEST_HEADER else None
    if header is None:
        raise _malformed("Its header does not describe an array of real numbers.")
    dtype, fortran = np.dtype(header[1].decode()), header[2] == b"True"
    shape = tuple(int(size) for size in header[3].split(b",") if size.strip())
    if len(shape) == 2:
        shape = (1, *shape)
    if len(shape) != 3 or not 1 <= shape[0] <= len(_NAMES):
        raise _malformed("Its shape must be (n, n), or (2, n, n) for M K, or (3, n, n) for M K C.")
    _check_square(shape[1:], settings)
    size = shape[0] * shape[1] * shape[2] * dtype.itemsize
    if len(body) - end != size:
        raise _malformed(f"Its header claims {size} bytes of numbers; it has others.")
    flat = np.frombuffer(body, dtype, offset=end)
    stack: NDArray[Any] = flat.reshape(shape, order="F" if fortran else "C")
    return [matrix.astype(np.float64).tolist() for matrix in stack]


READERS: Final[Mapping[str, Callable[[bytes, Settings], list[Any]]]] = {
    MATRIX_MARKET: matrix_market,
    NPY: numpy_array,
}


def _check_square(shape: Sequence[int], settings: Settings) -> None:
    rows, columns = shape
    if rows != columns or rows < 1:
        raise _malformed("A matrix must be square and not empty.")
    limits.check_dofs(rows, settings)


def _rows(matrix: Any) -> int:
    return int(matrix["shape"][0]) if isinstance(matrix, dict) else len(matrix)


def _malformed(detail: str) -> ProblemError:
    return ProblemError(problems.MALFORMED_FILE, detail)
