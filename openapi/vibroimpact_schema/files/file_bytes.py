"""The bytes of a file, unpacked where it is compressed, and texts as lines."""

from __future__ import annotations

import gzip
import io
import zlib
from pathlib import PurePath
from typing import Final

from vibroimpact_schema import number_tables
from vibroimpact_schema.files.bounds import LOCAL, Bounds
from vibroimpact_schema.number_tables import TextError

_STEP: Final = 1 << 20


def unpacked(name: str, data: bytes, bounds: Bounds = LOCAL) -> bytes:
    """Return the content of a file; one whose name ends in ``.gz`` is unpacked.

    Raises
    ------
    TooLargeError
        If it is larger than the bounds allow, which is found out before more is unpacked.
    ValueError
        If it is no such archive, or damaged.
    """
    if not name.lower().endswith(".gz"):
        return data
    content = io.BytesIO()
    try:
        with gzip.open(io.BytesIO(data)) as file:
            while part := file.read(_STEP):
                bounds.check_size(content.tell() + len(part))
                content.write(part)
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise ValueError(f"it is no archive of gzip that can be read: {error}") from None
    return content.getvalue()


def suffix(name: str) -> str:
    """Return how the name of a file ends, in small letters, without ``.gz``."""
    return PurePath(_unpacked_name(name)).suffix.lower()


def stem(name: str) -> str:
    """Return the name of a file without its ending, or endings with ``.gz``."""
    return PurePath(_unpacked_name(name)).stem


def _unpacked_name(name: str) -> str:
    return name[:-3] if name.lower().endswith(".gz") else name


def lines(data: bytes, bounds: Bounds = LOCAL) -> list[bytes]:
    """Return the lines of a text without their ends.

    Raises
    ------
    TextError
        If it has zero bytes, which no text has.
    TooLargeError
        If it has more lines than the bounds allow.
    """
    text = number_tables.plain(data)
    if b"\0" in text:
        raise TextError(1 + text.count(b"\n", 0, text.index(b"\0")), "it has a zero byte: no text")
    bounds.check_lines(1 + text.count(b"\n"))
    return text.split(b"\n")
