"""How results become bundles, JSON and HDF5, and bundles results; nowhere else.

A bundle describes itself: dimensions, units and names travel with the arrays, so that a
stored result can be written in either representation by any later version.
"""

from __future__ import annotations

import dataclasses
import io
import mmap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, TypeVar

import h5netcdf
import numpy as np
import orjson
from numpy.typing import NDArray

from vibroimpact_service import bundle
from vibroimpact_solvers.arrays import Described, Quantity, quantities

Array = NDArray[Any]
Result = TypeVar("Result")

_LARGE = 2**16
"""Bytes from which an array is compressed; below it the chunk index costs more than it saves."""
_CHUNK = 2**20
_PIECE = 8 * 2**20
"""Bytes from which an array is written piece by piece."""


@dataclass(frozen=True, slots=True)
class Content:
    """What a bundle holds.

    Parameters
    ----------
    arrays : mapping
        Field of the result -> values.
    meanings : mapping
        Field of the result -> what its values are.
    plain : mapping
        The fields that are not arrays, such as the error statement.
    head : mapping
        Kind, digest, request, plan, provenance and units: what surrounds the numbers.
    free : bool
        Whether the dimensions are those of this result alone, not of its kind.
    """

    arrays: Mapping[str, Array]
    meanings: Mapping[str, Quantity]
    plain: Mapping[str, Any]
    head: Mapping[str, Any]
    free: bool = False


def describe(result: Any, head: Mapping[str, Any]) -> Content:
    """Return what a result holds; fields that are None were not asked for and are left out."""
    if isinstance(result, Described):
        return Content(result.arrays, result.meanings, result.plain, head, free=True)
    meanings = quantities(type(result))
    arrays, plain = {}, {}
    for field in dataclasses.fields(result):
        value = getattr(result, field.name)
        if value is None:
            continue
        if field.name in meanings:
            arrays[field.name] = np.asarray(value, order="C")
        else:
            plain[field.name] = value
    return Content(arrays, {name: meanings[name] for name in arrays}, plain, head)


def freeze(result: Any, head: Mapping[str, Any]) -> bytes:
    """Return the bundle of a result."""
    content = describe(result, head)
    described = {name: _written(each) for name, each in content.meanings.items()}
    meta = {"head": head, "plain": content.plain, "meanings": described}
    return bundle.pack(content.arrays, {**meta, "free": True} if content.free else meta)


@lru_cache(maxsize=1024)
def _written(meaning: Quantity) -> dict[str, Any]:
    """Return a meaning as the bundle holds it; not to be changed."""
    return dataclasses.asdict(meaning)


def open_bundle(data: bytes) -> Content:
    """Return the content of a bundle.

    Raises
    ------
    DamagedBundle
        Where the bytes are not what `freeze` returned.
    """
    return _content(*bundle.unpack(data))


def open_file(path: Path, offset: int) -> Content:
    """Return the content of a bundle in a file, whose arrays stay there until they are used."""
    return _content(*bundle.open_file(path, offset))


def _content(arrays: dict[str, Array], meta: dict[str, Any]) -> Content:
    meanings = {
        name: Quantity(
            **{**meaning, "dims": tuple(meaning["dims"]), "flags": tuple(meaning["flags"])}
        )
        for name, meaning in meta["meanings"].items()
    }
    return Content(arrays, meanings, meta["plain"], meta["head"], meta.get("free", False))


def thaw(data: bytes, result: type[Result]) -> Result:
    """Return the result that a bundle was made of."""
    content = open_bundle(data)
    if issubclass(result, Described):
        return result(content.arrays, content.meanings, content.plain)
    absent = dict.fromkeys((f.name for f in dataclasses.fields(result)), None)  # type: ignore[arg-type]
    return result(**{**absent, **content.arrays, **content.plain})


# -- JSON ----------------------------------------------------------------------------------


def json(content: Content) -> bytes:
    """Return the result document; floats as their shortest text, which reads back to the bit."""
    head = content.head
    document: dict[str, Any] = {"kind": head["kind"], "digest": head["digest"]}
    tables: dict[str, dict[str, Any]] = {}
    for name, values in content.arrays.items():
        meaning = content.meanings[name]
        if meaning.record:
            table, _, column = meaning.path.partition("/")
            tables.setdefault(table, {})[column] = _plain(values, meaning)
        else:
            _place(document, meaning.path or name, _plain(values, meaning))
    for table, columns in tables.items():
        rows = zip(*columns.values(), strict=True)
        document[table] = [dict(zip(columns, row, strict=True)) for row in rows]
    for name, value in content.plain.items():
        _place(document, name.replace("_", "/", 1), value)
    if content.free:
        document["dimensions"] = {name: m.dims for name, m in content.meanings.items()}
    document["plan"] = head["plan"]
    document["provenance"] = head["provenance"]
    return orjson.dumps(document, option=orjson.OPT_SERIALIZE_NUMPY)


def _plain(values: Array, meaning: Quantity) -> Any:
    if values.ndim == 0:
        return values.item()
    if meaning.flags and values.dtype != np.bool_:
        return np.array(meaning.flags, dtype=object)[values].tolist()
    return values


def _place(document: dict[str, Any], path: str, value: Any) -> None:
    *groups, name = path.split("/")
    for group in groups:
        document = document.setdefault(group, {})
    document[name] = value


# -- HDF5 ----------------------------------------------------------------------------------


def hdf5(content: Content) -> bytes:
    """Return a netCDF-4 file with named dimensions, coordinates, units and meanings of codes."""
    buffer = io.BytesIO()
    with h5netcdf.File(buffer, "w") as file:
        _Writer(file, content).write()
    return buffer.getvalue()


