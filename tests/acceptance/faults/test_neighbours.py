"""Workers that stand still or are killed again and again, and stores that do not work."""

from __future__ import annotations

import errno
import math
import os
import resource
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from processes import Record, Replica, children, forkservers, stat, until
from shared import Machine
from users import User, history, sweep, tiny

from tests.service.jobs.test_webhooks import SECRET, Receiver

MODES_HOLD = ("setpriv", "--bounding-set=-dac_override,-dac_read_search")
"""Begins a command that may not read what modes of files forbid, though its user is root."""
FILES = resource.RLIMIT_NOFILE


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
    jobs = [replica.http.get(f"/v1/jobs/{job}").json() for job, _ in user.accepted.values()]
    (struck,) = (job for job in jobs if job["digest"] == stopped.result)  # not always the first one
    assert any("stood still" in (each["why"] or "") for each in struck["history"]), struck


def used(replica: Replica) -> float:
    """Return the seconds of processor time that a service has used."""
    return sum(map(int, stat(replica.process.pid)[11:13])) / os.sysconf("SC_CLK_TCK")


def repeated(record: Record, begun: list[Any], stopped: int, moment: float) -> Any:
    """Return a chunk that another worker began again."""
    chunks = {(b.result, b.index) for b in begun}
    later = (b for b in record.begun() if b.time > moment and b.pid != stopped)
    return next((b for b in later if (b.result, b.index) in chunks), None)


def test_the_forkserver_and_all_workers_are_killed(
    started: Callable[[Any], Any], tmp_path: Path, record: Record, machine: Machine
) -> None:
    replica = started(Replica(tmp_path / "data", record, workers="2"))
    until(replica.ready, "no workers")
    user, starts = User([replica]), count(6100)
    user.submit(sweep(0.6), *(tiny(0.7 + i / 100) for i in range(5)))

    def at_work() -> tuple[int, list[int]] | None:
        """Return the forkserver and both workers, once these do something.

        There is always work: one of them may come when the other one has done all there was.
        """
        jobs = (user.ask("GET", f"/v1/jobs/{job}").json() for job, _ in user.accepted.values())
        if all(job["final"] for job in jobs):
            user.submit(sweep(next(starts) / 1e4))
        for forkserver in forkservers([replica]):
            workers = children(forkserver)
            if len(workers) == 2 and {b.pid for b in record.begun()}.issuperset(workers):
                return forkserver, workers
        return None

    seconds = []
    for _ in range(2):
        forkserver, workers = until(at_work, "a worker does nothing")
        moment = time.time()
        for process in (forkserver, *workers):
            with suppress(ProcessLookupError):  # as the others have died
                os.kill(process, signal.SIGKILL)
        again = until(lambda m=moment, w=workers: record.after(m, *w), "no other worker")
        seconds.append(machine.seconds(moment, again.time))
    shown = [round(s, 2) for s in seconds]
    print("seconds from the death of forkserver and workers to a chunk:", shown)
    user.check()
    record.check()
    assert min(seconds) <= 5.0
    assert max(seconds) <= 10.0  # a core that others share computes half as much in its time


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
        body = {"kind": "impact-modes", "request": sweep(0.65), "deadline_seconds": 8.0}
        late = replica.http.post("/v1/jobs", json=body).json()["id"]
        remount(store, "ro")
        until(lambda: "Read-only".lower() in reasons(replica), "no job says why it waits")
        # Readiness writes, once a second at most.
        until(lambda: not replica.ready(), "it is ready without writing")
        answer = replica.http.get("/v1/health/ready")
        assert answer.status_code == 503
        assert "store" in answer.json()["detail"]
        body = {"kind": "impact-modes", "request": tiny(1.0)}
        refused = replica.http.post("/v1/jobs", json=body)
        assert refused.status_code in (503, 507)
        assert int(refused.headers["Retry-After"]) > 0
        # What waits for the store waits until its deadline, and no longer.
        ended = until(lambda: user.final(late), "a job waits for ever")
        assert ended["state"] == "failed"
        assert ended["error"]["code"] == "deadline_passed", ended["error"]
        remount(store, "rw")
        moment = time.time()
        user.submit(tiny(1.0))
        until(replica.ready, "not ready")
        print("seconds until jobs are accepted again:", round(time.time() - moment, 2))
        user.check(late)
        record.check()
    finally:
        subprocess.run(["umount", "-l", str(store)], check=True)


