"""Requests of all kinds with numbers that are meant to hurt, beside a caller of small requests."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event
from typing import Any

import httpx2
import psutil
import pytest
from processes import Record, Replica, until

from tests import hostile

CHAIN = {"preset": "chain", "n": 13, "constraints": [{"dof": 5, "gap": 0.2}]}
MODES = "/v1/compute/impact-modes"
MEMORY = 1.5 * 2**30


def small(frequency: float) -> dict[str, Any]:
    return {"system": CHAIN, "frequency": {"values": [frequency]}, "outputs": ["impulse"]}


class Neighbour:
    """Asks for what is stored and for something new and small, again and again."""

    def __init__(self, url: str, ended: Event) -> None:
        self.seconds: dict[str, list[float]] = {"stored": [], "small": []}
        self.statuses: Counter[int] = Counter()
        self._url, self._ended = url, ended

    def __call__(self) -> None:
        with httpx2.Client(base_url=self._url, timeout=300) as http:
            http.post(MODES, json=small(1.0)).raise_for_status()
            while not self._ended.wait(0.1):
                for what, frequency in (
                    ("stored", 1.0), ("small", 1.1 + 1e-4 * len(self.seconds["small"])),
                ):  # fmt: skip
                    began = time.monotonic()
                    self.statuses[http.post(MODES, json=small(frequency)).status_code] += 1
                    self.seconds[what].append(time.monotonic() - began)


@pytest.mark.parametrize(("count", "callers", "seed"), [(400, 8, 7), (150, 1, 8)])
def test_hostile_numbers_hold_up_nobody(
    count: int,
    callers: int,
    seed: int,
    started: Callable[[Any], Any],
    record: Record,
    tmp_path: Path,
) -> None:
    """On two busy cores no wait of 2,000 passed .1 s for what is stored, 2 s for what is small."""
    # How long a busy machine lets a caller wait is printed, and nothing that fails.
    replica = started(Replica(tmp_path / "a", record, max_waiting_seconds="60"))
    until(lambda: replica.http.get("/v1/health/ready").is_success, "it is not ready")
    ended, jobs, wrong = Event(), list[str](), list[Any]()
    neighbour = Neighbour(str(replica.http.base_url), ended)
    process = psutil.Process(replica.process.pid)
    memory = [process.memory_info().rss]

    def send(case: tuple[str, dict[str, Any]]) -> int:
        kind, document = case
        answer = replica.http.post(f"/v1/compute/{kind}", json=document, timeout=300)
        if answer.status_code >= 500:
            wrong.append((kind, document, answer.text[:300]))
        if answer.status_code == 202:
            jobs.append(answer.headers["location"])
        memory.append(process.memory_info().rss)
        return answer.status_code

    with ThreadPoolExecutor(callers + 1) as pool:
        beside = pool.submit(neighbour)
        statuses = Counter(pool.map(send, hostile.cases(count, seed)))
        ended.set()
        beside.result()
    for job in jobs:
        assert replica.http.delete(job).is_success
    until(lambda: not _busy(process), "a worker computes what was cancelled")
    worst = {what: round(max(seconds), 2) for what, seconds in neighbour.seconds.items()}
    print("statuses", dict(statuses), "MiB", max(memory) >> 20, "worst waits, s", worst)
    assert wrong == []
    assert sum(statuses.values()) == count
    assert set(neighbour.statuses) == {200}
    assert max(memory) < MEMORY


def _busy(process: psutil.Process) -> bool:
    """Whether a child takes most of a core's time."""
    return any(child.cpu_percent(0.5) > 50 for child in process.children(recursive=True))
