"""Reader of Matlab's files of version 7.3, which are files of HDF5.

The layout: a variable is a data set, its dimensions in the opposite order; a sparse matrix is a
group with ``data``, ``ir`` and ``jc`` and the attribute ``MATLAB_sparse``, its number of rows; a
structure is a group of its fields (MathWorks, MAT-File Versions, and the HDF5 files that
``save(..., "-v7.3")`` writes). Links to elsewhere and data outside of the file are left alone.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import Any, Final

import h5py
import numpy as np
import scipy.sparse as sparse

_DEPTH: Final = 8
"""Structures within one another that are looked into."""
_LARGEST: Final = 2 << 30
"""Bytes of a matrix: what is claimed of compressed data costs nothing to claim."""


class NotNumbers:
    """A variable that is no matrix of numbers: a text, a cell array, an array of structures."""


def variables(data: bytes) -> dict[str, Any]:
    """Return the variables of a file by their names; ``structure.field`` of structures.

    Raises
    ------
    ValueError
        If it is damaged.
    """
    try:
        with h5py.File(io.BytesIO(data), "r") as file:
            return dict(_variables(file, "", 0))
    # The library raises whatever comes up in a damaged file.
    except (OSError, KeyError, RuntimeError, TypeError, MemoryError, OverflowError) as error:
        reason = str(error).strip().partition("\n")[0] or type(error).__name__
        raise ValueError(f"it is no file of Matlab 7.3 that can be read: {reason}") from None


def _variables(group: h5py.Group, prefix: str, depth: int) -> Iterator[tuple[str, Any]]:
    """Yield name and value of the variables of a group."""
    for name in group:
        if name.startswith("#") or not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue  # what Matlab keeps for itself, and links to elsewhere
        variable, path = group[name], f"{prefix}{name}"
        if isinstance(variable, h5py.Dataset):
            yield path, _array(variable, path)
        elif "MATLAB_sparse" in variable.attrs:
            yield path, _sparse(variable, path)
        elif depth < _DEPTH:
            yield from _variables(variable, f"{path}.", depth + 1)


def _array(dataset: h5py.Dataset, name: str) -> Any:
    """Return the numbers of a data set as Matlab has them."""
    compound = dataset.dtype.names == ("real", "imag")
    of_numbers = compound or dataset.dtype.kind in "fiu"
    kind = dataset.attrs.get("MATLAB_class", b"double")
    if not of_numbers or kind in (b"char", b"cell") or dataset.ndim != 2:
        return NotNumbers()
    if dataset.attrs.get("MATLAB_empty", 0):
        return np.zeros((0, 0))
    return _content(dataset, name).T


def _content(dataset: Any, name: str) -> Any:
    """Return the numbers of a data set as the file has them."""
    if not isinstance(dataset, h5py.Dataset) or dataset.external or dataset.is_virtual:
        raise ValueError(f"the numbers of {name} are not in this file")
    if dataset.nbytes > _LARGEST:
        raise ValueError(f"{name} has {dataset.nbytes} bytes: too large a matrix to be full")
    values = dataset[()]
    if values.dtype.names:
        return values["real"] + 1j * values["imag"]
    return values


def _sparse(group: h5py.Group, name: str) -> Any:
    """Return a sparse matrix by the rows of its entries and where each column starts."""
    rows = int(group.attrs["MATLAB_sparse"])
    start = _content(group["jc"], name).ravel().astype(np.int64)
    if "data" not in group:
        return sparse.coo_array((max(rows, 1), max(start.size - 1, 1)))
    values = _content(group["data"], name).ravel()
    index = _content(group["ir"], name).ravel().astype(np.int64)
    whole = (
        start.size >= 2
        and start[0] == 0
        and bool((np.diff(start) >= 0).all())
        and start[-1] == index.size == values.size
        and (not index.size or (index.min() >= 0 and index.max() < rows))
    )
    if not whole:
        raise ValueError(f"it is damaged: entries of {name} are out of range")
    column = np.repeat(np.arange(start.size - 1), np.diff(start))
    if values.dtype.kind != "c":
        values = values.astype(np.float64)
    return sparse.coo_array((values, (index, column)), shape=(rows, start.size - 1))
