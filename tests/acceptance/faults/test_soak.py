"""Faults of all kinds at random times, under the load of 20 clients who note what they were told.

``nox -s soak`` goes on for an hour; VIBROIMPACT_SOAK_SECONDS sets another time. What happened is
printed each minute.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import Any

import psycopg
import pytest
from clients import (
    CLIENTS,
    Client,
    check_jobs,
    check_results,
    check_sizes,
    own,
    size,
    tell,
)
from processes import Record, Replica, children, forkservers, until
from proxy import Proxy

SECONDS = float(os.environ.get("VIBROIMPACT_SOAK_SECONDS", "60"))


class Faults:
    """The faults, and the processes that they strike."""

    def __init__(self, replicas: list[Replica], proxy: Proxy, database: str, store: Path) -> None:
        self.replicas, self.proxy, self.database, self.store = replicas, proxy, database, store
        self.restart: Callable[[], Replica]
        self.mounted = False

    def kinds(self) -> list[Callable[[random.Random], None]]:
        """Return all kinds of faults."""
        return [
            self.kill_a_worker,
            self.stop_a_worker,
            self.kill_the_forkserver,
            self.kill_a_replica,
            self.freeze_a_replica,
            self.drop_connections,
            self.take_no_writes,
            self.damage_blocks,
            *([self.make_the_store_read_only] if self.mounted else []),
        ]

    def kill_a_worker(self, source: random.Random) -> None:
        self._signal(source, signal.SIGKILL)

    def stop_a_worker(self, source: random.Random) -> None:
        self._signal(source, signal.SIGSTOP)

    def _signal(self, source: random.Random, number: int) -> None:
        workers = [w for f in forkservers(self.replicas) for w in children(f)]
        if workers:
            with suppress(ProcessLookupError):
                os.kill(source.choice(workers), number)

    def kill_the_forkserver(self, source: random.Random) -> None:
        for forkserver in forkservers(self.replicas[1:]):
            for process in (forkserver, *children(forkserver)):
                with suppress(ProcessLookupError):
                    os.kill(process, signal.SIGKILL)

    def kill_a_replica(self, source: random.Random) -> None:
        self.replicas[1].kill()
        time.sleep(source.uniform(0.0, 2.0))
        self.replicas[1] = self.restart()

    def freeze_a_replica(self, source: random.Random) -> None:
        process = source.choice(self.replicas).process
        process.send_signal(signal.SIGSTOP)
        time.sleep(source.uniform(1.0, 12.0))
        process.send_signal(signal.SIGCONT)

    def drop_connections(self, source: random.Random) -> None:
        self.proxy.drop()

    def take_no_writes(self, source: random.Random) -> None:
        name = self.database.rsplit("/", 1)[1]
        with psycopg.connect(self.database, autocommit=True) as connection:
            connection.execute(f"ALTER DATABASE {name} SET default_transaction_read_only = on")
            connection.execute(
                "SELECT pg_terminate_backend(pid) FROM pg_stat_activity"
                " WHERE datname = current_database() AND pid <> pg_backend_pid()"
            )
            time.sleep(source.uniform(0.5, 4.0))
            connection.execute("SET default_transaction_read_only = off")
            connection.execute(f"ALTER DATABASE {name} RESET default_transaction_read_only")

    def make_the_store_read_only(self, source: random.Random) -> None:
        for how in ("ro", "rw"):
            command = ["mount", "-o", f"remount,bind,{how}", str(self.store)]
            end = time.monotonic() + 10.0
            # It is refused while a file is being written.
            while subprocess.run(command, capture_output=True, check=False).returncode:
                if how == "ro" and time.monotonic() > end:
                    return
            time.sleep(source.uniform(0.5, 6.0) if how == "ro" else 0.0)

    def damage_blocks(self, source: random.Random) -> None:
        blocks = [*self.store.glob("chunks/*/[0-9a-z]*"), *self.store.glob("results/*/[0-9a-z]*")]
        for block in source.sample(blocks, min(5, len(blocks))):
            with suppress(FileNotFoundError):
                # Over the file: a process that reads it at this moment sees other bytes.
                block.write_bytes(block.read_bytes()[:-1] + b"?")


@pytest.fixture
def opened() -> Iterator[ExitStack]:
    """Return a stack of what is closed after the test."""
    with ExitStack() as stack:
        yield stack


@pytest.fixture
def mounted(tmp_path: Path) -> Iterator[Path | None]:
    """Return a folder that is a mount of itself, None where that is not permitted."""
    folder = tmp_path / "store"
    folder.mkdir()
    mount = ["mount", "--bind", str(folder), str(folder)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        print("the store is never read-only: mounting is not permitted here")
        yield None
        return
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


@pytest.mark.timeout(SECONDS + 1800.0)
def test_soak(
    started: Callable[[Any], Any],
    tmp_path: Path,
    mounted: Path | None,
    record: Record,
    moments: random.Random,
    postgresql: Callable[[], str],
    opened: ExitStack,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("RECORD_SLEEP", "0.01")
    database, store = postgresql(), tmp_path / "store"
    proxy = opened.enter_context(closing(Proxy(database)))
    shared = {"database": proxy.url, "store": str(store), "max_unfinished_jobs": "100000"}
    replicas = [started(Replica(tmp_path / name, record, **shared)) for name in "ab"]
    for replica in replicas:
        until(replica.ready, "no workers")
    faults = Faults(replicas, proxy, database, store)
    faults.restart = lambda: started(Replica(tmp_path / "b", record, **shared))
    faults.mounted = mounted is not None

    def addresses() -> list[str]:
        return [str(replica.http.base_url).rstrip("/") for replica in replicas]

    clients = [Client(i, addresses, moments.randrange(10**6)) for i in range(CLIENTS)]
    for client in clients:
        opened.enter_context(client.http)
        client.thread.start()

    counts: Counter[str] = Counter()
    sizes: list[tuple[float, int]] = []
    queue: list[Callable[[random.Random], None]] = []
    began = told = time.monotonic()
    while time.monotonic() < began + SECONDS:
        time.sleep(moments.uniform(0.5, 8.0))
        if not queue:  # all kinds, each time in another order
            kinds = faults.kinds()
            queue = moments.sample(kinds, k=len(kinds))
        fault = queue.pop()
        fault(moments)
        counts[fault.__name__] += 1
        sizes.append(size(replicas[0].process.pid))
        failures = [client.failure for client in clients if client.failure is not None]
        assert failures == []
        if time.monotonic() > told + 60.0:
            told = time.monotonic()
            tell(told - began, clients, counts, sizes[-1])
    for client in clients:
        client.stop.set()
    for client in clients:
        client.thread.join(300)
        assert client.failure is None

    tell(time.monotonic() - began, clients, counts, size(replicas[0].process.pid))
    acknowledged = [job for client in clients for job in client.acknowledged.values()]
    check_jobs(clients[0], {job.id: job for job in acknowledged}, own(database))
    check_results(clients, moments)
    check_sizes([*sizes, size(replicas[0].process.pid)])
