"""Variables, dimensions and attributes of a netCDF-4 file, written by h5py.

netCDF-4 is HDF5 with dimension scales: a dimension is a dataset of its name at the root, its
coordinate or, where it has none, an empty one, whose number is in the attribute ``_Netcdf4Dimid``;
every variable is attached to the scales of its dimensions (`netCDF-4 format
<https://docs.unidata.ucar.edu/netcdf-c/current/file_format_specifications.html>`_). Most results
are small, so that the time goes into objects and not into numbers: those are made by h5py's
functions of HDF5 itself, with what they have in common made once.
"""

from __future__ import annotations

import mmap
import uuid
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any, Final

import h5py
import numpy as np
from h5py import h5a, h5d, h5ds, h5g, h5p, h5s, h5t

from vibroimpact_schema.entries import Array, Entry

_TEXT: Final = h5py.string_dtype()
_BARE: Final = b"This is a netCDF dimension but not a netCDF variable."
"""What the name of a dimension's scale begins with where it has no coordinate."""
_LARGE: Final = 2**16
"""Bytes from which an array is compressed; below it the chunk index costs more than it saves."""
_CHUNK: Final = 2**20
_PIECE: Final = 8 * 2**20
"""Bytes from which an array is written piece by piece."""
_ROWS: Final = 1024
"""Length of the pieces of what has no length yet."""
_ORDER: Final = h5p.CRT_ORDER_TRACKED | h5p.CRT_ORDER_INDEXED


def file_of(given: Iterable[Entry]) -> bytes:
    """Return the file of the entries of a result."""
    # HDF5 refuses a name that is open, in memory too, as of another thread.
    name = uuid.uuid4().hex
    with h5py.File(name, "w", driver="core", backing_store=False, track_order=True) as file:
        Variables(file).write(given)
        file.flush()
        return bytes(file.id.get_file_image())


