"""A trace goes on from the request that submits a job to the attempts at it and their batches."""

from __future__ import annotations

import asyncio
import random
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from opentelemetry import context, trace
from opentelemetry.trace import NonRecordingSpan, SpanContext, StatusCode, TraceFlags

sys.path.insert(0, str(Path(__file__).parent))
import counting

from tests.service.jobs.test_queue import Bench
from vibroimpact_service.jobs import traces
from vibroimpact_service.jobs.queue import JobQueue
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store


class Span(NonRecordingSpan):
    """A span that remembers what was said of it."""

    def __init__(self, name: str, parent: SpanContext, attributes: Any) -> None:
        traced = parent.trace_id or random.getrandbits(128)
        flags = TraceFlags(TraceFlags.SAMPLED)
        super().__init__(SpanContext(traced, random.getrandbits(64), False, flags))
        self.name, self.parent, self.attributes = name, parent, attributes
        self.status: StatusCode | None = None
        self.ended = False

    def set_status(self, status: Any, description: str | None = None) -> None:
        self.status = status

    def end(self, end_time: int | None = None) -> None:
        self.ended = True


class Tracer:
    """Makes spans, and keeps them."""

    def __init__(self) -> None:
        self.spans: list[Span] = []

    def start_span(self, name: str, context: Any = None, attributes: Any = None) -> Span:
        parent = trace.get_current_span(context).get_span_context()
        self.spans.append(Span(name, parent, attributes))
        return self.spans[-1]


@pytest.fixture
def tracer(monkeypatch: pytest.MonkeyPatch) -> Tracer:
    kept = Tracer()
    monkeypatch.setattr(traces, "_TRACER", kept)
    return kept


@pytest.fixture(params=["sqlite", "postgresql"])
def database(request: pytest.FixtureRequest) -> Iterator[str | None]:
    if request.param == "sqlite":
        yield None
    else:
        new: Callable[[], str] = request.getfixturevalue("postgresql")
        yield new()


def test_the_work_on_a_job_is_part_of_the_trace_of_its_request(
    tracer: Tracer, tmp_path: Path, database: str | None
) -> None:
    asked = tracer.start_span("POST /v1/jobs", context.Context())
    other = tracer.start_span("POST /v1/jobs", context.Context())

    async def scenario() -> None:
        settings = Settings(data=tmp_path, workers=1, database=database)
        store = Store(settings.store_url)
        queue = JobQueue(settings, store, counting.WORK)
        await queue.start()
        try:
            bench = Bench(queue, store)
            with trace.use_span(asked):
                good = await bench.submit(n=100)
            with trace.use_span(other):
                bad = await bench.submit(fail="three is missing")
            lone = await bench.submit(n=30, seconds=0.01)
            for job in (good, bad, lone):
                done = await queue.wait("ann", job.id, 60)
                assert done is not None
                assert done.final
            while not all(span.ended for span in tracer.spans[2:]):
                await asyncio.sleep(0.01)  # the record comes before the end of the run
            check(good, bad, lone)
        finally:
            await queue.close()

    def check(good: Any, bad: Any, lone: Any) -> None:
        attempts = {s.attributes["vibroimpact.job"]: s for s in tracer.spans if s.name == "attempt"}
        assert attempts.keys() == {good.id, bad.id, lone.id}
        first = attempts[good.id]
        assert first.parent.span_id == asked.get_span_context().span_id
        assert first.get_span_context().trace_id == asked.get_span_context().trace_id
        assert (first.attributes["vibroimpact.attempt"], first.status) == (1, None)
        assert attempts[bad.id].parent.trace_id == other.get_span_context().trace_id
        assert attempts[bad.id].status is StatusCode.ERROR
        assert not attempts[lone.id].parent.is_valid
        batches = [span for span in tracer.spans if span.name == "chunks"]
        assert {span.parent.span_id for span in batches} == {first.get_span_context().span_id}
        assert sum(span.attributes["vibroimpact.chunks"] for span in batches) == -(-100 // 10)

    asyncio.run(scenario())


def test_without_a_trace_nothing_is_kept() -> None:
    assert traces.current() is None
