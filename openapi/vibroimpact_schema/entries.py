"""Results as arrays: all that the file of a result has, in one block of bytes, without a file.

A small result takes longer to be written to HDF5 and read from it than to be computed. This form
has the same content, and takes a tenth of a millisecond on either side:

1. the length of a JSON text, 8 bytes, little-endian;
2. the text, filled with spaces so that what follows starts at a multiple of 8 bytes: the list of
   entries, in which an object ``{"dtype", "shape", "offset"}`` stands for an array, and
   ``{"texts"}`` for one of texts;
3. the arrays one after the other, in C order, each filled to a multiple of 8 bytes; their offsets
   are counted from the first.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any, Final, TypeAlias

import h5py
import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Entry: TypeAlias = tuple[str, tuple[Any, ...]]
"""Part of a file: ``("name_dimensions", (sizes, variables))`` first, then any of
``("array", (path, dimensions, values, dtype, attributes))``, ``("link", (path, other))`` and
``("describe", (path of a group, attributes))``."""

MEDIA_TYPE: Final = "application/x-vibroimpact"
_KINDS: Final = frozenset({"name_dimensions", "array", "link", "describe"})
_ALIGN: Final = 8
_TEXTS: Final = h5py.string_dtype()


def pack(entries: Iterable[Entry]) -> bytes:
    """Return the bytes of entries."""
    blocks: list[bytes] = []
    size = 0

    def replaced(value: Any) -> Any:
        """Return what stands in the text for a value that JSON does not have."""
        nonlocal size
        if isinstance(value, np.dtype):
            return value.str
        if isinstance(value, set | frozenset):
            return sorted(value)
        array = np.asarray(value)
        if array.dtype.hasobject:
            return {"texts": array.tolist()}
        place = {"dtype": array.dtype.str, "shape": array.shape, "offset": size}
        blocks.append(array.tobytes() + bytes(-array.nbytes % _ALIGN))
        size += len(blocks[-1])
        return place

    text = json.dumps(list(entries), default=replaced, separators=(",", ":")).encode()
    text += b" " * (-len(text) % _ALIGN)
    return b"".join([len(text).to_bytes(8, "little"), text, *blocks])


def unpack(data: bytes) -> list[Entry]:
    """Return the entries of their bytes; arrays are read-only views into these.

    Raises
    ------
    ValueError
        Where the bytes are not what `pack` returned.
    """
    try:
        return _unpacked(data)
    except (TypeError, RecursionError) as error:  # of lists and numbers that are something else
        raise ValueError(str(error)) from None


def _unpacked(data: bytes) -> list[Entry]:
    start = 8 + int.from_bytes(data[:8], "little")
    if start > len(data):
        raise ValueError("the text ends early")

    def restored(value: dict[str, Any]) -> Any:
        if value.keys() == {"texts"}:
            return np.array(value["texts"], _TEXTS)
        if value.keys() != {"dtype", "shape", "offset"}:
            return value
        shape = tuple(value["shape"])
        count = int(np.prod(shape, dtype=np.int64))
        if count < 0:
            raise ValueError(f"no array has the shape {shape}")
        offset = start + value["offset"]
        return np.frombuffer(data, value["dtype"], count, offset).reshape(shape)

    entries = json.loads(data[8:start], object_hook=restored)
    return [_entry(*each) for each in entries]


def _entry(kind: str, given: list[Any]) -> Entry:
    if kind not in _KINDS:
        raise ValueError(f"results have no {kind}")
    if kind != "array":
        return kind, tuple(given)
    path, dimensions, values, dtype, attributes = given
    as_stored = _TEXTS if np.asarray(values).dtype.hasobject else np.dtype(dtype)
    return kind, (path, tuple(dimensions), values, as_stored, attributes)
