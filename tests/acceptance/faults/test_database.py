"""A database that does not answer: frozen transactions, dropped connections, no writes."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx2
import psycopg
import pytest
from processes import Record, Replica, until
from proxy import Proxy
from shared import Machine
from users import User, sweep, tiny

LIMIT = 15.0
"""Seconds within which the service works again, by the clock of the fixture `machine`."""


@pytest.fixture
def proxied() -> Iterator[Callable[..., Proxy]]:
    """Return the function that makes a proxy before a server."""
    proxies: list[Proxy] = []

    def make(*arguments: Any) -> Proxy:
        proxies.append(Proxy(*arguments))
        return proxies[-1]

    yield make
    for each in proxies:
        each.close()


def submitted(replica: Replica, content: dict[str, Any]) -> bool:
    """Whether a job is accepted within the time that a client waits for an answer."""
    answer = replica.http.post("/v1/jobs", json={"kind": "impact-modes", "request": content})
    assert answer.status_code in (201, 503), answer.text
    assert answer.status_code == 201 or answer.headers["Retry-After"]
    return bool(answer.is_success)


def test_a_replica_frozen_in_a_transaction(
    started: Callable[[Any], Any],
    tmp_path: Path,
    record: Record,
    postgresql: Callable[[], str],
    proxied: Callable[..., Proxy],
    machine: Machine,
) -> None:
    database, store = postgresql(), str(tmp_path / "store")
    frozen: list[int] = []

    def freeze(sent: bytes) -> None:
        if b"INSERT INTO requests" in sent and frozen:
            os.kill(frozen[0], signal.SIGSTOP)

    behind = proxied(database, freeze).url
    one = started(Replica(tmp_path / "a", record, database=behind, store=store))
    other = started(Replica(tmp_path / "b", record, database=database, store=store))
    for replica in (one, other):
        until(replica.ready, "no workers")
    user = User([other])
    frozen.append(one.process.pid)
    body = {"kind": "impact-modes", "request": sweep(0.6)}
    moment = time.time()
    try:
        with pytest.raises(httpx2.ReadTimeout):
            one.http.post("/v1/jobs", json=body, timeout=1)
        user.submit(sweep(0.6))
        user.submit(*(tiny(0.7 + i / 100) for i in range(3)))
        seconds = machine.seconds(moment, time.time())
        user.check()
    finally:
        os.kill(one.process.pid, signal.SIGCONT)
    print("seconds until the other replica writes again:", round(seconds, 2))
    assert seconds <= LIMIT
    frozen.clear()
    until(lambda: submitted(one, tiny(0.9)), "the thawed replica does not accept jobs")


def test_dropped_connections(
    started: Callable[[Any], Any],
    tmp_path: Path,
    record: Record,
    postgresql: Callable[[], str],
    proxied: Callable[..., Proxy],
    machine: Machine,
) -> None:
    proxy = proxied(postgresql())
    replica = started(Replica(tmp_path / "a", record, database=proxy.url))
    until(replica.ready, "no workers")
    user = User([replica])
    user.submit(sweep(0.6), *(tiny(0.7 + i / 100) for i in range(5)))
    seconds = []
    for round_ in range(2):
        until(record.begun, "nothing begins")
        proxy.drop()
        moment = time.time()
        user.submit(tiny(0.9 + round_ / 100))
        seconds.append(machine.seconds(moment, time.time()))
    print("seconds from dropped connections to an accepted job:", [round(s, 2) for s in seconds])
    user.check()
    record.check()
    assert max(seconds) <= LIMIT


def test_a_replica_that_is_cut_off_says_so_at_once(
    started: Callable[[Any], Any],
    tmp_path: Path,
    record: Record,
    postgresql: Callable[[], str],
    proxied: Callable[..., Proxy],
    machine: Machine,
) -> None:
    """One request learns it; the others can go to another replica without waiting."""
    proxy = proxied(postgresql())
    replica = started(Replica(tmp_path / "a", record, database=proxy.url))
    until(replica.ready, "no workers")
    assert submitted(replica, tiny(0.6))
    proxy.cut = True
    proxy.drop()
    moment = time.time()
    assert not submitted(replica, tiny(0.7))
    learned = machine.seconds(moment, time.time())
    waited = []
    for i in range(20):
        moment = time.time()
        assert not submitted(replica, tiny(0.8 + i / 100))
        waited.append(machine.seconds(moment, time.time()))
    proxy.cut = False
    moment = time.time()
    until(lambda: submitted(replica, tiny(0.61)), "no job is accepted")
    seconds = machine.seconds(moment, time.time())
    usual = sorted(waited)[len(waited) // 2]
    print(
        f"seconds until silence is learned {learned:.1f}, then an answer in {usual:.2f} and at "
        f"most {max(waited):.1f}, back after {seconds:.1f}"
    )
    assert usual < 1.0
    assert max(learned, *waited, seconds) <= LIMIT
    record.check()


def test_a_database_that_takes_no_writes(
    started: Callable[[Any], Any],
    tmp_path: Path,
    record: Record,
    postgresql: Callable[[], str],
    machine: Machine,
) -> None:
    database = postgresql()
    name = database.rsplit("/", 1)[1]
    replica = started(Replica(tmp_path / "a", record, database=database))
    until(replica.ready, "no workers")
    user = User([replica])
    user.submit(sweep(0.6))
    until(record.begun, "nothing begins")
    with psycopg.connect(database, autocommit=True) as connection:
        connection.execute(f"ALTER DATABASE {name} SET default_transaction_read_only = on")
        connection.execute(
            "SELECT pg_terminate_backend(pid) FROM pg_stat_activity"
            " WHERE datname = current_database() AND pid <> pg_backend_pid()"
        )
        for each in (tiny(0.7), tiny(0.8)):
            body = {"kind": "impact-modes", "request": each}
            refused = replica.http.post("/v1/jobs", json=body)
            assert refused.status_code == 503, refused.text
            assert int(refused.headers["Retry-After"]) > 0
        # Readiness writes, once a second at most.
        until(lambda: not replica.ready(), "it is ready without writing")
        connection.execute("SET default_transaction_read_only = off")
        connection.execute(f"ALTER DATABASE {name} RESET default_transaction_read_only")
    moment = time.time()
    until(lambda: submitted(replica, tiny(0.9)), "no job is accepted")
    seconds = machine.seconds(moment, time.time())
    print("seconds from the end of a failover to an accepted job:", round(seconds, 2))
    until(replica.ready, "not ready")
    assert seconds <= LIMIT
    done = user.final(next(iter(user.accepted.values()))[0])
    assert done is None or done["state"] == "succeeded"
