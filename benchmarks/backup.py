"""Time and size of backups: ``python -m benchmarks.backup`` with 10,000 jobs, each with a result.

Blocks are of random bytes: results hold digits that hardly compress.
"""

from __future__ import annotations

import argparse
import os
import shutil
import tempfile
import time
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from vibroimpact_service.jobs import records
from vibroimpact_service.jobs.database import open_database
from vibroimpact_service.jobs.records import NewJob
from vibroimpact_service.operations import backup, restore
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store

Value = TypeVar("Value")


def main() -> None:
    """Fill an installation, back it up twice, verify and restore it; print times and sizes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=10_000)
    parser.add_argument("--size", type=int, default=20_000, help="bytes of a result")
    chosen = parser.parse_args()
    place = Path(tempfile.mkdtemp(prefix="vibroimpact-backup-"))
    try:
        source, target = Settings(data=place / "source"), Settings(data=place / "target")
        _fill(source, chosen.jobs, chosen.size)
        folder = place / "backup"
        written = _timed("backup", lambda: backup.write(source, folder, _silent))
        _timed("again", lambda: backup.write(source, folder, _silent))
        _timed("verify", lambda: restore.verify(folder, _silent))
        _timed("restore", lambda: restore.restore(target, folder, _silent, replace=False))
        content = written.manifest
        print(f"jobs     {content.rows['jobs']}")
        print(f"files    {content.count}")
        print(
            f"size     {content.size / 1e6:.1f} MB, of it records {content.records.size / 1e6:.1f}"
        )
    finally:
        shutil.rmtree(place)


def _fill(settings: Settings, jobs: int, size: int) -> None:
    store, database = Store(settings.store_url), open_database(settings.database_url)
    with database.begin() as connection:
        for _ in range(jobs):
            request, result = uuid.uuid4().hex * 2, uuid.uuid4().hex * 2
            name = f"job_{uuid.uuid4().hex}"
            new = NewJob(
                name, "ann", "impact-modes", request, result, 0, 0.5, True, block=os.urandom(400)
            )
            records.insert(connection, new)
            store.results.put(result, os.urandom(size), durable=False)
    database.dispose()


def _timed(name: str, action: Callable[[], Value]) -> Value:
    began = time.perf_counter()
    value = action()
    print(f"{name:8} {time.perf_counter() - began:.1f} s")
    return value


def _silent(_: int) -> Callable[[int], None]:
    return lambda _: None


if __name__ == "__main__":
    main()
