"""Readers of numpy's and scipy's archives of matrices."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sparse

from vibroimpact.models.labels import Content


def npz(path: Path) -> Content:
    """Read what `scipy.sparse.save_npz` wrote, or `numpy.savez` with M, K and C."""
    if not zipfile.is_zipfile(path):
        raise ValueError("it is no archive of numpy")
    try:
        with np.load(path, allow_pickle=False) as file:
            if "format" not in file:
                return Content(dict(file), [])
        return Content({"": _checked(sparse.load_npz(path))}, [])
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
