"""Named arrays and a JSON document in one block of bytes, checked when read, free of pickle."""

from __future__ import annotations

import hashlib
import io
import itertools
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from vibroimpact_service.results.rows import RowFile

Array = NDArray[Any]

_MAGIC = b"VIB1"
_ALIGN = 16


class DamagedContainerError(ValueError):
    """The bytes are not a container, or not the one that was written."""


def pack(arrays: Mapping[str, Array], meta: Mapping[str, Any]) -> bytes:
    """Return the bytes of arrays (of plain numbers) and a JSON document."""
    buffer = io.BytesIO()
    write(buffer, arrays, meta)
    return buffer.getvalue()


def write(
    file: IO[bytes], arrays: Mapping[str, Array] | Mapping[str, RowFile], meta: Mapping[str, Any]
) -> None:
    """Write the bytes that `pack` returns to an empty file."""
    entries, offset = [], 0
    for name, array in arrays.items():
        entry = {"name": name, "dtype": array.dtype.str, "shape": array.shape, "offset": offset}
        entries.append(entry)
        offset += array.nbytes + -array.nbytes % _ALIGN
    head = json.dumps({"arrays": entries, "meta": meta}, separators=(",", ":")).encode()
    head += b" " * (-(len(head) + 44) % _ALIGN)
    digest = hashlib.sha256()
    file.write(_MAGIC + bytes(32))
    blocks = itertools.chain.from_iterable(_blocks(array) for array in arrays.values())
    for block in itertools.chain([len(head).to_bytes(8, "little"), head], blocks):
        digest.update(block)
        file.write(block)
    file.seek(4)
    file.write(digest.digest())


def _blocks(array: Array | RowFile) -> Iterator[bytes | memoryview]:
    """Yield the bytes of an array, and those that fill its last block."""
    if isinstance(array, RowFile):
        yield from array.blocks()
    else:
        yield np.ascontiguousarray(array).reshape(-1).view(np.uint8).data  # no copy
    yield bytes(-array.nbytes % _ALIGN)


def open_file(path: Path, offset: int) -> tuple[dict[str, Array], dict[str, Any]]:
    """Return the arrays and the document of a container in a file, without reading the arrays.

    The arrays are maps of the file, whose bytes are not checked: that is left to the store.
    """
    with path.open("rb") as file:
        file.seek(offset)
        opening = file.read(44)
        if opening[:4] != _MAGIC:
            raise DamagedContainerError
        head = json.loads(file.read(int.from_bytes(opening[36:44], "little")))
        start = file.tell()
    arrays: dict[str, Array] = {}
    for entry in head["arrays"]:
        shape, dtype = tuple(entry["shape"]), np.dtype(entry["dtype"])
        if 0 in shape:
            arrays[entry["name"]] = np.empty(shape, dtype)
            continue
        position = start + entry["offset"]
        arrays[entry["name"]] = np.memmap(path, dtype, "r", position, shape)
    return arrays, head["meta"]


def unpack(data: bytes) -> tuple[dict[str, Array], dict[str, Any]]:
    """Return the arrays (read-only views into the bytes) and the document.

    Raises
    ------
    DamagedContainerError
        Where the bytes are not what `pack` returned.
    """
    if data[:4] != _MAGIC or hashlib.sha256(memoryview(data)[36:]).digest() != data[4:36]:
        raise DamagedContainerError
    start = 44 + int.from_bytes(data[36:44], "little")
    head = json.loads(data[44:start])
    arrays = {}
    for entry in head["arrays"]:
        dtype, shape = np.dtype(entry["dtype"]), tuple(entry["shape"])
        count = int(np.prod(shape, dtype=np.int64))
        flat = np.frombuffer(data, dtype, count=count, offset=start + entry["offset"])
        arrays[entry["name"]] = flat.reshape(shape)
    return arrays, head["meta"]
