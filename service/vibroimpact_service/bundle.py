"""Named arrays and a JSON document in one block of bytes, checked when read, free of pickle."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

_MAGIC = b"VIB1"
_ALIGN = 16


class DamagedBundle(ValueError):  # noqa: N818 (it names the state of the data)
    """The bytes are not a bundle, or not the one that was written."""


def pack(arrays: Mapping[str, np.ndarray[Any, Any]], meta: Mapping[str, Any]) -> bytes:
    """Return the bytes of arrays (of plain numbers) and a JSON document."""
    entries, blocks, offset = [], [], 0
    for name, array in arrays.items():
        block = np.ascontiguousarray(array).tobytes()
        entry = {"name": name, "dtype": array.dtype.str, "shape": array.shape, "offset": offset}
        entries.append(entry)
        blocks.append(block + bytes(-len(block) % _ALIGN))
        offset += len(blocks[-1])
    head = json.dumps({"arrays": entries, "meta": meta}, separators=(",", ":")).encode()
    head += b" " * (-(len(head) + 44) % _ALIGN)
    body = b"".join([len(head).to_bytes(8, "little"), head, *blocks])
    return _MAGIC + hashlib.sha256(body).digest() + body


def unpack(data: bytes) -> tuple[dict[str, np.ndarray[Any, Any]], dict[str, Any]]:
    """Return the arrays (read-only views into the bytes) and the document.

    Raises
    ------
    DamagedBundle
        Where the bytes are not what `pack` returned.
    """
    if data[:4] != _MAGIC or hashlib.sha256(memoryview(data)[36:]).digest() != data[4:36]:
        raise DamagedBundle
    start = 44 + int.from_bytes(data[36:44], "little")
    head = json.loads(data[44:start])
    arrays = {}
    for entry in head["arrays"]:
        dtype, shape = np.dtype(entry["dtype"]), tuple(entry["shape"])
        count = int(np.prod(shape, dtype=np.int64))
        flat = np.frombuffer(data, dtype, count=count, offset=start + entry["offset"])
        arrays[entry["name"]] = flat.reshape(shape)
    return arrays, head["meta"]
