"""Readers of numpy's arrays and archives, and of scipy's.

numpy's own reader evaluates the head of an array as an expression, and takes memory for what an
archive claims. This one reads the heads that numpy writes, and unpacks as much as the bounds
allow. Pickled objects are not read. The layout: numpy.lib.format; scipy.sparse.save_npz.
"""

from __future__ import annotations

import io
import re
import zipfile
from math import prod
from typing import Any, Final

import numpy as np
import scipy.sparse as sparse

from vibroimpact_schema.files.bounds import LOCAL, Bounds, TooLargeError, check_count
from vibroimpact_schema.files.labels import STACKS, Content

_HEAD: Final = re.compile(
    rb"\{ *'descr': *'([<>](?:[fiu][248]|f16|c8|c16|c32|U[1-9][0-9]{0,5})|[|](?:[iub]1|S[1-9]"
    rb"[0-9]{0,5}))', *"
    rb"'fortran_order': *(True|False), *"
    rb"'shape': *\(((?:[0-9]{1,18}(?:, *[0-9]{1,18}){0,3},?)?)\),? *\}\s*"
)
_LONGEST_HEAD: Final = 4096
"""Bytes of the head of an array; real ones have some 120."""
_ENTRY: Final = b"PK\x01\x02"
"""How each entry of an archive begins in its list of contents."""
_STEP: Final = 1 << 20
_MAKERS: Final = {
    "csr": ("data", "indices", "indptr"), "csc": ("data", "indices", "indptr"),
    "bsr": ("data", "indices", "indptr"), "coo": ("data", "row", "col"),
    "dia": ("data", "offsets"),
}  # fmt: skip
"""Form of a sparse matrix -> the arrays that it has beside its shape."""


class NoArrayError(ValueError):
    """Bytes are no array of numbers."""


def npy(data: bytes, bounds: Bounds = LOCAL) -> Content:
    """Read an array: a matrix, the diagonal of one, or M and K, or M, K and C, behind another."""
    values = _array(data, bounds)
    if values.ndim != 3:
        return Content({"": values}, [])
    names = STACKS.get(values.shape[0])
    if names is None:
        raise ValueError(f"it has the shape {values.shape}; three dimensions are M K, or M K C")
    return Content(dict(zip(names, values, strict=True)), [])


def _array(data: bytes, bounds: Bounds = LOCAL) -> Any:
    """Return the array in the bytes of a ``.npy`` file.

    Raises
    ------
    NoArrayError
        If it is none of numbers, or has another length than its head states.
    TooManyRowsError
        If its head states more than the bounds allow.
    """
    width = {b"\x93NUMPY\x01\x00": 2, b"\x93NUMPY\x02\x00": 4}.get(data[:8])
    if width is None:
        raise NoArrayError("it is no array of numpy")
    start = 8 + width
    end = start + int.from_bytes(data[8:start], "little")
    head = _HEAD.fullmatch(data[start:end]) if end - start <= _LONGEST_HEAD else None
    if head is None:
        raise NoArrayError("it is no array of numpy that can be read: no real numbers by its head")
    try:
        dtype = np.dtype(head[1].decode())
    except TypeError:  # the long numbers of another machine
        raise NoArrayError(f"it has numbers of the type {head[1].decode()}") from None
    shape = tuple(int(size) for size in head[3].split(b",") if size.strip())
    bounds.check_rows(max(shape, default=0))
    size = prod(shape) * dtype.itemsize
    if len(data) - end != size:
        reason = f"its head claims {size} bytes of numbers, {len(data) - end} follow"
        raise NoArrayError(f"it is no array of numpy that can be read: {reason}")
    return np.frombuffer(data, dtype, offset=end).reshape(shape, order=_order(head[2]))


def _order(fortran: bytes) -> Any:
    return "F" if fortran == b"True" else "C"


def npz(data: bytes, bounds: Bounds = LOCAL) -> Content:
    """Read what `scipy.sparse.save_npz` wrote, or `numpy.savez` with M, K and C."""
    if not zipfile.is_zipfile(io.BytesIO(data)):
        raise ValueError("it is no archive of numpy")
    try:
        arrays = _arrays(data, bounds)
        if "format" not in arrays:
            return Content(arrays, [])
        return Content({"": _sparse(arrays)}, [])
    except TooLargeError:
        raise
    # The libraries raise whatever comes up in a damaged file.
    except Exception as error:
        reason = str(error).strip().partition("\n")[0][:200] or type(error).__name__
        raise ValueError(f"it is no archive of numpy that can be read: {reason}") from None


def _arrays(data: bytes, bounds: Bounds) -> dict[str, Any]:
    """Return the arrays of an archive by their names."""
    arrays: dict[str, Any] = {}
    size = 0
    check_count(data.count(_ENTRY))  # before there is an object for each of them
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        for entry in archive.infolist():
            if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise zipfile.BadZipFile("it is packed in a way that numpy does not write")
            content = io.BytesIO()
            with archive.open(entry) as file:
                while part := file.read(_STEP):
                    size += len(part)
                    bounds.check_size(size)
                    content.write(part)
            name = entry.filename.removesuffix(".npy")
            arrays[name] = _array(content.getvalue())
    return arrays


def _sparse(arrays: dict[str, Any]) -> Any:
    """Return a sparse matrix whose indices lie within it: the loops of scipy rely on that."""
    form = str(arrays["format"].astype("U")) if arrays["format"].ndim == 0 else ""
    parts = _MAKERS.get(form)
    if parts is None:
        raise NoArrayError(f"a sparse matrix of the form {form[:20]!r}")
    shape = tuple(int(size) for size in arrays["shape"].tolist())
    values, *index = (arrays[part] for part in parts)
    if values.dtype.kind not in "biufc" or any(each.dtype.kind not in "iu" for each in index):
        raise NoArrayError("its entries are no numbers, or its indices are not whole")
    values = values.astype(np.complex128 if values.dtype.kind == "c" else np.float64)
    places = tuple(each.astype(np.int64) for each in index)
    given = (values, places) if form == "coo" else (values, *places)
    value = getattr(sparse, f"{form}_array")(given, shape=shape)
    if hasattr(value, "check_format"):
        value.check_format(full_check=True)
    entries: Any = sparse.coo_array(value)
    for index, size in zip(entries.coords, entries.shape, strict=True):
        if index.size and (index.min() < 0 or index.max() >= size):
            raise NoArrayError("an index is out of range")
    return entries
