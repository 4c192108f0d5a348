"""A result as a netCDF-4 file: named dimensions, coordinates, units, meanings of codes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import orjson

from vibroimpact_schema.entries import Entry
from vibroimpact_schema.netcdf import Variables, file_of
from vibroimpact_service.results import encode
from vibroimpact_service.results.encode import Content
from vibroimpact_service.results.units import unit
from vibroimpact_solvers.arrays import Quantity


def to_hdf5(content: Content) -> bytes:
    """Return the file of a result."""
    return file_of(entries(content))


def convert(stored: Path, offset: int, path: Path) -> None:
    """Write the file of a stored result to a path, holding only pieces of its arrays in memory."""
    with h5py.File(path, "w", track_order=True) as file:
        Variables(file).write(entries(encode.unpack_file(stored, offset)))


def entries(content: Content) -> Iterator[Entry]:
    """Yield all that the file of a result has."""
    dimensions = axes(content.meanings)
    yield "describe", ("", _head(content.head))
    places, sizes = dict[str, str](), dict[str, int]()
    arrays = {**content.arrays, **_words(content)}
    for name, values in arrays.items():
        meaning = content.meanings[name]
        places[name] = name if meaning.coordinate or not meaning.path else meaning.path
        for dim, size in zip(dimensions.of(meaning), values.shape, strict=True):
            sizes.setdefault(dim, size)
    yield "name_dimensions", (sizes, set(places.values()))
    for name, values in arrays.items():
        meaning, place = content.meanings[name], places[name]
        attributes = _attributes(meaning, dimensions, content.head["units"])
        dtype = np.dtype(np.int8) if meaning.flags else values.dtype
        yield "array", (place, dimensions.of(meaning), values, dtype, attributes)
        if place == name and meaning.path:
            # The dataset appears in its group too, without being copied.
            yield "link", (name, meaning.path)
    for name, value in content.plain.items():
        if name in arrays:
            continue
        group, _, attribute = content.path(name).rpartition("/")
        text = "\n".join(value) if isinstance(value, list) else value
        yield "describe", (group, {attribute: text})
        if isinstance(value, (int, float)) and group:
            # As a variable too, like the numbers that are arrays elsewhere.
            attributes = _attributes(content.meanings[name], dimensions, content.head["units"])
            number = np.array(value)
            yield "array", (content.path(name), (), number, number.dtype, attributes)
    if content.free:
        named = {name: " ".join(dimensions.of(m)) for name, m in content.meanings.items()}
        yield "describe", ("dimensions", named)


def _words(content: Content) -> dict[str, Any]:
    """Return the texts that stand along an axis, such as names of parameters, as arrays."""
    texts = {n: v for n, v in content.plain.items() if isinstance(v, list)}
    along = {n: v for n, v in texts.items() if n in content.meanings and content.meanings[n].dims}
    return {name: np.array(value, h5py.string_dtype()) for name, value in along.items()}


def _head(head: Mapping[str, Any]) -> dict[str, str]:
    return {
        "Conventions": "CF-1.11",
        "kind": head["kind"],
        "digest": head["digest"],
        "solver_version": head["provenance"]["solver_version"],
        "request": head["request"],
        "plan": orjson.dumps(head["plan"]).decode(),
        "created": head["provenance"]["created"],
    }


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
