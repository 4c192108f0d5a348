"""Spans of jobs: a trace goes on from the request that submitted a job to the work on it.

Without a provider of traces (`OTEL_EXPORTER_OTLP_ENDPOINT`), these are calls without effect.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Final

from opentelemetry import propagate, trace
from opentelemetry.context import Context
from opentelemetry.trace import Span, StatusCode

from vibroimpact_service.jobs.tables import JobRow

PARENT: Final = "traceparent"
_TRACER: Final = trace.get_tracer("vibroimpact")


def current() -> str | None:
    """Return the context of the present span, as W3C's header field has it; None without one."""
    if not trace.get_current_span().get_span_context().is_valid:
        return None
    carrier: dict[str, str] = {}
    propagate.inject(carrier)
    return carrier.get(PARENT)


@contextmanager
def attempts(jobs: Iterable[JobRow]) -> Iterator[dict[str, Span]]:
    """Make a span for the attempt at each of some jobs, a child of that which submitted it.

    Yields
    ------
    dict
        Id of a job -> its span.
    """
    with ExitStack() as ended:
        spans = {}
        for job in jobs:
            parent = Context()
            if job.trace is not None:
                parent = propagate.extract({PARENT: job.trace}, parent)
            attributes: dict[str, str | int] = {
                "vibroimpact.job": job.id,
                "vibroimpact.kind": job.kind,
                "vibroimpact.attempt": job.attempts,
            }
            span = _TRACER.start_span("attempt", parent, attributes=attributes)
            ended.callback(span.end)
            spans[job.id] = span
        yield spans


def batch(attempt: Span, chunks: int) -> Span:
    """Return the span of a batch of chunks, from when it is sent to the workers."""
    attributes = {"vibroimpact.chunks": chunks}
    context = trace.set_span_in_context(attempt, Context())
    return _TRACER.start_span("chunks", context, attributes=attributes)


def end(span: Span, error: BaseException | None = None) -> None:
    """End the span of a batch."""
    if error is not None:
        fail(span, type(error).__name__)
    span.end()


def fail(span: Span, why: str) -> None:
    """Mark a span as that of a failure."""
    span.set_status(StatusCode.ERROR, why)
