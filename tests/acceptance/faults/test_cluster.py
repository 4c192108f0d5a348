"""Failures of replicas, scheduler, database and network, with several processes."""

from __future__ import annotations

import os
import random
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from processes import Process, Record, Replica, program, until
from shared import Machine
from users import User, sweep, tiny

from vibroimpact_service.jobs import certificates

TINY = [tiny(0.7 + i / 100) for i in range(10)]


def keys(folder: Path) -> dict[str, str]:
    """Write certificates and return the settings that name them."""
    ca, cert, key = certificates.write(folder, days=2)
    return {"tls_ca": str(ca), "tls_cert": str(cert), "tls_key": str(key)}


def environment(settings: dict[str, str]) -> dict[str, str]:
    return {f"VIBROIMPACT_{name.upper()}": value for name, value in settings.items()}


def test_a_killed_replica_of_two(
    started: Callable[[Any], Any],
    tmp_path: Path,
    record: Record,
    moments: random.Random,
    postgresql: Callable[[], str],
    machine: Machine,
) -> None:
    shared = {"database": postgresql(), "store": str(tmp_path / "store")}
    replicas = [started(Replica(tmp_path / name, record, **shared)) for name in "ab"]
    for replica in replicas:
        until(replica.ready, "no workers")
    user = User(replicas)
    user.submit(sweep(0.6), *TINY, sweep(0.61))
    until(record.begun, "nothing begins")
    time.sleep(moments.uniform(0.2, 1.5))
    moment = replicas[0].kill()
    user.submit(tiny(0.9))
    held = user.ask("GET", "/v1/jobs?state=running").json()["jobs"]
    taken = until(lambda: all_again(user, held) and time.time(), "jobs stay with the dead replica")
    seconds = machine.seconds(moment, taken)
    print("seconds from a replica's death to the take-over of its jobs:", round(seconds, 2))
    user.check()
    record.check()
    assert record.repeated() <= 2
    assert seconds <= 12.0


def all_again(user: User, held: list[dict[str, Any]]) -> bool:
    """Whether each of some jobs was taken up again, or is done."""
    now = [user.ask("GET", f"/v1/jobs/{job['id']}").json() for job in held]
    return all(
        new["final"] or new["attempts"] > old["attempts"] or new["progress"] != old["progress"]
        for new, old in zip(now, held, strict=True)
    )


def test_a_killed_scheduler(
    started: Callable[[Any], Any],
    tmp_path: Path,
    record: Record,
    moments: random.Random,
    postgresql: Callable[[], str],
    machine: Machine,
) -> None:
    address = "tls://127.0.0.1:" + str(free_port())
    tls = keys(tmp_path / "tls")
    shared = {"database": postgresql(), "store": str(tmp_path / "store"), "scheduler": address}

    def scheduler() -> Process:
        command = program("scheduler", "--port", address.rsplit(":", 1)[1])
        process: Process = started(Process(command, tmp_path / "scheduler", **environment(tls)))
        return process

    current = scheduler()
    started(
        Process(
            program("worker", address, "--workers", "1"),
            tmp_path / "worker",
            RECORD=str(record.path),
            **environment(tls),
        )
    )
    replica = started(Replica(tmp_path / "a", record, **shared, **tls))
    until(replica.ready, "no workers")
    user = User([replica])
    user.submit(sweep(0.6), *TINY)
    seconds = []
    for _ in range(2):
        before = len(record.begun())
        until(lambda b=before: len(record.begun()) > b, "nothing begins")
        time.sleep(moments.uniform(0.0, 0.6))
        moment = current.kill()
        before_it = {begun.pid for begun in record.begun()}
        current = scheduler()
        again = until(lambda m=moment, b=before_it: record.after(m, *b), "no other worker")
        seconds.append(machine.seconds(moment, again.time))
    print("seconds from a scheduler's death to the next chunk:", [round(s, 2) for s in seconds])
    user.check()
    record.check()
    assert record.repeated() <= 2 * 2
    assert max(seconds) <= 15.0


def test_killed_postgresql(
    started: Callable[[Any], Any],
    tmp_path: Path,
    record: Record,
    moments: random.Random,
    killable_postgresql: Any,
) -> None:
    replica = started(Replica(tmp_path / "a", record, database=killable_postgresql.new()))
    until(replica.ready, "no workers")
    user = User([replica])
    user.submit(sweep(0.6), *TINY)
    for round_ in range(3):
        time.sleep(moments.uniform(0.0, 1.0))
        killable_postgresql.kill()
        body = {"kind": "impact-modes", "request": tiny(1.0)}
        refused = replica.http.post("/v1/jobs", json=body)
        assert refused.status_code == 503
        assert refused.json()["retryable"]
        time.sleep(moments.uniform(0.0, 1.0))
        killable_postgresql.start()
        user.submit(tiny(0.9 + round_ / 100))
    user.check()
    record.check()
    assert record.repeated() == 0  # the workers need no database


def free_port() -> int:
    import socket

    with socket.socket() as free:
        free.bind(("0.0.0.0", 0))
        port: int = free.getsockname()[1]
        return port


@pytest.fixture
def elsewhere() -> Iterator[tuple[str, str]]:
    """Return a network namespace with one link to this one, and our address on it."""
    name, third = f"vi{os.getpid()}", os.getpid() % 250
    ours, theirs = f"10.213.{third}.1", f"10.213.{third}.2"
    commands = (
        f"ip netns add {name}",
        f"ip link add {name}a type veth peer name {name}b netns {name}",
        f"ip addr add {ours}/24 dev {name}a",
        f"ip link set {name}a up",
        f"ip -n {name} addr add {theirs}/24 dev {name}b",
        f"ip -n {name} link set {name}b up",
        f"ip -n {name} link set lo up",
    )
    try:
        for command in commands:
            if subprocess.run(command.split(), capture_output=True, check=False).returncode:
                pytest.skip(f"not permitted here: {command}")
        yield name, ours
    finally:
        subprocess.run(["ip", "netns", "del", name], capture_output=True, check=False)


def test_a_worker_whose_network_is_cut(
    started: Callable[[Any], Any],
    tmp_path: Path,
    record: Record,
    moments: random.Random,
    elsewhere: tuple[str, str],
) -> None:
    name, ours = elsewhere
    port = free_port()
    tls = keys(tmp_path / "tls")
    address = f"tls://{ours}:{port}"
    started(
        Process(
            program("scheduler", "--host", ours, "--port", str(port)),
            tmp_path / "scheduler",
            **environment(tls),
        )
    )
    for number, prefix in enumerate(([], ["ip", "netns", "exec", name])):
        started(
            Process(
                [*prefix, *program("worker", address, "--workers", "1")],
                tmp_path / f"worker{number}",
                RECORD=str(record.path),
                **environment(tls),
            )
        )
    replica = started(Replica(tmp_path / "a", record, scheduler=address, **tls))
    until(replica.ready, "no workers")
    user = User([replica])
    user.submit(sweep(0.6), sweep(0.61))
    until(lambda: len({b.pid for b in record.begun()}) == 2, "one worker does nothing")
    time.sleep(moments.uniform(0.0, 1.0))
    subprocess.run(["ip", "link", "set", f"{name}a", "down"], check=True)
    moment = time.time()
    user.check()
    print("seconds from the cut to the end of all jobs:", round(time.time() - moment, 2))
    # The worker goes on with its calls, two batches of eight chunks at most.
    record.check(unreachable=16)