@pytest.mark.parametrize("error", ["EIO", "ESTALE", "EMFILE", "EACCES"])
def test_a_store_whose_files_have_errors_for_a_while(
    started: Callable[[Any], Any], tmp_path: Path, record: Record, machine: Machine, error: str
) -> None:
    number, store = getattr(errno, error), tmp_path / "store"
    within = MODES_HOLD if error == "EACCES" and os.geteuid() == 0 else ()
    settings = {"store": str(store), "STORE_FAILS": str(store)}
    replica = started(Replica(tmp_path / "a", record, within, **settings))
    until(replica.ready, "no workers")
    user = User([replica])
    user.submit(tiny(0.69))
    user.check()
    # Of so many pieces that some are left when the errors begin.
    user.submit(sweep(0.6, 160_000), *(tiny(0.7 + i / 100) for i in range(3)))
    (stored, _), (job, _) = list(user.accepted.values())[:2]
    result = replica.http.get(f"/v1/jobs/{job}").json()["digest"]
    until(lambda: [note for note in record.noted() if note[:2] == ("stored", result)], "no chunk")
    with broken(number, store, replica):
        until(lambda: os.strerror(number).lower() in reasons(replica), "no job says why it waits")
        until(lambda: not replica.ready(), "it is ready without files")
        answer = replica.http.get("/v1/health/ready")
        assert answer.status_code == 503
        assert "store" in answer.json()["detail"]
        body = {"kind": "impact-modes", "request": tiny(1.0)}
        file = {"Accept": "application/x-hdf5"}  # its JSON is in memory
        for refused in (
            replica.http.post("/v1/jobs", json=body),
            replica.http.post("/v1/compute/impact-modes", json=tiny(1.1)),
            replica.http.get(f"/v1/jobs/{stored}/result", headers=file),
        ):
            assert refused.status_code in (503, 507), refused.text
            assert int(refused.headers["Retry-After"]) > 0
        waiting = replica.http.get(f"/v1/jobs/{job}").json()
        assert waiting["state"] in ("queued", "running")
        time.sleep(1.0)
    moment = time.time()
    user.submit(tiny(1.0))
    accepted = time.time()
    until(replica.ready, "not ready")
    until(lambda: not reasons(replica), "the jobs still wait")
    goes_on = time.time()
    seconds = [round(each - moment, 2) for each in (accepted, goes_on)]
    print(f"{error}: seconds until jobs are accepted again, and until none waits:", seconds)
    user.check()
    record.check()  # what had been stored before is not computed again
    assert machine.seconds(moment, accepted) <= 2.0
    assert machine.seconds(moment, goes_on) <= 15.0


@contextmanager
def broken(number: int, store: Path, replica: Replica) -> Iterator[None]:
    """Bring an error about at the files of a store; where it can be, by the system itself."""
    if number == errno.EACCES:
        store.chmod(0)
        yield
        store.chmod(0o700)
    elif number == errno.EMFILE:
        before = {each: resource.prlimit(each, FILES) for each in descendants(replica)}
        for each, (_, most) in before.items():
            resource.prlimit(each, FILES, (8, most))  # they have more open
        yield
        for each, limits in before.items():
            resource.prlimit(each, FILES, limits)
    else:
        error = Path(f"{store}.error")  # see the module failing
        error.write_text(str(number))
        yield
        error.unlink()


