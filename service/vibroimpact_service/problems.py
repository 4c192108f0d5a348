"""Problem types (RFC 9457), and the one mapping from exceptions to problems.

Exceptions that only jobs know, such as a lost worker, are added in `chunks.explain`.
"""

from __future__ import annotations

import errno
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from vibroimpact_schema.problems import Fault, Problem
from vibroimpact_solvers.errors import ConvergenceError, ModelError, PlanError

MEDIA_TYPE: Final = "application/problem+json"
PAGES: Final = "/docs/problems/"
"""Path of the pages about the problem types."""


@dataclass(frozen=True, slots=True)
class Type:
    """A problem type: code, HTTP status, title, advice, and whether a retry can succeed."""

    code: str
    status: int
    title: str
    about: str
    retryable: bool = False

    @property
    def uri(self) -> str:
        """Address of the page about it."""
        return PAGES + self.code


TYPES: Final[dict[str, Type]] = {}
"""Code -> problem type."""


def _type(code: str, status: int, title: str, about: str, *, retryable: bool = False) -> Type:
    """Declare a problem type; the first one of a status stands for the bare status too."""
    declared = TYPES[code] = Type(code, status, title, about, retryable)
    return declared


BAD_REQUEST = _type(
    "bad_request",
    400,
    "The request cannot be read",
    "It violates HTTP or is incomplete.",
)
MALFORMED = _type(
    "malformed_json",
    400,
    "The body is not JSON",
    "The body must be one JSON document in UTF-8, without duplicate names and with at "
    "most 200 levels of nesting.",
)
MALFORMED_FILE = _type(
    "malformed_file",
    400,
    "The file does not have the format of its media type",
    "Matrix Market text must be real and general or symmetric; .npy must hold real "
    "numbers and have the length that its header states; parts of multipart/form-data are files "
    "with the format that the ending of their name tells.",
)
UNAUTHENTICATED = _type(
    "unauthenticated",
    401,
    "Authentication is required",
    "Send Authorization: Bearer with a valid API key or token.",
)
FORBIDDEN = _type(
    "forbidden",
    403,
    "The key does not permit this",
    "Use a key with the scope that detail names.",
)
NOT_FOUND = _type(
    "not_found",
    404,
    "Not found",
    "The address is unknown, or names something that does not exist or belongs to someone else; "
    "/openapi.json lists all addresses, and /docs shows them.",
)
NOT_READY = _type(
    "not_ready",
    404,
    "The job has no result yet",
    "Ask again after Retry-After, or wait with GET /v1/jobs/{id}?wait=25.",
    retryable=True,
)
NO_RESULT = _type(
    "no_result",
    404,
    "The job has no result",
    "It failed or was cancelled; GET /v1/jobs/{id} says why.",
)
METHOD_NOT_ALLOWED = _type(
    "method_not_allowed",
    405,
    "The address does not support this method",
    "Allow lists the methods that it supports.",
)
NOT_ACCEPTABLE = _type(
    "not_acceptable",
    406,
    "The requested media type is not available",
    "Results are application/json or application/x-hdf5.",
)
TIMEOUT = _type(
    "timeout",
    408,
    "The request arrived too slowly",
    "Send it again over a better connection.",
    retryable=True,
)
PRECONDITION_FAILED = _type(
    "precondition_failed",
    412,
    "The condition does not hold",
    "If-Match names another representation than the present one; only results, systems and pages "
    "have entity tags.",
)
TOO_LARGE = _type(
    "too_large",
    413,
    "The request is too large",
    "The body, the system, a grid or the result would exceed a limit; GET /v1/version "
    "lists the limits.",
)
TOO_COSTLY = _type(
    "too_costly",
    413,
    "The computation is too expensive",
    "Its planned cost exceeds what one computation, or this key, may cost; detail has the numbers.",
)
UNSUPPORTED_MEDIA_TYPE = _type(
    "unsupported_media_type",
    415,
    "The media type or coding of the body is not supported",
    "Send application/json in UTF-8 without content coding; to /v1/systems also "
    "application/x-matrix-market, application/x-npy or multipart/form-data.",
)
RANGE_NOT_SATISFIABLE = _type(
    "range_not_satisfiable",
    416,
    "The range lies beyond the end",
    "Content-Range states the size.",
)
MISDIRECTED = _type(
    "misdirected",
    421,
    "The host name is not one of this service",
    "Host must name this machine or be listed in the setting hosts.",
)
INVALID = _type(
    "invalid_request",
    422,
    "The request is well-formed but not valid",
    "Each entry of errors points at a faulty field and says what is wrong with it.",
)
NOT_POSSIBLE = _type(
    "not_possible",
    422,
    "No available method can compute this",
    "Reduce or change the request; detail names the obstacle.",
)
NO_CONVERGENCE = _type(
    "no_convergence",
    422,
    "A numerical method did not reach its tolerance",
    "Loosen the tolerance or change the method.",
)
KEY_REUSED = _type(
    "idempotency_key_reused",
    422,
    "The Idempotency-Key was used for another request",
    "Use a new key for each new request.",
)
WORKER_LOST = _type(
    "worker_lost",
    422,
    "The computation killed its worker process",
    "It was tried several times, the last time alone: most likely it needs more memory "
    "than there is. Request less at a time.",
)
LIMIT_PASSED = _type(
    "limit_passed",
    422,
    "The computation passed a limit while it ran",
    "It needs far more than its plan could foresee; detail says which limit it passed, and what is "
    "kept for a request that is the same. Request less.",
)
DEADLINE = _type(
    "deadline_passed",
    422,
    "The job did not finish by its deadline",
    "Request less, or set a later deadline.",
)
TOO_MANY = _type(
    "too_many_requests",
    429,
    "Too many requests",
    "Ask again after Retry-After.",
    retryable=True,
)
QUOTA_SPENT = _type(
    "quota_spent",
    429,
    "The key has too little computing time left",
    "Request less, or ask again after Retry-After; detail has the numbers.",
    retryable=True,
)
TOO_MANY_JOBS = _type(
    "too_many_jobs",
    429,
    "Too many unfinished jobs",
    "Wait until some have finished, or cancel some.",
    retryable=True,
)
HEADER_TOO_LARGE = _type(
    "header_too_large",
    431,
    "The header section is too large",
    "Send fewer and shorter header fields.",
)
INTERNAL = _type(
    "internal_error",
    500,
    "Internal error",
    "The fault is the service's. Please report it with the request id.",
)
OF_THE_SERVICE: Final = (INTERNAL, WORKER_LOST)
"""Problems of failed jobs that their requests did not bring about, or not alone."""
STORE_FULL = _type(
    "store_full",
    507,
    "The store is full",
    "Results that are no longer needed must be removed first; nothing that was stored is lost.",
    retryable=True,
)
UNAVAILABLE = _type(
    "unavailable",
    503,
    "The service is unavailable",
    "It is starting, stopping, overloaded or out of space; ask again after Retry-After.",
    retryable=True,
)


