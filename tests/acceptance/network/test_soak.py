"""The clients of the soak before a whole cluster, while its parts fail in every way.

``nox -s network -- -k soak`` for ten minutes; VIBROIMPACT_SOAK_SECONDS sets another time.
"""

from __future__ import annotations

import itertools
import os
import random
import ssl
import time
from collections import Counter
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from typing import Any

import pytest
from clients import CLIENTS, Client, check_jobs, check_results, check_sizes, own, size, tell
from cluster import CLIENTS as HERE
from cluster import PARTS, REPLICAS, Cluster
from processes import until

SECONDS = float(os.environ.get("VIBROIMPACT_SOAK_SECONDS", "600"))
LONGEST = 20.0
"""Seconds that a fault lasts at most."""
PAIRS = list(itertools.combinations((*PARTS, HERE), 2))
LIVES = REPLICAS[0]
"""Its process lives throughout, and must not grow."""
ENDS = [part for part in PARTS if part != LIVES]


def faults(
    cluster: Cluster, source: random.Random
) -> dict[str, Callable[[], AbstractContextManager[None]]]:
    """Return all kinds of faults, each of something else every time."""
    return {
        "killed": lambda: cluster.killed(source.choice(ENDS)),
        "without power": lambda: cluster.without_power(source.choice(ENDS)),
        "unplugged": lambda: cluster.unplugged(source.choice(PARTS)),
        "stopped": lambda: cluster.standing(source.choice(PARTS)),
        "cut": lambda: cluster.cut(source.choice(PAIRS)),
        "cut twice": lambda: cluster.cut(*source.sample(PAIRS, 2)),
    }


@pytest.mark.timeout(SECONDS + 3600.0)
def test_soak(cluster: Cluster, moments: random.Random) -> None:
    key = cluster.key("ann")
    like = cluster.client(key)
    certified = ssl.create_default_context(cafile=cluster.authority)
    http = {"verify": certified, "headers": dict(like.headers)}
    addresses = [str(like.base_url).rstrip("/")]
    with ExitStack() as opened:
        clients = [
            Client(number, lambda: addresses, moments.randrange(10**6), **http)
            for number in range(CLIENTS)
        ]
        for client in clients:
            opened.enter_context(client.http)
            client.thread.start()
        counts, sizes = strike(cluster, clients, moments)
        for client in clients:
            client.stop.set()
        for client in clients:
            client.thread.join(300)
            assert client.failure is None
        for name in REPLICAS:
            until(lambda n=name: cluster.ready(n), f"{name} is not ready")
        sizes.append(size(cluster.running[LIVES].process.pid))
        tell(SECONDS, clients, counts, sizes[-1])
        acknowledged = [job for client in clients for job in client.acknowledged.values()]
        check_jobs(clients[0], {job.id: job for job in acknowledged}, own(cluster.database))
        check_results(clients, moments)
        check_sizes(sizes)


def strike(
    cluster: Cluster, clients: list[Client], moments: random.Random
) -> tuple[Counter[str], list[tuple[float, int]]]:
    """Bring about one fault after the other; return how many of each, and sizes of a process."""
    counts: Counter[str] = Counter()
    sizes: list[tuple[float, int]] = []
    queue: list[Any] = []
    began = told = time.monotonic()
    while time.monotonic() < began + SECONDS:
        time.sleep(moments.uniform(0.5, 8.0))
        if not queue:  # all kinds, each time in another order
            kinds = list(faults(cluster, moments).items())
            queue = moments.sample(kinds, k=len(kinds))
        name, fault = queue.pop()
        with fault():
            time.sleep(moments.uniform(0.0, LONGEST))
        counts[name] += 1
        sizes.append(size(cluster.running[LIVES].process.pid))
        assert [client.failure for client in clients if client.failure is not None] == []
        if time.monotonic() > told + 60.0:
            told = time.monotonic()
            tell(told - began, clients, counts, sizes[-1])
    return counts, sizes