def descendants(replica: Replica) -> list[int]:
    """Return the processes of a service: itself, the forkserver, the workers."""
    found = [replica.process.pid]
    for each in found:
        found += children(each)
    return found


def remount(folder: Path, how: str) -> None:
    """Change whether a file system takes writes; one that is busy takes some attempts."""
    command = ["mount", "-o", f"remount,{how}", str(folder)]
    until(lambda: subprocess.run(command, capture_output=True, check=False).returncode == 0, how)


def reasons(replica: Replica) -> str:
    """Return why the jobs of a service wait."""
    jobs = replica.http.get("/v1/jobs").json()["jobs"]
    return " ".join(job["waiting_reason"] for job in jobs if job["waiting_reason"]).lower()


def test_the_end_of_the_service_beside_a_receiver_that_drips(
    started: Callable[[Any], Any], tmp_path: Path, record: Record, machine: Machine
) -> None:
    receiver = Receiver(tmp_path)
    receiver.drips = True
    try:
        settings = {"webhook_private": "true", "webhook_ca": str(receiver.authority)}
        replica = started(Replica(tmp_path / "data", record, **settings))
        until(replica.ready, "no workers")
        for i in range(12):
            body = {"kind": "impact-modes", "request": tiny(0.7 + i / 100)}
            body["webhook"] = {"url": receiver.url, "secret": SECRET}
            assert replica.http.post("/v1/jobs", json=body).status_code == 201
        until(lambda: receiver.got, "nothing is delivered")
        moment = time.time()
        replica.process.send_signal(signal.SIGTERM)
        replica.process.wait(60)
        taken = machine.seconds(moment, time.time())
        print("seconds to the end of the process:", round(taken, 2))
        assert taken <= 20.0
    finally:
        receiver.close()


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

    settings = {
        "inline_seconds": "60",
        "inline_overrun_seconds": "120",
        "inline_threads": "1",
        "max_waiting_seconds": "60",
    }

    def ask(replica: Replica, number: int) -> Any:
        content = sweep(0.6 + number / 1000, 2_000_000)
        # As JSON so large a result is refused by its plan.
        headers = {"Accept": "application/x-hdf5"}
        path = "/v1/compute/impact-modes"
        return replica.http.post(path, json=content, headers=headers, timeout=120)

    first = started(Replica(tmp_path / "first", record, **settings))
    until(first.ready, "no workers")
    assert ask(first, 100).status_code == 200  # it loads libraries
    before = used(first)
    assert ask(first, 0).status_code == 200
    # One after another, they last for longer than a service that ends waits for them, 8 s.
    count = max(6, math.ceil(20.0 / (used(first) - before)))
    first.end()

    more = {"max_waiting": str(count)}
    replica = started(Replica(tmp_path / "data", record, **settings, **more))
    until(replica.ready, "no workers")
    statuses: list[Any] = []

    def compute(number: int) -> None:
        answer = ask(replica, number)
        statuses.append(
            (answer.status_code, answer.headers.get("retry-after"), answer.content[:200])
        )

    def full() -> bool:
        """Whether all wait; or the first one was quicker than the last one came."""
        ready = replica.http.get("/v1/health/ready")
        return "overloaded" in ready.text or bool(statuses)

    asking = [threading.Thread(target=compute, args=(i,)) for i in range(count)]
    for thread in asking:
        thread.start()
    until(full, "the requests do not come")
    moment = time.time()
    replica.process.send_signal(signal.SIGTERM)
    replica.process.wait(40)
    print("seconds to the end of the process:", round(time.time() - moment, 2), "of", count)
    for thread in asking:
        thread.join(60)
    print("answers:", sorted((status, after) for status, after, _ in statuses))
    assert len(statuses) == count
    assert all(status in (200, 202) or (status == 503 and after) for status, after, _ in statuses)
    assert any(status == 503 for status, _, _ in statuses)
