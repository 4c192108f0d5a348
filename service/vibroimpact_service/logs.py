"""Logging of every process of the service: one JSON object per line, on stderr."""

from __future__ import annotations

import logging
import sys
from typing import Any

import orjson
import structlog


def to_stderr() -> None:
    """Configure logging of this process, including that of libraries."""
    shared: list[Any] = [
        structlog.contextvars.merge_contextvars,
        structlog.processors.add_log_level,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
        structlog.processors.format_exc_info,
    ]
    structlog.configure(
        processors=[
            *shared,
            structlog.processors.JSONRenderer(serializer=orjson.dumps, default=str),
        ],
        wrapper_class=structlog.make_filtering_bound_logger(logging.INFO),
        logger_factory=structlog.BytesLoggerFactory(file=sys.stderr.buffer),
        cache_logger_on_first_use=True,
    )
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=[structlog.stdlib.add_logger_name, *shared],
            processors=[
                structlog.stdlib.ProcessorFormatter.remove_processors_meta,
                structlog.processors.JSONRenderer(serializer=_text, default=str),
            ],
        )
    )
    handler.addFilter(_is_relevant)
    logging.root.handlers[:] = [handler]
    for logger in logging.root.manager.loggerDict.values():
        # Dask gives its loggers handlers of their own, which write plain text, and reports
        # every connection.
        if isinstance(logger, logging.Logger) and logger.handlers:
            logger.handlers.clear()
            logger.setLevel(max(logger.level, logging.ERROR))
            logger.propagate = True


def _is_relevant(record: logging.LogRecord) -> bool:
    """Whether a record is more than Dask's report of a closed connection, or of a cancelled start.

    Every service that stops closes and cancels some; those that matter are logged where they are
    noticed.
    """
    error = record.exc_info[0] if record.exc_info else None
    closed = error is not None and error.__name__ in ("CommClosedError", "CancelledError")
    return not (closed and record.name.startswith("distributed"))


def _text(content: Any, **options: Any) -> str:
    return orjson.dumps(content, **options).decode()
