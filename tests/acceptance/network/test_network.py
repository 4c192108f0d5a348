"""A whole cluster, each part with an address of its own: parts end, stand still, or are cut off.

Every test submits jobs before, during and after what it brings about. All that were acknowledged
must be there once, with the right numbers, and new ones are done within the promised time.
"""

from __future__ import annotations

import itertools
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from datetime import datetime
from typing import NamedTuple

import httpx2
import pytest
from cluster import CLIENTS, PARTS, REPLICAS, WORKERS, Cluster
from processes import until
from users import User, sweep, tiny

from vibroimpact_schema import examples
from vibroimpact_service.kinds import KINDS

CUT_SECONDS = 25.0
"""Longer than the limits by which a silent part is given up."""
STORE_SECONDS = 50.0
"""The same for the store, whose requests are repeated."""
CUTS = [
    *((replica, other) for other in ("database", "scheduler", "store") for replica in REPLICAS),
    *((worker, other) for other in ("scheduler", "store") for worker in WORKERS),
    *(("proxy", replica) for replica in REPLICAS),
    (CLIENTS, "proxy"),
]
"""Pairs that talk to one another."""
APART = [
    pair
    for pair in itertools.combinations((*PARTS, CLIENTS), 2)
    if pair not in CUTS and pair[::-1] not in CUTS and CLIENTS not in pair
]
"""Pairs that never do; operators and Prometheus, on this machine, may ask all parts."""
LACKING_SECONDS = 12.0
"""How long a part is missing that nothing stands in for."""
DURING = 20.0
"""Seconds within which a new job is done while a part is missing that others stand in for."""
DURING_STORE = 40.0
"""The same where a machine of workers cannot reach the store: its calls fail one by one."""
AFTER = 20.0
"""Seconds within which all parts work again once nothing is missing."""


class Entry(NamedTuple):
    """Where users ask: the proxy."""

    http: httpx2.Client


@pytest.fixture
def user(cluster: Cluster, request: pytest.FixtureRequest) -> User:
    """Return a user whose jobs are those of one test."""
    name = f"user-{abs(hash(request.node.name)) % 10**9}"
    return User([Entry(cluster.client(cluster.key(name)))])  # type: ignore[list-item]


class Jobs:
    """Submits small jobs one after the other, and measures how long each takes to its end."""

    def __init__(self, user: User) -> None:
        self.user, self.stop = user, threading.Event()
        self.times: list[tuple[float, float]] = []

    def one(self) -> None:
        """Have one done."""
        number = len(self.user.accepted)
        began = time.time()
        self.user.submit(tiny(0.7 + 1e-4 * number))
        job = self.user.accepted[f"key-{number}"][0]
        until(lambda: self.user.final(job), f"{job} does not end")
        self.times.append((began, time.time()))

    def run(self) -> None:
        """Have some done until stopped."""
        while not self.stop.is_set():
            self.one()
            self.stop.wait(0.5)


def struck(
    cluster: Cluster,
    user: User,
    strike: AbstractContextManager[object],
    seconds: float,
    what: str,
) -> tuple[float, float]:
    """Let something be missing; return the slowest job meanwhile, and the time to recovery.

    Both as time in which the machine was idle or busy with the tests; wall times are printed.
    """
    jobs = Jobs(user)
    user.submit(sweep(0.6), sweep(0.61))
    moment = time.time()
    until(lambda: cluster.record.after(moment), "nothing begins")
    with ThreadPoolExecutor(2) as pool:
        asking = pool.submit(jobs.run)
        with strike:
            time.sleep(seconds)
        healed = time.time()
        ready = pool.submit(all_ready, cluster)
        jobs.stop.set()
        asking.result()
        whole = max(ready.result(), at_work(cluster, user, healed))
    after = cluster.machine.seconds(healed, whole)
    slowest = max(jobs.times, key=lambda times: times[1] - times[0])
    user.check()
    print(
        f"\n{what}: slowest small job {slowest[1] - slowest[0]:.1f} s, "
        f"large ones {large(user):.1f} s, all parts work {whole - healed:.1f} s afterwards"
    )
    return cluster.machine.seconds(*slowest), after