class ProblemError(Exception):
    """A request that is answered by a problem document.

    Parameters
    ----------
    type : Type
        The problem type.
    detail : str
        A sentence about this occurrence; it never quotes the request.
    errors : sequence of Fault
        The faulty fields, where they are known.
    headers : mapping
        Headers of the answer, such as Retry-After.
    """

    def __init__(
        self,
        type: Type,
        detail: str,
        errors: Sequence[Fault] = (),
        headers: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(detail)
        self.type = type
        self.detail = detail
        self.errors = tuple(errors)
        self.headers = dict(headers or {})

    def __reduce__(self) -> tuple[object, ...]:
        """Support pickling, between processes."""
        return (ProblemError, (self.type, self.detail, self.errors, self.headers))

    def under(self, *prefix: str | int) -> ProblemError:
        """Return the same problem, its pointers from a document that contains the request."""
        where, detail = pointer(prefix), self.detail
        faults = [
            f if f.parameter else f.model_copy(update={"pointer": where + f.pointer})
            for f in self.errors
        ]
        if self.errors and self.errors[0].pointer and detail.startswith(self.errors[0].pointer):
            detail = where + detail
        return ProblemError(self.type, detail, faults, self.headers)

    def document(self, request_id: str) -> Problem:
        """Return the problem document for a request."""
        return Problem(
            type=self.type.uri,
            title=self.type.title,
            status=self.type.status,
            detail=self.detail,
            instance=f"urn:vibroimpact:request:{request_id}",
            request_id=request_id,
            code=self.type.code,
            retryable=self.type.retryable,
            errors=list(self.errors),
        )


def of_status(status: int) -> Type:
    """Return the type that stands for a bare HTTP status."""
    other = BAD_REQUEST if status < 500 else INTERNAL
    return next((each for each in TYPES.values() if each.status == status), other)


def of(error: BaseException) -> ProblemError:
    """Return the problem that answers an exception."""
    match error:
        case ProblemError():
            return error
        case ModelError():
            return invalid(pointer(error.pointer), error.code, error.message)
        case PlanError():
            where, code = pointer(error.pointer), NOT_POSSIBLE.code
            fault = Fault(pointer=where, code=code, message=error.message)
            return ProblemError(NOT_POSSIBLE, error.message, [fault] if where else ())
        case ConvergenceError():
            return ProblemError(NO_CONVERGENCE, str(error))
        case OSError() if error.errno in (errno.ENOSPC, errno.EDQUOT):
            detail = "The store is full: the result cannot be stored."
            return ProblemError(STORE_FULL, detail, headers={"Retry-After": "10"})
        case OSError() if error.errno in (errno.EMFILE, errno.ENFILE):
            # Libraries open files too, when they first compute something.
            detail = "The service can open no more files at the moment."
            return ProblemError(UNAVAILABLE, detail, headers={"Retry-After": "2"})
        case ConnectionError():
            detail = "The records or the store cannot be reached."
            return ProblemError(UNAVAILABLE, detail, headers={"Retry-After": "2"})
        case MemoryError():
            return ProblemError(TOO_LARGE, "The computation needs more memory than is available.")
        case _:
            return ProblemError(INTERNAL, "An unexpected error occurred; it has been logged.")


def stopping() -> ProblemError:
    """Return the problem of a request that the end of the service cuts short."""
    detail = "The service ends; another process, or the next one, computes this."
    return ProblemError(UNAVAILABLE, detail, headers={"Retry-After": "5"})


def invalid(where: str, code: str, message: str) -> ProblemError:
    """Return the problem of one faulty place, given by its JSON pointer."""
    sentence = f"{where}: {message}" if where else message
    return ProblemError(INVALID, sentence, [Fault(pointer=where, code=code, message=message)])


def too_large(where: str, code: str, message: str) -> ProblemError:
    """Return the problem of one field that is too large."""
    return ProblemError(TOO_LARGE, message, [Fault(pointer=where, code=code, message=message)])


def pointer(parts: Sequence[str | int]) -> str:
    """Return the JSON pointer (RFC 6901) of a path."""
    return "".join("/" + str(p).replace("~", "~0").replace("/", "~1") for p in parts)
