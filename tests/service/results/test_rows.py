"""Arrays in files: what is written is what was appended and patched, and makes equal containers."""

from __future__ import annotations

import errno
import os
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from vibroimpact_service.results import container
from vibroimpact_service.results.rows import RowFiles
from vibroimpact_service.store import Store, StoreFullError, StoreUnavailableError


def test_rows_grow_and_can_be_replaced(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    pieces = [rng.standard_normal((size, 3)) for size in (4, 0, 7)]
    stops = [np.array([1.0, np.nan]), np.array([3.0])]
    with closing(RowFiles(tmp_path)) as rows:
        for piece in pieces:
            rows.append("x", piece)
        rows.append("stop", stops[0])
        rows.patch("stop", 1, 2.0)
        rows.append("stop", stops[1])
        rows.append("index", np.arange(5))
        with pytest.raises(IndexError, match="3 rows"):
            rows.patch("stop", 3, 0.0)
        with pytest.raises(ValueError, match="differ"):
            rows.append("x", np.zeros((2, 4)))
    expected = {
        "x": np.concatenate(pieces), "stop": np.array([1.0, 2.0, 3.0]), "index": np.arange(5),
    }  # fmt: skip
    path = tmp_path / "container"
    with path.open("wb") as file:
        container.write(file, rows.arrays, {"a": [1]})
    assert path.read_bytes() == container.pack(expected, {"a": [1]})


def test_a_store_takes_files_and_gives_room_for_them(tmp_path: Path) -> None:
    for url in (str(tmp_path / "store"), "memory://windows"):
        store = Store(url).results
        with store.workspace() as folder:
            (folder / "whole").write_bytes(b"x" * 3_000_000)
            store.put_file("ab" * 32, folder / "whole")
            if store.local:
                assert folder.parent == tmp_path / "store" / "results"
        assert not folder.exists()
        assert store.get("ab" * 32) == b"x" * 3_000_000
        assert [entry.name for entry in store.entries()] == ["ab" * 32]


def test_a_full_disk_passes(tmp_path: Path) -> None:
    store = Store(str(tmp_path)).results
    with pytest.raises(StoreFullError), store.workspace():
        raise OSError(errno.ENOSPC, "no space")
    with pytest.raises(StoreUnavailableError, match="not allowed"), store.workspace():
        raise PermissionError(errno.EPERM, "not allowed")
    with pytest.raises(ZeroDivisionError), store.workspace():
        raise ZeroDivisionError


def test_what_dead_writers_left_is_removed(tmp_path: Path) -> None:
    store = Store(str(tmp_path)).results
    left = tmp_path / "results" / ".left"
    left.mkdir(parents=True)
    (left / "x-rows").write_bytes(b"1")
    store.remove_leftovers(time.time())
    assert left.exists()
    os.utime(left, (0.0, 0.0))
    store.remove_leftovers(time.time())
    assert left.exists()  # a file in it is still written to
    os.utime(left / "x-rows", (0.0, 0.0))
    os.utime(left, (0.0, 0.0))
    store.remove_leftovers(time.time())
    assert not left.exists()
