"""A full disk: requests are refused with the reason, and no job is lost."""

from __future__ import annotations

import contextlib
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from processes import Record, Replica, until
from users import User, sweep, tiny


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """Return a folder on a file system of 8 MB."""
    folder = tmp_path / "small"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", str(folder)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("mounting a file system is not permitted here")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


def test_a_full_disk(
    started: Callable[[Any], Any], tmp_path: Path, record: Record, small_disk: Path
) -> None:
    replica = started(Replica(tmp_path / "a", record, store=str(small_disk)))
    until(replica.ready, "no workers")
    user = User([replica])
    user.submit(sweep(0.6), *(tiny(0.7 + i / 100) for i in range(5)))
    until(record.begun, "nothing begins")
    filler = small_disk / "filler"
    with filler.open("wb", buffering=0) as file, contextlib.suppress(OSError):
        while True:
            file.write(bytes(4096))
    body = {"kind": "impact-modes", "request": tiny(1.0)}
    refused = replica.http.post("/v1/jobs", json=body)
    assert (refused.status_code, refused.json()["code"]) == (507, "store_full")
    assert refused.json()["retryable"]
    assert int(refused.headers["Retry-After"]) > 0
    until(lambda: not replica.ready(), "it is ready without room")

    def delayed() -> bool:
        jobs = replica.http.get("/v1/jobs").json()["jobs"]
        return any("full" in (job["waiting_reason"] or "") for job in jobs)

    until(delayed, "no job says that the disk is full")
    time.sleep(1.0)
    filler.unlink()
    moment = time.time()
    user.submit(tiny(1.0))
    accepted = time.time() - moment
    until(lambda: not delayed(), "the jobs still wait")
    seconds = [round(accepted, 2), round(time.time() - moment, 2)]
    print("seconds until jobs are accepted again, and until none waits:", seconds)
    user.check()
    # What failed on the full disk was begun again, but not what had been stored before.
    record.check()


def test_jobs_are_cancelled_on_a_full_disk(
    started: Callable[[Any], Any], record: Record, small_disk: Path
) -> None:
    """The database is on it, as the whole data folder is."""
    replica = started(Replica(small_disk / "data", record))
    until(replica.ready, "no workers")
    bodies = [{"kind": "impact-modes", "request": sweep(f)} for f in (0.6, 0.7, 0.8)]
    jobs = [replica.http.post("/v1/jobs", json=body).json()["id"] for body in bodies]
    until(record.begun, "nothing begins")
    filler = small_disk / "filler"
    with filler.open("wb", buffering=0) as file, contextlib.suppress(OSError):
        while True:
            file.write(bytes(4096))
    for job in jobs:
        ended = replica.http.delete(f"/v1/jobs/{job}")
        assert (ended.status_code, ended.json()["state"]) == (200, "cancelled"), ended.text
    filler.unlink()
    until(replica.ready, "it is not ready though there is room")
    for job in jobs:
        assert replica.http.get(f"/v1/jobs/{job}").json()["state"] == "cancelled"
