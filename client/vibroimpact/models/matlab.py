"""Reader of Matlab's files, versions 4 to 7: matrices of numbers, full and sparse, and structures.

scipy's reader ends the process on some damaged files. This one slices bytes that it has counted.
The format: MathWorks, MAT-File Format, chapters 1 (version 5) and 2 (version 4).
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from math import prod
from typing import Any, Final

import numpy as np
import scipy.sparse as sparse

from vibroimpact.models import matlab_hdf5
from vibroimpact.models.matlab_hdf5 import NotNumbers
from vibroimpact_schema.files.labels import Content

_TYPES: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8",
                 12: "i8", 13: "u8"}  # fmt: skip
"""Data types of version 5."""
_TYPES_4: Final = ("f8", "f4", "i4", "i2", "u2", "u1")
_MATRIX, _COMPRESSED = 14, 15
_CLASSES: Final = range(6, 16)
"""Classes of numbers, double to uint64; below are cells, structures, texts and sparse matrices."""
_SPARSE: Final = 5
_COMPLEX, _LOGICAL = 0x0800, 0x0200


_STRUCT: Final = 2
_DEPTH: Final = 8
"""Structures within one another that are looked into."""


def mat(data: bytes) -> Content:
    """Read the variables of a file; fields of structures are called ``structure.field``.

    Raises
    ------
    ValueError
        If it is damaged.
    """
    if data.startswith((b"MATLAB 7.3", b"\x89HDF")):
        return Content(matlab_hdf5.variables(data), [])
    # The text with which files begin from version 5 on has no zero bytes.
    variables = _version_4(data) if 0 in data[:4] else _version_5(data)
    content: dict[str, Any] = {}
    try:
        for name, value in variables:
            if name in content:
                raise ValueError(f"there are two variables {name}")
            content[name] = value
    except (zlib.error, MemoryError) as error:
        raise ValueError(f"it is damaged: {error or 'too large'}") from None
    return Content(content, [])


class _Bytes:
    """Bytes that are taken one part after the other."""

    def __init__(self, data: bytes | memoryview, order: str) -> None:
        self._data, self.order, self._at = memoryview(data), order, 0

    def __len__(self) -> int:
        return len(self._data) - self._at

    def take(self, count: int) -> memoryview:
        """Return the next bytes."""
        if not 0 <= count <= len(self):
            raise ValueError("it is damaged: it ends within a variable")
        self._at += count
        return self._data[self._at - count : self._at]

    def numbers(self, kind: str, count: int) -> Any:
        """Return the next numbers of a type."""
        dtype = np.dtype(self.order + kind)
        return np.frombuffer(self.take(count * dtype.itemsize), dtype)

    def element(self) -> tuple[int, memoryview]:
        """Return type and content of the next element of version 5."""
        kind, size = (int(word) for word in self.numbers("u4", 2))
        if kind >> 16:  # four bytes at most, in place of the size
            self._at -= 4
            return kind & 0xFFFF, self.take(4)[: kind >> 16]
        content = self.take(size)
        if kind != _COMPRESSED:
            self.take(min(-size % 8, len(self)))
        return kind, content

    def array(self) -> Any:
        """Return the numbers of the next element of version 5."""
        kind, content = self.element()
        if kind not in _TYPES:
            raise ValueError(f"it is damaged: numbers of type {kind}")
        dtype = np.dtype(self.order + _TYPES[kind])
        if len(content) % dtype.itemsize:
            raise ValueError("it is damaged: it ends within a number")
        return np.frombuffer(content, dtype)


def _version_5(data: bytes) -> Iterator[tuple[str, Any]]:
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None:
        raise ValueError("it is no file of Matlab")
    elements = _Bytes(data[128:], order)
    while len(elements) >= 8:
        kind, content = elements.element()
        if kind == _COMPRESSED:
            kind, content = _Bytes(zlib.decompress(content), order).element()
        if kind != _MATRIX:
            raise ValueError(f"it is damaged: an element of type {kind} among variables")
        yield from _variables(_Bytes(content, order), 0)
    if len(elements):
        raise ValueError("it is damaged: it ends within a variable")


def _variables(content: _Bytes, depth: int) -> Iterator[tuple[str, Any]]:
    """Yield name and value of a variable, or of the fields of a structure.

    Nothing is yielded for what Matlab stores for itself.
    """
    flags = content.array()
    if flags.size != 2:
        raise ValueError("it is damaged: a variable without its class")
    kind, is_complex = int(flags[0]) & 0xFF, bool(int(flags[0]) & _COMPLEX)
    if kind == 17:  # an object
        return
    shape = tuple(int(size) for size in content.array())
    name = bytes(content.element()[1]).decode("latin-1")
    logical = bool(int(flags[0]) & _LOGICAL)
    if kind == _STRUCT and prod(shape) == 1 and depth < _DEPTH:
        yield from ((f"{name}.{each}", value) for each, value in _fields(content, depth))
        return
    if (kind not in _CLASSES and kind != _SPARSE) or (kind == _SPARSE and logical):
        if name or depth:
            yield name, NotNumbers()
        return
    if len(shape) < 2 or min(shape) < 0:
        raise ValueError(f"it is damaged: {name} has the shape {shape}")
    places = (content.array(), content.array()) if kind == _SPARSE else None
    values: Any = content.array()
    if is_complex:
        imaginary = content.array()
        if imaginary.size != values.size:
            raise ValueError(f"it is damaged: {name} has other imaginary than real parts")
        values = values + 1j * imaginary
    if places is not None:
        yield name, _by_columns(name, shape, *places, values)
        return
    if values.size != prod(shape):
        raise ValueError(f"it is damaged: {name} has {values.size} numbers of {prod(shape)}")
    yield name, values.reshape(shape, order="F")


def _fields(content: _Bytes, depth: int) -> Iterator[tuple[str, Any]]:
    """Yield name and value of the fields of a structure."""
    length = content.array()
    names = bytes(content.element()[1])
    size = int(length[0]) if length.size == 1 else 0
    if size < 1 or len(names) % size:
        raise ValueError("it is damaged: a structure without names of its fields")
    for start in range(0, len(names), size):
        field = names[start : start + size].partition(b"\0")[0].decode("latin-1")
        kind, value = content.element()
        if kind != _MATRIX:
            raise ValueError(f"it is damaged: an element of type {kind} in a structure")
        if not len(value):
            continue  # an empty field
        for name, each in _variables(_Bytes(value, content.order), depth + 1):
            yield f"{field}{name}", each


def _by_columns(name: str, shape: tuple[int, ...], row: Any, start: Any, values: Any) -> Any:
    """Return a sparse matrix by the rows of its entries and where each column starts."""
    starts = start.astype(np.int64)
    used = int(starts[-1]) if starts.size else -1
    whole = (
        len(shape) == 2
        and starts.size == shape[1] + 1
        and starts[0] == 0
        and bool((np.diff(starts) >= 0).all())
        and used <= min(row.size, values.size)
        and (not used or (row[:used].min() >= 0 and row[:used].max() < shape[0]))
    )
    if not whole:
        raise ValueError(f"it is damaged: entries of {name} are out of range")
    column = np.repeat(np.arange(shape[1]), np.diff(starts))
    index = row[:used].astype(np.int64)
    return sparse.coo_array((_floats(values[:used]), (index, column)), shape=shape)


def _floats(values: Any) -> Any:
    return values if values.dtype.kind == "c" else values.astype(np.float64)


def _version_4(data: bytes) -> Iterator[tuple[str, Any]]:
    order = "<" if 0 <= int.from_bytes(data[:4], "little") < 5000 else ">"
    content = _Bytes(data, order)
    while len(content):
        kind, rows, columns, is_complex, length = (int(word) for word in content.numbers("i4", 5))
        precision, layout = kind % 100 // 10, kind % 10
        if kind % 1000 // 100 or precision >= len(_TYPES_4) or layout > 2 or min(rows, columns) < 0:
            raise ValueError("it is damaged: no head of a variable")
        name = bytes(content.take(length)).rstrip(b"\0").decode("latin-1")
        values: Any = content.numbers(_TYPES_4[precision], rows * columns)
        if is_complex:
            values = values + 1j * content.numbers(_TYPES_4[precision], rows * columns)
        values = values.reshape((rows, columns), order="F")
        if layout == 1:
            yield name, NotNumbers()
        else:
            yield name, _by_rows(name, values) if layout == 2 else values


def _by_rows(name: str, table: Any) -> Any:
    """Return a sparse matrix by rows ``row, column, value``, the last one with its size."""
    if table.shape[0] < 1 or table.shape[1] not in (3, 4):
        raise ValueError(f"it is damaged: {name} has no entries")
    places, values = table[:, :2].real, table[:-1, 2]
    if table.shape[1] == 4:
        values = values + 1j * table[:-1, 3]
    whole = (
        bool(np.isfinite(places).all() and (places == np.floor(places)).all())
        and 0 <= places.min() <= places.max() < 2**31
        and bool((places[:-1] >= 1).all() and (places[:-1] <= places[-1]).all())
    )
    if not whole:
        raise ValueError(f"it is damaged: entries of {name} are out of range")
    index, shape = places[:-1].astype(np.int64) - 1, tuple(int(size) for size in places[-1])
    return sparse.coo_array((_floats(values), (index[:, 0], index[:, 1])), shape=shape)
