"""What can go wrong between a program and the service, sorted by what the program can do.

::

    VibroimpactError
    ├── ConnectionFailed       nobody answers at the address
    ├── EmbeddedServiceError   the service of our own did not start
    ├── ConfigurationError     the environment or the file of profiles cannot be understood
    ├── JobFailed              the job ended without a result; `problem` says why
    ├── JobCancelled           somebody cancelled it
    ├── JobTimeout             it goes on, but we waited long enough
    └── ServerError            the service answered with a problem
        ├── InvalidRequest     400, 415, 422: correct the fields in `errors`
        ├── AccessDenied       401, 403
        ├── NotFound           404
        ├── TooLarge           413
        ├── TooManyRequests    429
        └── Unavailable        5xx
"""

from __future__ import annotations

from typing import Any

# These are conditions a program meets, named as users say them.
# ruff: noqa: N818


class VibroimpactError(Exception):
    """Base of all errors of the client."""


class ConnectionFailed(VibroimpactError):
    """Nobody answers at the address of the service."""


class EmbeddedServiceError(VibroimpactError):
    """The service that the client starts for itself did not start."""


class ConfigurationError(VibroimpactError):
    """What the environment or the file of profiles say cannot be understood."""


class JobFailed(VibroimpactError):
    """A job ended without a result.

    Parameters
    ----------
    job : str
        Its id.
    problem : dict
        The problem document of the job.
    """

    def __init__(self, job: str, problem: dict[str, Any]) -> None:
        super().__init__(f"job {job}: {problem.get('detail', 'failed')}")
        self.job, self.problem = job, problem


class JobCancelled(VibroimpactError):
    """A job was cancelled."""


class JobTimeout(VibroimpactError):
    """A job is not done in the time given; it goes on."""


class ServerError(VibroimpactError):
    """The service answered with a problem.

    Parameters
    ----------
    problem : dict
        The problem document (RFC 9457).
    """

    def __init__(self, problem: dict[str, Any]) -> None:
        self.problem = problem
        self.status = int(problem.get("status", 500))
        self.code = str(problem.get("code", "unknown"))
        self.request_id = problem.get("request_id")
        self.errors: list[dict[str, Any]] = list(problem.get("errors", ()))
        lines = [f"{fault.get('pointer', '')}: {fault.get('message', '')}" for fault in self.errors]
        detail = str(problem.get("detail") or problem.get("title") or "the service failed")
        # With faults, the detail mostly repeats the first of them.
        if not lines or not detail.startswith(lines[0]):
            lines.insert(0, detail)
        super().__init__("\n  ".join(lines))


class InvalidRequest(ServerError):
    """The request is wrong; `errors` names the fields."""


class AccessDenied(ServerError):
    """The service wants a key, or another one."""


class NotFound(ServerError):
    """There is no such thing, or not for us."""


class TooLarge(ServerError):
    """The request, or its result, is larger than the service takes."""


class TooManyRequests(ServerError):
    """The service wants us to slow down."""


class Unavailable(ServerError):
    """The service cannot answer now."""


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


def from_problem(problem: dict[str, Any]) -> ServerError:
    """Return the error that a problem document stands for."""
    status = int(problem.get("status", 500))
    return _BY_STATUS.get(status, Unavailable if status >= 500 else ServerError)(problem)
