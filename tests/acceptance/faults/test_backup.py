"""Backups of services that work meanwhile, killed and continued, restored on another database."""

from __future__ import annotations

import json
import os
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from processes import Process, Record, Replica, program, until
from users import User, impulses, sweep, tiny

from vibroimpact_service.operations import migration
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store


class Load:
    """A user who submits jobs all the time, and notes when each was acknowledged."""

    def __init__(self, user: User) -> None:
        self.user, self.times = user, dict[str, float]()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        number = 0
        while not self._end.is_set():
            number += 1
            self.user.submit(tiny(0.5 + number / 10_000))
            self.times[f"key-{len(self.user.accepted) - 1}"] = time.time()
            time.sleep(0.02)

    def stop(self) -> None:
        self._end.set()
        self._thread.join()


def environment(folder: Path, database: str | None) -> dict[str, str]:
    given = {"VIBROIMPACT_DATA": str(folder)}
    return given | ({} if database is None else {"VIBROIMPACT_DATABASE": database})


def command(*arguments: str, **settings: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        program(*arguments), env={**os.environ, **settings}, capture_output=True, text=True,
        timeout=200, check=False,
    )  # fmt: skip


def files(folder: Path) -> int:
    """Return how many blocks a store holds, without those whose writer was interrupted."""
    return sum(not path.name.startswith(".") for path in folder.glob("store/*/*/*"))


def kill_in_the_midst(folder: Path, before: int, where: Path, settings: dict[str, str]) -> None:
    """Begin a backup and kill it while it copies the store."""
    process = Process(program("backup", str(folder)), where, **settings)
    try:
        until(lambda: files(folder) > before + 200 or process.process.poll() is not None, "no file")
        assert process.process.poll() is None, "it ended before it could be killed"
        process.kill()
    finally:
        process.end()


@pytest.mark.parametrize(("source", "target"), [("sqlite", "postgresql"), ("postgresql", "sqlite")])
def test_a_backup_under_load_that_is_killed(
    started: Callable[[Any], Any],
    tmp_path: Path,
    record: Record,
    postgresql: Callable[[], str],
    source: str,
    target: str,
) -> None:
    databases = {name: postgresql() if name == "postgresql" else None for name in (source, target)}

    def replica(name: str) -> Replica:
        given = databases[name]
        more = {} if given is None else {"database": given}
        one: Replica = started(Replica(tmp_path / name, record, **more))
        until(one.ready, "no workers")
        return one

    here = environment(tmp_path / source, databases[source])
    there = environment(tmp_path / target, databases[target])
    folder = tmp_path / "backup"
    first = replica(source)
    early = User([first])
    early.submit(sweep(0.6), *(tiny(0.7 + i / 100) for i in range(10)))
    # Many more files than are waited for, so that there is time to kill a backup.
    store = Store(str(tmp_path / source / "store"))
    for number in range(3000):
        store.results.put(f"{number:064x}", os.urandom(2000), durable=False)
    load = Load(early)
    until(lambda: len(load.times) > 20, "no job is accepted")
    kill_in_the_midst(folder, 0, tmp_path / "killed", here)
    copied = files(folder)
    refused = command("restore", str(folder), **there)
    assert refused.returncode == 1
    assert "there is no finished backup" in refused.stderr
    began = time.time()
    done = command("backup", str(folder), **here)
    assert done.returncode == 0, done.stderr
    content = json.loads((folder / "manifest.json").read_text())
    new = int(done.stdout.split("; ")[1].split()[0])
    print("files copied before the kill:", copied, "after it:", new)
    total = sum(area["count"] for area in content["blocks"].values())
    assert new <= total - copied * 0.9  # those that were under way when it was killed
    assert content["rows"]["jobs"] >= 11 + sum(at < began for at in load.times.values())
    # Another one, killed too, leaves the finished one as it is.
    store.results.put("f" * 64, os.urandom(2000))
    for number in range(3000, 5000):
        store.results.put(f"{number:064x}", os.urandom(2000), durable=False)
    kill_in_the_midst(folder, files(folder), tmp_path / "killed", here)
    load.stop()
    acknowledged = {key for key in early.accepted if load.times.get(key, 0.0) < began}
    assert len(acknowledged) > 30
    first.end()
    done = command("restore", str(folder), **there)
    assert done.returncode == 0, done.stderr
    print(done.stdout)
    second = replica(target)
    user = User([second])
    before = [early.accepted[key] for key in early.accepted if key in acknowledged]
    listed = [
        job
        for state in ("queued", "running")
        for job in second.http.get(f"/v1/jobs?state={state}&limit=500").json()["jobs"]
    ]
    for job, _ in before:
        assert until(lambda job=job: user.final(job), "a job does not end")["state"] == "succeeded"
    for job, content in [*before[:4], before[-1]]:
        check_numbers(user, job, content)
    for job in listed:
        ended = until(lambda job=job: user.final(job["id"]), "an unfinished job does not end")
        assert ended["state"] == "succeeded"
    print("jobs acknowledged before:", len(before), "unfinished:", len(listed))


def check_numbers(user: User, job: str, content: dict[str, Any]) -> None:
    """Check the numbers of a job."""
    done = user.final(job)
    assert done is not None
    answer = user.ask("GET", done["result"])
    np.testing.assert_array_equal(np.array(answer.json()["impulse"]), impulses(content))


def test_a_restoration_that_is_killed(tmp_path: Path, postgresql: Callable[[], str]) -> None:
    source = tmp_path / "source"
    migration.migrate(Settings(data=source))
    results = Store(str(source / "store")).results
    for number in range(3000):
        results.put(f"{number:064x}", os.urandom(2000), durable=False)
    folder, target = tmp_path / "backup", tmp_path / "target"
    assert command("backup", str(folder), "--data", str(source)).returncode == 0
    there = environment(target, postgresql())
    process = Process(program("restore", str(folder)), tmp_path / "killed", **there)
    until(lambda: files(target) > 200 or process.process.poll() is not None, "no file")
    assert process.process.poll() is None
    process.kill()
    process.end()
    copied = files(target)
    assert 200 < copied < 3000
    checked = command("migrate", "--check", **there)
    assert "jobs: revision none" in checked.stdout  # records come last, all at once
    done = command("restore", str(folder), **there)
    assert done.returncode == 0, done.stderr
    assert files(target) == 3000
    assert command("migrate", "--check", **there).returncode == 0