def rewrite(stored: Path, offset: int, path: Path) -> None:
    """Write the file of a stored bundle to a path, holding only pieces of the arrays in memory."""
    with h5netcdf.File(path, "w") as file:
        _Writer(file, open_file(stored, offset)).write()


class _Writer:
    """Writes one file."""

    def __init__(self, file: Any, content: Content) -> None:
        self.file, self.content = file, content
        # A dimension is called after the first coordinate along it, as xarray expects.
        self.axes: dict[str, str] = {}
        self.beside: dict[str, set[str]] = {}
        for name, meaning in content.meanings.items():
            if meaning.coordinate:
                (dim, *others) = meaning.dims
                if others or dim in self.axes:
                    self.beside[name] = set(meaning.dims)
                else:
                    self.axes[dim] = name
        groups = {meaning.path.partition("/")[0] for meaning in content.meanings.values()}
        for dim in {dim for meaning in content.meanings.values() for dim in meaning.dims}:
            if dim in groups and dim not in self.axes:
                self.axes[dim] = f"{dim}_index"  # its own name is that of a group

    def write(self) -> None:
        """Write everything."""
        self._attributes()
        arrays, meanings = self.content.arrays, self.content.meanings
        for name, values in arrays.items():
            for dim, size in zip(meanings[name].dims, values.shape, strict=True):
                self.file.dimensions.setdefault(self.axes.get(dim, dim), size)
        for name, values in arrays.items():
            self._variable(name, values, meanings[name])
        for name, value in self.content.plain.items():
            group, _, attribute = name.replace("_", "/", 1).rpartition("/")
            if group and group not in self.file.groups:
                self.file.create_group(group)
            place = self.file.groups[group] if group else self.file
            place.attrs[attribute] = "\n".join(value) if isinstance(value, list) else value

    def _attributes(self) -> None:
        head = self.content.head
        self.file.attrs["Conventions"] = "CF-1.11"
        self.file.attrs["kind"] = head["kind"]
        self.file.attrs["digest"] = head["digest"]
        self.file.attrs["solver_version"] = head["provenance"]["solver_version"]
        self.file.attrs["request"] = head["request"]
        self.file.attrs["plan"] = orjson.dumps(head["plan"]).decode()
        self.file.attrs["created"] = head["provenance"]["created"]

    def _variable(self, name: str, values: Array, meaning: Quantity) -> None:
        root = meaning.coordinate or not meaning.path
        place = name if root else meaning.path
        dims = tuple(self.axes.get(dim, dim) for dim in meaning.dims)
        dtype = np.dtype(np.int8) if meaning.flags else values.dtype
        storage = _storage(values.shape, dtype)
        if values.nbytes <= _PIECE:
            data = values.astype(dtype, copy=False)
            variable = self.file.create_variable(place, dims, dtype, data=data, **storage)
        else:
            variable = self.file.create_variable(place, dims, dtype, **storage)
            for rows in _pieces(values.shape, dtype, storage["chunks"][0]):
                variable[rows] = values[rows].astype(dtype)
                _let_go(values)
        variable.attrs["long_name"] = meaning.long_name
        variable.attrs["units"] = unit(meaning.unit, self.content.head["units"])
        if meaning.flags:
            variable.attrs["flag_values"] = np.arange(len(meaning.flags), dtype=np.int8)
            variable.attrs["flag_meanings"] = " ".join(meaning.flags)
        if meaning.rows_of:
            variable.attrs["sample_dimension"] = self.axes.get(meaning.rows_of, meaning.rows_of)
        beside = [n for n, dims in self.beside.items() if dims <= set(meaning.dims)]
        if beside and not meaning.coordinate:
            variable.attrs["coordinates"] = " ".join(beside)
        if root and meaning.path:
            self._link(meaning.path, place)

    def _link(self, path: str, target: str) -> None:
        """Make a dataset of the root appear in its group too, without copying it."""
        group, _, name = path.rpartition("/")
        if group not in self.file.groups:
            self.file.create_group(group)
        raw = self.file._h5file
        raw[group][name] = raw[target]


def _pieces(shape: tuple[int, ...], dtype: Any, chunk: int) -> Iterator[slice]:
    """Yield ranges of rows, whole chunks of some mebibytes."""
    row = dtype.itemsize * int(np.prod(shape[1:], dtype=np.int64))
    count = chunk * max(1, _PIECE // max(1, row * chunk))
    for start in range(0, shape[0], count):
        yield slice(start, min(start + count, shape[0]))


def _let_go(values: Array) -> None:
    """Give back the memory of those pages of a file that were read."""
    base: Any = values
    while base is not None and not isinstance(base, mmap.mmap):
        base = getattr(base, "base", None)
    if base is not None:
        base.madvise(mmap.MADV_DONTNEED)


def _storage(shape: tuple[int, ...], dtype: Any) -> dict[str, Any]:
    """Return how an array is laid out: small ones plainly, large ones compressed in chunks."""
    size = dtype.itemsize * int(np.prod(shape, dtype=np.int64))
    if size < _LARGE:
        return {}
    return {
        "chunks": _chunks(shape, dtype.itemsize),
        "compression": "gzip",
        # Digits of numbers hardly get shorter by more effort, and large arrays feel it.
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


_SYMBOLS: Final = ("mass", "length", "time")


def unit(dimension: str, units: Mapping[str, str] | None) -> str:
    """Return the unit of a dimension such as "mass length time-2" in a set of units.

    Without a set of units everything is dimensionless, "1".
    """
    if units is None or dimension == "1":
        return "1"
    symbols = []
    for factor in dimension.split():
        base = factor.rstrip("-0123456789")
        symbols.append(units[base] + factor[len(base) :] if base in _SYMBOLS else factor)
    return " ".join(symbols)
