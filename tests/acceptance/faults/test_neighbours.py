"""Workers that stand still or are killed again and again, and stores that do not work."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
from processes import Record, Replica, until
from shared import Machine
from users import User, history, sweep, tiny


def test_a_worker_that_stands_still(
    started: Callable[[Any], Any], tmp_path: Path, record: Record, machine: Machine
) -> None:
    replica = started(Replica(tmp_path / "data", record, workers="2"))
    until(replica.ready, "no workers")
    user = User([replica])
    user.submit(sweep(0.6), sweep(0.61))
    stopped = until(lambda: record.begun()[-1:], "nothing begins")[0]
    begun = [b for b in record.begun() if b.pid == stopped.pid]
    moment = time.time()
    os.kill(stopped.pid, signal.SIGSTOP)
    again = until(lambda: repeated(record, begun, stopped.pid, moment), "no chunk is repeated")
    print("seconds from a worker's stop to its chunk elsewhere:", round(again.time - moment, 2))
    assert machine.seconds(moment, again.time) <= 20.0
    user.check()
    # It cannot come back and go on: it was killed.
    with pytest.raises(ProcessLookupError):
        os.kill(stopped.pid, signal.SIGCONT)
    record.check()
    first = next(iter(user.accepted.values()))[0]
    job = replica.http.get(f"/v1/jobs/{first}").json()
    assert any("stood still" in (each["why"] or "") for each in job["history"])


def repeated(record: Record, begun: list[Any], stopped: int, moment: float) -> Any:
    """Return a chunk that another worker began again."""
    chunks = {(b.result, b.index) for b in begun}
    later = (b for b in record.begun() if b.time > moment and b.pid != stopped)
    return next((b for b in later if (b.result, b.index) in chunks), None)


def test_the_forkserver_and_all_workers_are_killed(
    started: Callable[[Any], Any], tmp_path: Path, record: Record, machine: Machine
) -> None:
    replica = started(Replica(tmp_path / "data", record))
    until(replica.ready, "no workers")
    user = User([replica])
    user.submit(sweep(0.6), *(tiny(0.7 + i / 100) for i in range(5)))
    worker = until(lambda: record.begun()[-1:], "nothing begins")[0].pid
    forkserver = int(Path(f"/proc/{worker}/stat").read_text().rpartition(")")[2].split()[1])
    moment = time.time()
    for process in (forkserver, worker):
        os.kill(process, signal.SIGKILL)
    again = until(lambda: record.after(moment, worker), "no other worker")
    used = machine.seconds(moment, again.time)
    print("seconds from the death of forkserver and workers to a chunk:", round(used, 2))
    user.check()
    record.check()
    assert used <= 15.0


def test_many_deaths_are_not_the_fault_of_a_history(
    started: Callable[[Any], Any], tmp_path: Path, record: Record
) -> None:
    replica = started(Replica(tmp_path / "data", record))
    until(replica.ready, "no workers")
    user = User([replica], kind="time-history")
    user.submit(history())
    for _ in range(7):
        last = until(lambda: record.begun()[-1:], "nothing begins")[0]
        os.kill(last.pid, signal.SIGKILL)
        until(lambda p=last.pid, t=last.time: record.after(t, p), "no other worker")
    job = next(iter(user.accepted.values()))[0]
    # The first history of a checkout compiles its kernels in the worker.
    done = until(lambda: user.final(job), "it does not end", 300.0)
    assert done["state"] == "succeeded", done["error"]
    killed = [each for each in done["history"] if "SIGKILL" in (each["why"] or "")]
    assert len(killed) >= 7
    assert done["attempts"] == 1  # none of the deaths was its own
    record.check()


def test_a_store_that_takes_no_writes_for_a_while(
    started: Callable[[Any], Any], tmp_path: Path, record: Record
) -> None:
    store = tmp_path / "store"
    store.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64m", "tmpfs", str(store)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("mounting a file system is not permitted here")
    try:
        replica = started(Replica(tmp_path / "a", record, store=str(store)))
        until(replica.ready, "no workers")
        user = User([replica])
        user.submit(sweep(0.6), *(tiny(0.7 + i / 100) for i in range(5)))
        until(record.begun, "nothing begins")
        remount(store, "ro")
        until(lambda: "Read-only".lower() in reasons(replica), "no job says why it waits")
        answer = replica.http.get("/v1/health/ready")
        assert answer.status_code == 503
        assert "store" in answer.json()["detail"]
        body = {"kind": "impact-modes", "request": tiny(1.0)}
        refused = replica.http.post("/v1/jobs", json=body)
        assert refused.status_code in (503, 507)
        assert int(refused.headers["Retry-After"]) > 0
        time.sleep(3.0)
        remount(store, "rw")
        moment = time.time()
        user.submit(tiny(1.0))
        until(replica.ready, "not ready")
        print("seconds until jobs are accepted again:", round(time.time() - moment, 2))
        user.check()
        record.check()
    finally:
        subprocess.run(["umount", "-l", str(store)], check=True)


def remount(folder: Path, how: str) -> None:
    """Change whether a file system takes writes; one that is busy takes some attempts."""
    command = ["mount", "-o", f"remount,{how}", str(folder)]
    until(lambda: subprocess.run(command, capture_output=True, check=False).returncode == 0, how)


def reasons(replica: Replica) -> str:
    """Return why the jobs of a service wait."""
    jobs = replica.http.get("/v1/jobs").json()["jobs"]
    return " ".join(job["waiting_reason"] or "" for job in jobs).lower()


def test_any_number_of_damaged_chunks(
    started: Callable[[Any], Any], tmp_path: Path, record: Record
) -> None:
    replica = started(Replica(tmp_path / "data", record))
    until(replica.ready, "no workers")
    user = User([replica])
    user.submit(sweep(0.6))
    chunks = tmp_path / "data" / "store" / "chunks"
    damaged: set[Path] = set()
    while len(damaged) < 8:
        for path in set(chunks.glob("*/[0-9a-z]*")) - damaged:
            path.write_bytes(path.read_bytes()[:-3])
            damaged.add(path)
        time.sleep(0.05)
    user.check()
    job = next(iter(user.accepted.values()))[0]
    ended = replica.http.get(f"/v1/jobs/{job}").json()
    assert ended["attempts"] == 1
    began, end = (datetime.fromisoformat(ended[key]) for key in ("started", "finished"))
    print("seconds of a job with", len(damaged), "damaged chunks:", (end - began).total_seconds())
    # The result too, and all that it could be put together from; its JSON is in memory.
    for path in (tmp_path / "data" / "store").glob("*/*/*"):
        if path.parents[1].name != "requests":
            path.write_bytes(path.read_bytes()[:-3])
    moment = time.time()
    files = {"Accept": "application/x-hdf5"}
    user.ask("GET", ended["result"], headers=files).raise_for_status()
    print("seconds until a damaged result is there again:", round(time.time() - moment, 2))
    user.check()


def test_the_end_of_the_service_during_a_computation(
    started: Callable[[Any], Any], tmp_path: Path, record: Record
) -> None:
    import threading

    replica = started(Replica(tmp_path / "data", record, inline_seconds="60"))
    until(replica.ready, "no workers")
    statuses: list[Any] = []

    def compute(number: int) -> None:
        content = sweep(0.6 + number / 1000, 400_000)
        # As JSON so large a result is refused by its plan.
        headers = {"Accept": "application/x-hdf5"}
        answer = replica.http.post(
            "/v1/compute/impact-modes", json=content, headers=headers, timeout=60
        )
        statuses.append(
            (answer.status_code, answer.headers.get("retry-after"), answer.content[:200])
        )

    asking = [threading.Thread(target=compute, args=(i,)) for i in range(6)]
    for thread in asking:
        thread.start()
    time.sleep(1.0)
    moment = time.time()
    replica.process.send_signal(signal.SIGTERM)
    replica.process.wait(40)
    print("seconds to the end of the process:", round(time.time() - moment, 2))
    for thread in asking:
        thread.join(60)
    print("answers:", sorted((status, after) for status, after, _ in statuses))
    assert len(statuses) == 6
    assert all(status in (200, 202) or (status == 503 and after) for status, after, _ in statuses)
