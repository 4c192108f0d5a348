"""A result as a netCDF-4 file: named dimensions, coordinates, units, meanings of codes."""

from __future__ import annotations

import io
import mmap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import h5netcdf
import h5py
import numpy as np
import orjson

from vibroimpact_service.results import encode
from vibroimpact_service.results.container import Array
from vibroimpact_service.results.encode import Content
from vibroimpact_service.results.units import unit
from vibroimpact_solvers.arrays import Quantity

_LARGE: Final = 2**16
"""Bytes from which an array is compressed; below it the chunk index costs more than it saves."""
_CHUNK: Final = 2**20
_PIECE: Final = 8 * 2**20
"""Bytes from which an array is written piece by piece."""


def to_hdf5(content: Content) -> bytes:
    """Return the file of a result."""
    buffer = io.BytesIO()
    _write(buffer, content)
    return buffer.getvalue()


def convert(stored: Path, offset: int, path: Path) -> None:
    """Write the file of a stored result to a path, holding only pieces of its arrays in memory."""
    _write(path, encode.unpack_file(stored, offset))


def _write(target: Path | io.BytesIO, content: Content) -> None:
    with h5py.File(target, "w", track_order=True) as raw, h5netcdf.File(raw, "w") as file:
        _write_head(file, content.head)
        dimensions = axes(content.meanings)
        for name, values in content.arrays.items():
            for dim, size in zip(content.meanings[name].dims, values.shape, strict=True):
                file.dimensions.setdefault(dimensions.names.get(dim, dim), size)
        for name, values in content.arrays.items():
            meaning = content.meanings[name]
            at_root = meaning.coordinate or not meaning.path
            place = name if at_root else meaning.path
            variable = _write_array(
                file, place, dimensions.of(meaning), values, bool(meaning.flags)
            )
            variable.attrs.update(_attributes(meaning, dimensions, content.head["units"]))
            if at_root and meaning.path:
                # The dataset appears in its group too, without being copied.
                _group(file, meaning.path.rpartition("/")[0])
                raw[meaning.path] = raw[place]
        for name, value in content.plain.items():
            group, _, attribute = content.path(name).rpartition("/")
            text = "\n".join(value) if isinstance(value, list) else value
            _group(file, group).attrs[attribute] = text
            if isinstance(value, (int, float)) and group:
                # As a variable too, like the numbers that are arrays elsewhere.
                meaning = content.meanings[name]
                number = file.create_variable(content.path(name), (), data=np.array(value))
                number.attrs.update(_attributes(meaning, dimensions, content.head["units"]))
        if content.free:
            of_arrays = _group(file, "dimensions")
            for name, meaning in content.meanings.items():
                of_arrays.attrs[name] = " ".join(dimensions.of(meaning))


def _write_head(file: Any, head: Mapping[str, Any]) -> None:
    file.attrs["Conventions"] = "CF-1.11"
    file.attrs["kind"] = head["kind"]
    file.attrs["digest"] = head["digest"]
    file.attrs["solver_version"] = head["provenance"]["solver_version"]
    file.attrs["request"] = head["request"]
    file.attrs["plan"] = orjson.dumps(head["plan"]).decode()
    file.attrs["created"] = head["provenance"]["created"]


def _group(file: Any, name: str) -> Any:
    if not name:
        return file
    return file.groups[name] if name in file.groups else file.create_group(name)


@dataclass(frozen=True, slots=True)
class Axes:
    """Names of dimensions in the file, and coordinates beside those that name a dimension.

    A dimension is called after the first coordinate along it, as xarray expects.
    """

    names: dict[str, str]
    auxiliary: dict[str, set[str]]

    def of(self, meaning: Quantity) -> tuple[str, ...]:
        """Return the dimensions of an array."""
        return tuple(self.names.get(dim, dim) for dim in meaning.dims)


def axes(meanings: Mapping[str, Quantity]) -> Axes:
    """Return the names of the dimensions in the file of a result with these fields."""
    names: dict[str, str] = {}
    auxiliary: dict[str, set[str]] = {}
    for name, meaning in meanings.items():
        if meaning.coordinate:
            (dim, *others) = meaning.dims
            if others or dim in names:
                auxiliary[name] = set(meaning.dims)
            else:
                names[dim] = name
    groups = {meaning.path.partition("/")[0] for meaning in meanings.values()}
    for dim in {dim for meaning in meanings.values() for dim in meaning.dims}:
        if dim in groups and dim not in names:
            names[dim] = f"{dim}_index"  # its own name is that of a group
    return Axes(names, auxiliary)


def _attributes(
    meaning: Quantity, dimensions: Axes, units: Mapping[str, str] | None
) -> dict[str, Any]:
    attributes: dict[str, Any] = {
        "long_name": meaning.long_name,
        "units": unit(meaning.unit, units),
    }
    if meaning.flags:
        attributes["flag_values"] = np.arange(len(meaning.flags), dtype=np.int8)
        attributes["flag_meanings"] = " ".join(meaning.flags)
    if meaning.rows_of:
        attributes["sample_dimension"] = dimensions.names.get(meaning.rows_of, meaning.rows_of)
    along = [name for name, dims in dimensions.auxiliary.items() if dims <= set(meaning.dims)]
    if along and not meaning.coordinate:
        attributes["coordinates"] = " ".join(along)
    return attributes


def _write_array(file: Any, place: str, dims: tuple[str, ...], values: Array, codes: bool) -> Any:
    dtype = np.dtype(np.int8) if codes else values.dtype
    storage = _storage(values.shape, dtype)
    if values.nbytes <= _PIECE:
        data = values.astype(dtype, copy=False)
        return file.create_variable(place, dims, dtype, data=data, **storage)
    variable = file.create_variable(place, dims, dtype, **storage)
    for rows in _pieces(values.shape, dtype, storage["chunks"][0]):
        variable[rows] = values[rows].astype(dtype)
        _release(values)
    return variable


def _pieces(shape: tuple[int, ...], dtype: Any, chunk: int) -> Iterator[slice]:
    """Yield ranges of rows, whole chunks of some mebibytes."""
    row = dtype.itemsize * int(np.prod(shape[1:], dtype=np.int64))
    count = chunk * max(1, _PIECE // max(1, row * chunk))
    for start in range(0, shape[0], count):
        yield slice(start, min(start + count, shape[0]))


def _release(values: Array) -> None:
    """Release the memory of those pages of a mapped file that were read."""
    base: Any = values
    while base is not None and not isinstance(base, mmap.mmap):
        base = getattr(base, "base", None)
    if base is not None:
        base.madvise(mmap.MADV_DONTNEED)


def _storage(shape: tuple[int, ...], dtype: Any) -> dict[str, Any]:
    """Return the layout of an array: small ones contiguous, large ones compressed in chunks."""
    size = dtype.itemsize * int(np.prod(shape, dtype=np.int64))
    if size < _LARGE:
        return {}
    return {
        "chunks": _chunks(shape, dtype.itemsize),
        "compression": "gzip",
        # Digits of numbers hardly get shorter at higher levels, which take longer.
        "compression_opts": 4 if size <= _PIECE else 1,
        "shuffle": True,
        "fletcher32": True,
    }


def _chunks(shape: tuple[int, ...], itemsize: int) -> tuple[int, ...]:
    """Return chunks of about a mebibyte that keep the last axes whole."""
    chunks = list(shape)
    for axis in range(len(shape)):
        rest = itemsize * int(np.prod(chunks[axis + 1 :], dtype=np.int64))
        chunks[axis] = min(chunks[axis], max(1, _CHUNK // rest))
        if chunks[axis] > 1:
            break
    return tuple(chunks)
