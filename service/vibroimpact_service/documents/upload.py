"""Matrices as files: Matrix Market text and raw .npy, checked by their headers first.

No memory is allocated before the header of a file was checked.

A body holds the matrices of M x'' + C x' + K x = f one after another: K alone (the masses are
then 1), M and K, or M, K and C. Neither HDF5 nor pickles nor archives are read: crafted ones
open other files, run code, or unpack to any size.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import io as files
from scipy import sparse

from vibroimpact_schema.systems import MatrixSystem
from vibroimpact_service import problems
from vibroimpact_service.documents import limits, parse
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings

MATRIX_MARKET: Final = "application/x-matrix-market"
NPY: Final = "application/x-npy"

_BANNER: Final = b"%%MatrixMarket"
_NAMES: Final[Mapping[int, Sequence[str]]] = {1: ("K",), 2: ("M", "K"), 3: ("M", "K", "C")}
_KINDS: Final = re.compile(
    rb"%%MatrixMarket +matrix +(coordinate|array) +(real|double|integer) +(general|symmetric)\s*",
    re.IGNORECASE,
)
_SIZES: Final = re.compile(rb"\s*(\d{1,15})\s+(\d{1,15})(?:\s+(\d{1,15}))?\s*")
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
    starts = [banner.start() for banner in re.finditer(_BANNER, body)][: len(_NAMES) + 1]
    if not starts or body[: starts[0]].strip():
        raise _malformed("It does not begin with %%MatrixMarket.")
    ends = [*starts[1:], len(body)]
    return [_one(body[a:b], settings) for a, b in zip(starts, ends, strict=True)]


def _one(text: bytes, settings: Settings) -> Any:
    layout = _check_header(text, settings)
    try:
        matrix = files.mmread(io.BytesIO(text), spmatrix=False)
    except (ValueError, OverflowError, MemoryError):
        raise _malformed("The entries of a matrix are not what its header says.") from None
    if layout == b"array":
        return np.asarray(matrix, dtype=np.float64).tolist()
    entries = sparse.coo_array(matrix)
    entries.sum_duplicates()
    row, col = entries.coords
    return {
        "shape": list(entries.shape),
        "row": row.tolist(),
        "col": col.tolist(),
        "data": entries.data.astype(np.float64).tolist(),
    }


def _check_header(text: bytes, settings: Settings) -> bytes:
    """Return the layout of a matrix whose header announces no more than its text can hold."""
    lines = io.BytesIO(text)
    banner = _KINDS.fullmatch(lines.readline(256))
    if banner is None:
        raise _malformed(
            "Its first line must be: %%MatrixMarket matrix, coordinate or array, real or "
            "integer, general or symmetric."
        )
    line = lines.readline(4096)
    while line.startswith(b"%") or (line and not line.strip()):
        line = lines.readline(4096)
    sizes = _SIZES.fullmatch(line)
    layout, symmetric = banner[1].lower(), banner[3].lower() == b"symmetric"
    if sizes is None or (sizes[3] is None) is (layout == b"coordinate"):
        raise _malformed("It does not tell rows, columns and, of a coordinate matrix, entries.")
    rows = _square((int(sizes[1]), int(sizes[2])), settings)
    if layout == b"coordinate":
        entries = int(sizes[3])
        shortest = 6  # "1 1 1" and the end of the line
    else:
        entries = rows * (rows + 1) // 2 if symmetric else rows * rows
        shortest = 2
    if entries * shortest > len(text) - lines.tell() + 1:
        raise _malformed("Its header claims more entries than the text can hold.")
    return layout


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
    _square(shape[1:], settings)
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


def _square(shape: Sequence[int], settings: Settings) -> int:
    rows, columns = shape
    if rows != columns or rows < 1:
        raise _malformed("A matrix must be square and not empty.")
    limits.check_dofs(rows, settings)
    return int(rows)


def _rows(matrix: Any) -> int:
    return int(matrix["shape"][0]) if isinstance(matrix, dict) else len(matrix)


def _malformed(detail: str) -> ProblemError:
    return ProblemError(problems.MALFORMED_FILE, detail)
