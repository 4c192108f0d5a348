"""What a backup is: a folder with records, a store, and the manifest that is written last."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final, Literal, NamedTuple

import zstandard
from pydantic import BaseModel, ConfigDict, ValidationError

from vibroimpact_service.store import Store, private

FILE: Final = "manifest.json"


class BackupInvalidError(ValueError):
    """A folder holds no finished backup, or a damaged one."""


class Block(NamedTuple):
    """A block of the store: its area, name, and SHA-256 in hexadecimal digits."""

    area: str
    name: str
    sha256: str


class File(BaseModel):
    """A file of a backup, beside its store."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    size: int
    sha256: str


class Blocks(BaseModel):
    """Number and total size of the blocks of an area, the size in bytes."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    count: int
    size: int


class Manifest(BaseModel):
    """The manifest.

    Parameters
    ----------
    format : int
        Grows where an earlier version could not read a backup.
    version : str
        That of the service.
    revisions : dict
        Tables -> revision of the records, as of `migration.TABLES`; absent: no such tables.
    began, ended : str
        Times, ISO 8601, UTC. All jobs that were acknowledged before it began are part of it.
    records, listing : File
        Rows of all tables, and names of all blocks.
    rows : dict
        Table -> number of rows.
    blocks : dict
        Area of the store -> number and size of its blocks.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal[1] = 1
    version: str
    revisions: dict[str, str]
    began: str
    ended: str
    records: File
    listing: File
    rows: dict[str, int]
    blocks: dict[str, Blocks]

    @property
    def size(self) -> int:
        """Size of the whole backup in bytes."""
        return self.records.size + self.listing.size + sum(b.size for b in self.blocks.values())

    @property
    def count(self) -> int:
        """Number of blocks."""
        return sum(blocks.count for blocks in self.blocks.values())


def store(folder: Path) -> Store:
    """Return the store of a backup."""
    return Store(str((folder / "store").absolute()))


def described(path: Path) -> File:
    """Return what the manifest says of a file."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return File(name=path.name, size=path.stat().st_size, sha256=digest)


def write(folder: Path, manifest: Manifest) -> None:
    """Write the manifest, whole or not at all; it survives a power failure."""
    passing = folder / f".{FILE}"
    with open(passing, "w", opener=private.opener) as file:
        file.write(manifest.model_dump_json(indent=1) + "\n")
    # What is copied is not waited for one by one.
    os.sync()
    passing.replace(folder / FILE)
    os.sync()


def read(folder: Path) -> Manifest:
    """Return the manifest of a finished backup, whose files beside the store are checked.

    Raises
    ------
    BackupInvalidError
        Where there is none, or one of these files is damaged.
    """
    try:
        text = (folder / FILE).read_text()
    except FileNotFoundError:
        raise BackupInvalidError(
            f"there is no finished backup in {folder}; `vibroimpact backup` with the same folder "
            "continues one that was interrupted"
        ) from None
    try:
        manifest = Manifest.model_validate_json(text)
    except ValidationError as error:
        raise BackupInvalidError(f"{folder / FILE} is damaged, or of another version") from error
    for expected in (manifest.records, manifest.listing):
        try:
            there = described(folder / expected.name)
        except FileNotFoundError:
            raise BackupInvalidError(f"{folder / expected.name} is missing") from None
        if there != expected:
            raise BackupInvalidError(f"{folder / expected.name} is damaged")
    return manifest


def write_listing(path: Path, blocks: Iterable[Block]) -> None:
    """Write the names of the blocks of a backup to a new file."""
    with (
        open(path, "wb", opener=private.opener) as file,
        zstandard.ZstdCompressor().stream_writer(file) as lines,
    ):
        for block in blocks:
            lines.write(json.dumps(block).encode() + b"\n")


def listed(folder: Path, manifest: Manifest) -> Iterator[Block]:
    """Yield the blocks of a backup."""
    text = zstandard.ZstdDecompressor().stream_reader((folder / manifest.listing.name).open("rb"))
    with text as reader:
        for line in reader.read().splitlines():
            yield Block(*json.loads(line))