class Variables:
    """Writes variables to an empty file; `Entry` names its methods.

    Parameters
    ----------
    file : h5py.File
    """

    def __init__(self, file: h5py.File) -> None:
        self._file, self._root = file, file.id
        self._text = h5t.C_S1.copy()
        self._text.set_size(h5t.VARIABLE)
        self._text.set_cset(h5t.CSET_UTF8)
        self._from_text = h5t.py_create(_TEXT)
        self._scalar = h5s.create(h5s.SCALAR)
        self._dataset = h5p.create(h5p.DATASET_CREATE)
        self._dataset.set_attr_creation_order(_ORDER)
        self._dataset.set_obj_track_times(False)
        self._dataset.set_fill_time(h5d.FILL_TIME_IFSET)
        self._group = h5p.create(h5p.GROUP_CREATE)
        self._group.set_obj_track_times(False)
        self._group.set_attr_creation_order(_ORDER)
        self._group.set_link_creation_order(_ORDER)
        self._link = h5p.create(h5p.LINK_CREATE)
        self._link.set_char_encoding(h5t.CSET_UTF8)
        self._groups = {"": h5g.open(self._root, b"/")}
        self._sizes: dict[str, int] = {}
        self._scales: dict[str, h5d.DatasetID] = {}
        self._made: list[tuple[h5d.DatasetID, tuple[str, ...]]] = []
        versions = f"version=2,h5py={h5py.__version__},hdf5={h5py.version.hdf5_version}"
        self._set(self._groups[""], "_NCProperties", np.bytes_(versions))

    def write(self, entries: Iterable[Entry]) -> None:
        """Write all entries of a file, in order."""
        for method, arguments in entries:
            getattr(self, method)(*arguments)
        for variable, dims in self._made:  # to scales that nothing takes the place of any more
            for axis, dim in enumerate(dims):
                h5ds.attach_scale(variable, self._scales[dim], axis)

    def name_dimensions(self, sizes: Mapping[str, int], variables: Collection[str]) -> None:
        """Tell all dimensions with their sizes, and which variables there will be.

        One whose name no variable has gets a scale without values.
        """
        self._sizes = dict(sizes)
        for name, size in sizes.items():
            if name not in variables:
                space, creation = self._space((name,), (size,))
                scale = h5d.create(
                    self._root, name.encode(), h5t.IEEE_F32BE, space, creation, self._link
                )
                self._name_scale(scale, name, _BARE + b"%10d" % size)

    def array(
        self,
        place: str,
        dims: tuple[str, ...],
        values: Array,
        dtype: np.dtype[Any],
        attributes: Mapping[str, Any],
    ) -> None:
        """Write a variable at a path, of numbers of some type."""
        group, name = self._place(place)
        storage = _storage(values.shape, dtype)
        if storage:
            target = self._file.create_dataset(
                place, values.shape, dtype, track_order=True, **storage
            )
            _fill(target, values, dtype, storage["chunks"][0])
            variable = target.id
        else:
            space, creation = self._space(dims, values.shape)
            kind = h5t.py_create(dtype, logical=True)
            variable = h5d.create(group, name, kind, space, creation, self._link)
            if values.size:
                variable.write(h5s.ALL, h5s.ALL, np.ascontiguousarray(values, dtype))
        if place in self._sizes:
            self._name_scale(variable, place, place.encode())
        if dims and dims != (place,):
            self._made.append((variable, dims))
        self._set_all(variable, attributes)

    def link(self, place: str, other: str) -> None:
        """Let a variable stand at another path as well."""
        self._place(other)
        self._file[other] = self._file[place]

    def describe(self, group: str, attributes: Mapping[str, Any]) -> None:
        """Write attributes of a group; those of the file for an empty path."""
        target, _ = self._place(f"{group}/" if group else "")
        self._set_all(target, attributes)

    def _place(self, path: str) -> tuple[h5g.GroupID, bytes]:
        """Return the group of a path, which is made where it is missing, and the name in it."""
        folder, _, name = path.rpartition("/")
        if folder not in self._groups:
            parent, last = self._place(folder)
            self._groups[folder] = h5g.create(parent, last, self._link, self._group)
        return self._groups[folder], name.encode()

    def _space(
        self, dims: tuple[str, ...], shape: tuple[int, ...]
    ) -> tuple[h5s.SpaceID, h5p.PropDCID]:
        """Return the space of a variable, and how it is created.

        Dimensions of no length are unlimited ones, the only ones that netCDF has of that length.
        """
        if 0 not in shape:
            if not shape:
                return self._scalar, self._dataset
            return h5s.create_simple(shape), self._dataset
        creation = self._dataset.copy()
        creation.set_chunk(tuple(min(size, _ROWS) or _ROWS for size in shape))
        limits = tuple(size or h5s.UNLIMITED for size in shape)
        return h5s.create_simple(shape, limits), creation

    def _name_scale(self, scale: h5d.DatasetID, dimension: str, name: bytes) -> None:
        number = list(self._sizes).index(dimension)
        self._set(scale, "_Netcdf4Dimid", np.int32(number))
        h5ds.set_scale(scale, name)
        self._scales[dimension] = scale

    def _set_all(self, target: Any, attributes: Mapping[str, Any]) -> None:
        """Write attributes; numbers are vectors, as netCDF has no others."""
        for name, value in attributes.items():
            self._set(target, name, value if isinstance(value, str) else np.atleast_1d(value))

    def _set(self, target: Any, name: str, value: Any) -> None:
        """Write an attribute: a text, a number or numbers."""
        if isinstance(value, str):
            attribute = h5a.create(target, name.encode(), self._text, self._scalar)
            attribute.write(np.array(value, _TEXT), self._from_text)
            return
        values = np.asarray(value)
        kind = h5t.py_create(values.dtype, logical=True)
        space = h5s.create_simple(values.shape) if values.shape else self._scalar
        h5a.create(target, name.encode(), kind, space).write(values)


def _fill(target: h5py.Dataset, values: Array, dtype: np.dtype[Any], chunk: int) -> None:
    """Write a large array, piece by piece."""
    if values.nbytes <= _PIECE:
        target[...] = values
        return
    for rows in _pieces(values.shape, dtype, chunk):
        target[rows] = values[rows].astype(dtype, copy=False)
        _release(values)


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
