"""The bytes of a file, unpacked where it is compressed, and texts as lines."""

from __future__ import annotations

import gzip
import zlib
from pathlib import Path
from typing import Final

from vibroimpact_schema import number_tables
from vibroimpact_schema.number_tables import TextError

LARGEST: Final = 4 << 30
"""Bytes that a compressed file may have when unpacked: 50 million entries as text."""
_STEP: Final = 16 << 20


def read(path: Path) -> bytes:
    """Return the content of a file; one ending in ``.gz`` is unpacked.

    Raises
    ------
    ValueError
        If it is no such archive, damaged, or larger than `LARGEST`.
    """
    if path.suffix.lower() != ".gz":
        return path.read_bytes()
    parts, size = list[bytes](), 0
    try:
        with gzip.open(path) as file:
            while part := file.read(_STEP):
                size += len(part)
                if size > LARGEST:
                    raise ValueError(f"unpacked it is larger than {LARGEST >> 30} GiB")
                parts.append(part)
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise ValueError(f"it is no archive of gzip that can be read: {error}") from None
    return b"".join(parts)


def suffix(path: Path) -> str:
    """Return how the name of a file ends, in small letters, without ``.gz``."""
    return (path.with_suffix("") if path.suffix.lower() == ".gz" else path).suffix.lower()


def stem(path: Path) -> str:
    """Return the name of a file without its ending, or endings with ``.gz``."""
    return (path.with_suffix("") if path.suffix.lower() == ".gz" else path).stem


def lines(data: bytes) -> list[bytes]:
    """Return the lines of a text without their ends.

    Raises
    ------
    TextError
        If it has zero bytes, which no text has.
    """
    text = number_tables.plain(data)
    if b"\0" in text:
        raise TextError(1 + text.count(b"\n", 0, text.index(b"\0")), "it has a zero byte: no text")
    return text.split(b"\n")
