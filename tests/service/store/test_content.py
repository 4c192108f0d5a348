"""The content store: whole blocks or none, damage noticed, a full disk said plainly."""

from __future__ import annotations

import errno
import hashlib
import os
from pathlib import Path

import pytest

from vibroimpact_service.store import ContentStore, Store, StoreFullError

NAME = "ab" * 32


def test_blocks_come_back(tmp_path: Path) -> None:
    store = Store(str(tmp_path)).results
    assert store.get(NAME) is None
    assert not store.has(NAME)
    store.put(NAME, b"block")
    store.put(f"{NAME}.json", b"other")
    assert store.has(NAME)
    assert store.get(NAME) == b"block"
    assert store.get(f"{NAME}.json") == b"other"
    store.remove(NAME)
    store.remove(NAME)
    assert store.get(NAME) is None


def test_a_damaged_block_is_removed(tmp_path: Path) -> None:
    store = Store(str(tmp_path)).results
    store.put(NAME, b"block")
    (file,) = [path for path in tmp_path.rglob("*") if path.is_file()]
    content = bytearray(file.read_bytes())
    content[-1] ^= 1
    file.write_bytes(content)
    assert store.get(NAME) is None
    assert not file.exists()


def test_blocks_live_in_any_filesystem() -> None:
    store = Store("memory://somewhere").results
    store.put(NAME, b"block")
    assert store.has(NAME)
    assert store.get(NAME) == b"block"
    store.remove(NAME)
    assert store.get(NAME) is None


@pytest.mark.parametrize("name", ["../../etc/passwd", "a/b", "", "A" * 64, "x" * 200])
def test_names_cannot_leave_the_store(tmp_path: Path, name: str) -> None:
    with pytest.raises(ValueError, match="not a name"):
        Store(str(tmp_path)).results.get(name)


def test_a_full_disk_is_said_plainly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(handle: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StoreFullError):
        Store(str(tmp_path)).results.put(NAME, b"block")
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_what_writers_that_died_left_goes_after_an_hour(tmp_path: Path) -> None:
    store = Store(str(tmp_path)).results
    store.put(NAME, b"block")
    (block,) = [path for path in tmp_path.rglob("*") if path.is_file()]
    area = block.parent.parent
    now = block.stat().st_mtime
    left = {}
    for name, age in (("old", 4000.0), ("new", 3000.0)):
        file, folder = block.parent / f".{name}", area / f".{name}"
        folder.mkdir()
        left[name] = [file, folder / "part"]
        for path in left[name]:
            path.write_bytes(b"half of it")
        for path in (*left[name], folder):
            os.utime(path, (now - age, now - age))
    # A folder is in use as long as one of its files is written.
    os.utime(area / ".new", (now - 4000.0, now - 4000.0))
    store.remove_leftovers(now)
    assert not any(path.exists() for path in (*left["old"], area / ".old"))
    assert all(path.exists() for path in left["new"])
    assert store.get(NAME) == b"block"


def test_blocks_are_copied_with_their_hash(tmp_path: Path) -> None:
    source, target = (ContentStore(str(tmp_path / name), "results") for name in "ab")
    data = os.urandom(3_000_000)
    source.put("ab" * 32, data)
    source.put("cd" * 32, b"damaged")
    (path,) = (tmp_path / "a").glob(f"*/*/{'cd' * 32}")
    path.write_bytes(path.read_bytes()[:-1])
    assert source.copy("ab" * 32, target) == hashlib.sha256(data).digest()
    assert target.get("ab" * 32) == data
    assert source.digest("ab" * 32) == target.digest("ab" * 32) == hashlib.sha256(data).digest()
    for name in ("cd" * 32, "ef" * 32):
        assert source.copy(name, target) is None
        assert target.digest(name) is None
    assert [entry.name for entry in target.entries()] == ["ab" * 32]
