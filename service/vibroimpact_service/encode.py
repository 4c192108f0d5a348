"""How results become bundles, JSON and HDF5, and bundles results; nowhere else.

A bundle describes itself: dimensions, units and names travel with the arrays, so that a
stored result can be written in either representation by any later version.
"""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import h5netcdf
import numpy as np
import orjson
from numpy.typing import NDArray

from vibroimpact_service import bundle
from vibroimpact_solvers.arrays import Quantity, quantities

Array = NDArray[Any]
Result = TypeVar("Result")

_LARGE = 2**16
"""Bytes from which an array is compressed; below it the chunk index costs more than it saves."""
_CHUNK = 2**20


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
    """

    arrays: Mapping[str, Array]
    meanings: Mapping[str, Quantity]
    plain: Mapping[str, Any]
    head: Mapping[str, Any]


def freeze(result: Any, head: Mapping[str, Any]) -> bytes:
    """Return the bundle of a result; fields that are None were not asked for and are left out."""
    meanings = quantities(type(result))
    arrays, plain = {}, {}
    for field in dataclasses.fields(result):
        value = getattr(result, field.name)
        if value is None:
            continue
        if field.name in meanings:
            arrays[field.name] = np.ascontiguousarray(value)
        else:
            plain[field.name] = value
    described = {name: dataclasses.asdict(meanings[name]) for name in arrays}
    return bundle.pack(arrays, {"head": head, "plain": plain, "meanings": described})


def open_bundle(data: bytes) -> Content:
    """Return the content of a bundle.

    Raises
    ------
    DamagedBundle
        Where the bytes are not what `freeze` returned.
    """
    arrays, meta = bundle.unpack(data)
    meanings = {
        name: Quantity(
            **{**meaning, "dims": tuple(meaning["dims"]), "flags": tuple(meaning["flags"])}
        )
        for name, meaning in meta["meanings"].items()
    }
    return Content(arrays, meanings, meta["plain"], meta["head"])


def thaw(data: bytes, result: type[Result]) -> Result:
    """Return the result that a bundle was made of."""
    content = open_bundle(data)
    absent = dict.fromkeys((f.name for f in dataclasses.fields(result)), None)  # type: ignore[arg-type]
    return result(**{**absent, **content.arrays, **content.plain})


# -- JSON ----------------------------------------------------------------------------------


def json(content: Content) -> bytes:
    """Return the result document; floats as their shortest text, which reads back to the bit."""
    head = content.head
    document: dict[str, Any] = {"kind": head["kind"], "digest": head["digest"]}
    for name, values in content.arrays.items():
        meaning = content.meanings[name]
        _place(document, meaning.path or name, _plain(values, meaning))
    for name, value in content.plain.items():
        _place(document, name.replace("_", "/", 1), value)
    document["plan"] = head["plan"]
    document["provenance"] = head["provenance"]
    return orjson.dumps(document, option=orjson.OPT_SERIALIZE_NUMPY)


def _plain(values: Array, meaning: Quantity) -> Any:
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


class _Writer:
    """Writes one file."""

    def __init__(self, file: Any, content: Content) -> None:
        self.file, self.content = file, content
        # A dimension is called after the first coordinate along it, as xarray expects.
        self.axes: dict[str, str] = {}
        self.beside: dict[str, list[str]] = {}
        for name, meaning in content.meanings.items():
            if meaning.coordinate and len(meaning.dims) == 1:
                (dim,) = meaning.dims
                if dim in self.axes:
                    self.beside.setdefault(dim, []).append(name)
                else:
                    self.axes[dim] = name

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
            group, _, attribute = name.partition("_")
            place = self.file.groups.get(group) or self.file.create_group(group)
            place.attrs[attribute] = value

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
        stored = values.astype(np.int8) if meaning.flags else values
        dims = tuple(self.axes.get(dim, dim) for dim in meaning.dims)
        variable = self.file.create_variable(
            place, dims, stored.dtype, data=stored, **_storage(stored)
        )
        variable.attrs["long_name"] = meaning.long_name
        variable.attrs["units"] = unit(meaning.unit, self.content.head["units"])
        if meaning.flags:
            variable.attrs["flag_values"] = np.arange(len(meaning.flags), dtype=np.int8)
            variable.attrs["flag_meanings"] = " ".join(meaning.flags)
        beside = [n for dim in meaning.dims for n in self.beside.get(dim, ())]
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


def _storage(values: Array) -> dict[str, Any]:
    """Return how an array is laid out: small ones plainly, large ones compressed in chunks."""
    if values.nbytes < _LARGE:
        return {}
    return {
        "chunks": _chunks(values),
        "compression": "gzip",
        "compression_opts": 4,
        "shuffle": True,
        "fletcher32": True,
    }


def _chunks(values: Array) -> tuple[int, ...]:
    """Return chunks of about a mebibyte that keep the last axes whole."""
    chunks = list(values.shape)
    for axis in range(values.ndim):
        rest = values.itemsize * int(np.prod(chunks[axis + 1 :], dtype=np.int64))
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
