"""How often the progress of a run is recorded."""

from __future__ import annotations

from concurrent.futures import Future
from types import SimpleNamespace
from typing import Any

import pytest

from vibroimpact_service.jobs.run_one import BATCH_SECONDS, JobRun, progress_seconds


class Recorded:
    """A run of a job at once, whose clock and records are the test's."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 1000.0
        self.records: list[dict[str, Any]] = []
        monkeypatch.setattr("time.monotonic", lambda: self.now)
        records = SimpleNamespace(submit=self._submit)
        context: Any = SimpleNamespace(claim_owner="me", records=records, notify=lambda _: None)
        job: Any = SimpleNamespace(id="job", seconds=1e4)
        self.run = JobRun(job, context)

    def _submit(self, _: Any, owner: str, job: str, values: dict[str, Any]) -> Future[bool]:
        assert (owner, job) == ("me", "job")
        self.records.append(values)
        future: Future[bool] = Future()
        future.set_result(True)
        return future

    def go_on(self, seconds: float, done: int, total: int) -> None:
        self.now += seconds
        self.run.progress(done, total)


def test_the_progress_of_a_long_run_is_recorded_less_often(monkeypatch: pytest.MonkeyPatch) -> None:
    recorded = Recorded(monkeypatch)
    counts = []
    for minute in range(5):
        before = len(recorded.records)
        for tenth in range(600):
            recorded.go_on(0.1, 600 * minute + tenth, 3000)
        counts.append(len(recorded.records) - before)
    assert 60 < counts[0] < 150  # five a second would be 300
    assert 28 < counts[1] <= 60
    assert max(counts[2:]) <= 30
    done = [values["done"] for values in recorded.records]
    assert done == sorted(set(done))


def test_the_same_progress_is_recorded_once(monkeypatch: pytest.MonkeyPatch) -> None:
    recorded = Recorded(monkeypatch)
    for _ in range(50):
        recorded.go_on(1.0, 3, 8)
    assert recorded.records == [{"phase": "computing", "done": 3, "total": 8, "kept": 0}]
    recorded.go_on(1.0, 4, 8)
    assert recorded.records[1]["done"] == 4


def test_a_short_run_is_followed_by_a_fifth_of_a_second() -> None:
    assert progress_seconds(0.0) == progress_seconds(10.0) == 0.2
    assert progress_seconds(50.0) == pytest.approx(1.0)
    assert progress_seconds(1e6) == 2.0
    assert progress_seconds(0.0) >= BATCH_SECONDS  # chunks do not end more often