def all_ready(cluster: Cluster) -> float:
    """Return when both replicas said that they are ready."""
    for name in REPLICAS:
        until(lambda n=name: cluster.ready(n), f"{name} is not ready")
    return time.time()


def at_work(cluster: Cluster, user: User, healed: float) -> float:
    """Return when the last machine of workers had begun something."""

    def began(name: str) -> float | None:
        if not any(user.final(job) is None for job, _ in list(user.accepted.values())[-2:]):
            # So many chunks that each machine which is not busy has some of them.
            number = len(user.accepted)
            user.submit(*(sweep(0.5 + (number + i) / 10_000) for i in range(2)))
        return cluster.begun(name, healed)

    return max(until(lambda n=name: began(n), f"{name} does nothing") for name in WORKERS)


def large(user: User) -> float:
    """Return the seconds from the submission of the jobs that ran to the last one's end."""
    ended = [user.final(user.accepted[f"key-{number}"][0]) for number in range(2)]
    times = [
        [datetime.fromisoformat(job[key]) for key in ("created", "finished")]
        for job in ended
        if job is not None
    ]
    return max((end - begin).total_seconds() for begin, end in times)


def test_every_kind_of_computation(cluster: Cluster, user: User) -> None:
    """Each example of the contract is a job that the cluster does, asked through the proxy."""
    jobs = {}
    for kind in KINDS:
        for name, example in examples.requests(kind).items():
            body = {"kind": kind, "request": example["request"]}
            answer = user.ask("POST", "/v1/jobs", json=body)
            assert answer.status_code == 201, answer.text
            jobs[f"{kind}, {name}"] = answer.json()["id"]
    for name, job in jobs.items():
        done = until(lambda j=job: user.final(j), f"{name} does not end", 400.0)
        assert done["state"] == "succeeded", (name, done)
        assert user.ask("GET", done["result"]).is_success


def stood_in_for(*parts: str) -> bool:
    """Whether others do what one of these parts did; for the rest there is one alone."""
    return any(part in (*WORKERS, *REPLICAS) for part in parts) and CLIENTS not in parts


def check_times(cluster: Cluster, slowest: float, after: float, *parts: str) -> None:
    """Compare with what is promised."""
    assert after <= AFTER
    if stood_in_for(*parts):
        alone = "store" in parts and any(worker in parts for worker in WORKERS)
        assert slowest <= (DURING_STORE if alone else DURING)


@pytest.mark.parametrize(("one", "other"), CUTS)
def test_a_partition_heals(cluster: Cluster, user: User, one: str, other: str) -> None:
    seconds = STORE_SECONDS if "store" in (one, other) else CUT_SECONDS
    strike = cluster.cut((one, other))
    times = struck(cluster, user, strike, seconds, f"{one} and {other} cut for {seconds:.0f} s")
    check_times(cluster, *times, one, other)


def test_parts_that_need_not_talk(cluster: Cluster, user: User) -> None:
    """All pairs of them are cut at once, and nothing changes."""
    with cluster.cut(*APART):
        slowest, after = struck(cluster, user, nullcontext(), CUT_SECONDS, f"{len(APART)} pairs")
    assert slowest <= AFTER / 4
    assert after <= AFTER / 4


@pytest.mark.parametrize("part", PARTS)
def test_a_part_is_killed(cluster: Cluster, user: User, part: str) -> None:
    times = struck(
        cluster, user, cluster.killed(part), 0.0, f"{part} killed, started again after 1 s"
    )
    check_times(cluster, *times, part)


@pytest.mark.parametrize("part", PARTS)
def test_a_machine_loses_its_power(cluster: Cluster, user: User, part: str) -> None:
    """Nothing is said to those who had connections with it."""
    seconds = CUT_SECONDS if stood_in_for(part) else LACKING_SECONDS
    times = struck(cluster, user, cluster.without_power(part), seconds, f"{part} without power")
    check_times(cluster, *times, part)


@pytest.mark.parametrize("part", PARTS)
def test_a_part_stands_still(cluster: Cluster, user: User, part: str) -> None:
    seconds = CUT_SECONDS if stood_in_for(part) else LACKING_SECONDS
    times = struck(cluster, user, cluster.standing(part), seconds, f"{part} stopped")
    check_times(cluster, *times, part)
