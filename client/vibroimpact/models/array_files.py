"""Readers of numpy's arrays and archives, and of scipy's."""

from __future__ import annotations

import io
import zipfile
from typing import Any, Final

import numpy as np
import scipy.sparse as sparse

from vibroimpact.models.labels import Content

_STACKS: Final = {2: ("M", "K"), 3: ("M", "K", "C")}


def npy(data: bytes) -> Content:
    """Read an array: a matrix, the diagonal of one, or M and K, or M, K and C, behind another."""
    if not data.startswith(b"\x93NUMPY"):
        raise ValueError("it is no array of numpy")
    try:
        array = np.load(io.BytesIO(data), allow_pickle=False)
    except Exception as error:  # as below
        raise _damaged("array of numpy", error) from None
    if array.ndim != 3:
        return Content({"": array}, [])
    names = _STACKS.get(array.shape[0])
    if names is None:
        raise ValueError(f"it has the shape {array.shape}; three dimensions are M K, or M K C")
    return Content(dict(zip(names, array, strict=True)), [])


def npz(data: bytes) -> Content:
    """Read what `scipy.sparse.save_npz` wrote, or `numpy.savez` with M, K and C."""
    if not zipfile.is_zipfile(io.BytesIO(data)):
        raise ValueError("it is no archive of numpy")
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            if "format" not in file:
                return Content(dict(file), [])
        return Content({"": _checked(sparse.load_npz(io.BytesIO(data)))}, [])
    # The libraries raise whatever comes up in a damaged file.
    except Exception as error:
        raise _damaged("archive of numpy", error) from None


def _checked(value: Any) -> Any:
    """Return a matrix whose indices lie within it: the compiled loops of scipy rely on that."""
    if not sparse.issparse(value):
        return value
    if hasattr(value, "check_format"):
        value.check_format(full_check=True)
    entries: Any = sparse.coo_array(value)  # type: ignore[call-overload]
    for index, size in zip(entries.coords, entries.shape, strict=True):
        if index.size and (index.min() < 0 or index.max() >= size):
            raise ValueError("an index is out of range")
    return entries


def _damaged(what: str, error: Exception) -> ValueError:
    reason = str(error).strip().partition("\n")[0] or type(error).__name__
    return ValueError(f"it is no {what} that can be read: {reason}")
