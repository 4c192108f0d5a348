"""Errors of the client, sorted by what a program can do about them.

::

    VibroimpactError
    ├── ConnectionFailed       the service does not respond
    ├── EmbeddedServiceError   the service that the client starts did not start
    ├── MissingExtra           an optional library is not installed
    ├── ConfigurationError     an environment variable or the configuration file is wrong
    ├── JobFailed              the job ended without a result; `problem` says why
    ├── JobCancelled           the job was cancelled
    ├── JobTimeout             the job has not ended in the time given; it continues
    └── ServerError            the service answered with a problem document
        ├── InvalidRequest     400, 415, 422: correct the fields in `errors`
        ├── AccessDenied       401, 403
        ├── NotFound           404
        ├── TooLarge           413
        ├── TooManyRequests    429
        └── Unavailable        5xx

``NeglectedWarning`` is no error: a part of the structure has no effect on a result. Nor is
``StructureWarning``: the structure is permitted, but seldom meant so.
"""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vibroimpact import documents

# The names state conditions, without the suffix Error.
# ruff: noqa: N818


class VibroimpactError(Exception):
    """Base of all errors of the client."""


class NeglectedWarning(UserWarning):
    """A part of the structure has no effect on a result, such as damping on impact modes."""


class StructureWarning(UserWarning):
    """A structure is permitted but seldom meant so, such as one with an indefinite K."""


class ConnectionFailed(VibroimpactError):
    """The service does not respond."""


class EmbeddedServiceError(VibroimpactError):
    """The service that the client starts in the background did not start."""


class MissingExtra(VibroimpactError, ImportError):
    """An optional library is not installed; the message is the line that installs it."""

    def __init__(self, what: str, extra: str, error: ImportError) -> None:
        super().__init__(f"{what} need:  pip install 'vibroimpact[{extra}]'  ({error})")


class ConfigurationError(VibroimpactError):
    """An environment variable or the configuration file is wrong."""


class JobFailed(VibroimpactError):
    """A job ended without a result.

    Parameters
    ----------
    job : str
        Id of the job.
    problem : dict
        The problem document of the job.
    """

    def __init__(self, job: str, problem: Mapping[str, Any]) -> None:
        super().__init__(f"job {job}: {problem.get('detail', 'failed')}")
        self.job = job
        self.problem: Mapping[str, Any] = problem


class JobCancelled(VibroimpactError):
    """A job was cancelled."""


class JobTimeout(VibroimpactError):
    """A job has not ended in the time given; it continues."""


class ServerError(VibroimpactError):
    """The service answered with a problem document.

    Parameters
    ----------
    problem : dict
        The problem document (RFC 9457).
    """

    def __init__(self, problem: Mapping[str, Any]) -> None:
        self.problem: Mapping[str, Any] = problem
        self.status = int(problem.get("status", 500))
        self.code = str(problem.get("code", "unknown"))
        self.request_id = problem.get("request_id")
        self.errors: list[documents.Fault] = list(problem.get("errors", ()))
        lines = [f"{fault.get('pointer', '')}: {fault.get('message', '')}" for fault in self.errors]
        detail = str(problem.get("detail") or problem.get("title") or "the service failed")
        # The detail mostly repeats the first fault.
        if not lines or not detail.startswith(lines[0]):
            lines.insert(0, detail)
        super().__init__("\n  ".join(lines))


class InvalidRequest(ServerError):
    """The request is wrong; `errors` names the faulty fields."""


class AccessDenied(ServerError):
    """The key is missing, invalid, or lacks the scope."""


class NotFound(ServerError):
    """The address or object does not exist, or belongs to another owner."""


class TooLarge(ServerError):
    """The request, its cost or its result exceeds a limit of the service."""


class TooManyRequests(ServerError):
    """Too many requests, or too many unfinished jobs; try again later."""


class Unavailable(ServerError):
    """The service cannot answer at the moment."""


_BY_STATUS = {
    400: InvalidRequest,
    401: AccessDenied,
    403: AccessDenied,
    404: NotFound,
    413: TooLarge,
    415: InvalidRequest,
    422: InvalidRequest,
    429: TooManyRequests,
}


def from_problem(problem: Mapping[str, Any]) -> ServerError:
    """Return the exception for a problem document."""
    status = int(problem.get("status", 500))
    return _BY_STATUS.get(status, Unavailable if status >= 500 else ServerError)(problem)


@contextmanager
def as_answered() -> Iterator[None]:
    """Raise what an answer would have raised where a request became a job and is wrong.

    Whether the service queues a computation depends on its load; the error does not.
    """
    try:
        yield
    except JobFailed as failed:
        if not 400 <= int(failed.problem.get("status", 500)) < 500:
            raise
        raise from_problem(failed.problem) from failed


def warn_of_structure(kind: str, neglected: Sequence[str], cautions: Sequence[str] = ()) -> None:
    """Warn of parts of the structure without effect, and of what is seldom meant in it."""
    _warn(kind, neglected, NeglectedWarning)
    _warn(kind, cautions, StructureWarning)


def _warn(kind: str, sentences: Sequence[str], category: type[Warning]) -> None:
    """Warn at the line that called this package."""
    if not sentences:
        return
    frame, level = inspect.currentframe(), 1
    while frame is not None and _is_ours(str(frame.f_globals.get("__name__", ""))):
        frame, level = frame.f_back, level + 1
    warnings.warn(f"{kind}: {'; '.join(sentences)}", category, stacklevel=level)


def _is_ours(module: str) -> bool:
    return module == "vibroimpact" or module.startswith("vibroimpact.")
