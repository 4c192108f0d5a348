"""A store whose file system does not work for a while, and blocks that it damaged."""

from __future__ import annotations

import builtins
import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from vibroimpact_service import problems
from vibroimpact_service.documents import stored_systems
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store, StoreFullError, StoreUnavailableError

NAME = "ab" * 32
ERRORS = (errno.EROFS, errno.EIO, errno.ESTALE, errno.EMFILE, errno.EACCES)


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(str(tmp_path / "store"))


@pytest.fixture
def fail(monkeypatch: pytest.MonkeyPatch, store: Store) -> Callable[[int], None]:
    """Return the function that makes all files of the store fail with an error number."""

    def failing(number: int) -> None:
        def refuse(original: Callable[..., Any]) -> Callable[..., Any]:
            def refused(path: Any, *args: Any, **more: Any) -> Any:
                if str(path).startswith(store.url):
                    raise OSError(number, os.strerror(number), path)
                return original(path, *args, **more)

            return refused

        for module, name in ((builtins, "open"), (os, "rename"), (os, "unlink"), (os, "utime")):
            monkeypatch.setattr(module, name, refuse(getattr(module, name)))
        monkeypatch.setattr(Path, "stat", refuse(Path.stat))

    return failing


@pytest.mark.parametrize("number", ERRORS)
def test_errors_of_the_file_system_are_not_the_fault_of_a_job(
    store: Store, fail: Callable[[int], None], number: int
) -> None:
    store.chunks.put(NAME, b"sound")
    fail(number)
    for operation in (
        lambda: store.chunks.put(NAME, b"other"),
        lambda: store.chunks.get(NAME),
        lambda: store.chunks.readable(NAME),
        lambda: store.chunks.remove(NAME),
    ):
        with pytest.raises(StoreUnavailableError) as error:
            operation()
        assert error.value.errno == number
        assert os.strerror(number).lower() in str(error.value.strerror)
        problem = problems.of(error.value)
        assert problem.type.status == 503
        assert int(problem.headers["Retry-After"]) > 0
    store.chunks.touch(NAME)  # it does not matter


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_store_says_when_to_ask_again(
    store: Store, fail: Callable[[int], None], number: int
) -> None:
    fail(number)
    with pytest.raises(StoreFullError) as error:
        store.results.put(NAME, b"data")
    problem = problems.of(error.value)
    assert problem.type.status == 507
    assert int(problem.headers["Retry-After"]) > 0


def test_only_undamaged_blocks_count(store: Store) -> None:
    names = [f"{i:064x}" for i in range(5)]
    for name in names:
        store.chunks.put(name, b"chunk " + name.encode())
    for name in names[1:4]:
        path = Path(store.url) / "chunks" / name[:2] / name
        path.write_bytes(path.read_bytes()[:-1])
    assert store.chunks.sound([*names, NAME]) == {names[0], names[4]}


def test_a_damaged_system_that_is_posted_again_is_stored_again(
    store: Store, tmp_path: Path
) -> None:
    settings = Settings(data=tmp_path)
    body = b'{"M": [[1]], "K": [[2]], "constraints": [{"dof": 0, "gap": 1}]}'

    def post() -> tuple[str, bool]:
        stored, new = stored_systems.put(store, settings, "ann", stored_systems.JSON, body)
        return stored.id, new

    name, new = post()
    assert new
    assert post() == (name, False)
    path = next((Path(store.url) / "systems").glob("*/*"))
    path.write_bytes(path.read_bytes()[:40])
    assert post() == (name, True)
    assert store.systems.get(name) is not None
