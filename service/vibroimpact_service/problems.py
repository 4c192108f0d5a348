"""Which error is answered how: the one table from exceptions to problems (RFC 9457)."""

from __future__ import annotations

import errno
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from vibroimpact_schema import grids, motions, sweeps, systems
from vibroimpact_schema.problems import Fault, Problem
from vibroimpact_solvers.errors import ConvergenceError, ModelError, PlanError

MEDIA_TYPE: Final = "application/problem+json"
PAGES: Final = "/docs/problems/"
"""Where the pages about the types of problems are."""

_MOST_FAULTS = 20
_LONGEST_NAME = 64
_TAGS = systems.TAGS | grids.TAGS | motions.TAGS | sweeps.TAGS


@dataclass(frozen=True, slots=True)
class Type:
    """A type of problem: its code, HTTP status, title, whether to retry, and its page."""

    code: str
    status: int
    title: str
    about: str
    retryable: bool = False

    @property
    def uri(self) -> str:
        """Address of its page."""
        return PAGES + self.code


MALFORMED = Type(
    "malformed_json",
    400,
    "The body is not JSON",
    "The body must be one JSON document in UTF-8, without duplicate names and with at most "
    "200 levels of nesting.",
)
MALFORMED_FILE = Type(
    "malformed_file",
    400,
    "The file is not what its media type says",
    "Matrix Market text must be real and general or symmetric; .npy must hold real numbers and "
    "have the length that its header claims.",
)
BAD_REQUEST = Type(
    "bad_request", 400, "The request cannot be read", "It violates HTTP or breaks off."
)
UNAUTHENTICATED = Type(
    "unauthenticated",
    401,
    "A key is needed",
    "Send Authorization: Bearer and an API key or token that is valid.",
)
FORBIDDEN = Type(
    "forbidden",
    403,
    "The key is not good for this",
    "Use a key that has the scope that detail names.",
)
NOT_FOUND = Type(
    "not_found",
    404,
    "There is no such thing",
    "The address is unknown, or names something that does not exist or is not yours.",
)
NOT_READY = Type(
    "not_ready",
    404,
    "The job has no result yet",
    "Ask again after Retry-After, or wait with GET /v1/jobs/{id}?wait=25.",
    retryable=True,
)
NO_RESULT = Type(
    "no_result",
    404,
    "The job has no result",
    "It failed or was cancelled; GET /v1/jobs/{id} says why.",
)
METHOD_NOT_ALLOWED = Type(
    "method_not_allowed", 405, "This address does not take this method", "Allow lists what it does."
)
NOT_ACCEPTABLE = Type(
    "not_acceptable",
    406,
    "The wanted media type is not available",
    "Results are application/json or application/x-hdf5.",
)
TIMEOUT = Type(
    "timeout",
    408,
    "The request came too slowly",
    "Send it again over a better connection.",
    retryable=True,
)
TOO_LARGE = Type(
    "too_large",
    413,
    "The request is too large",
    "The body, the system, a grid or the result would exceed a limit; GET /v1/version lists them.",
)
TOO_COSTLY = Type(
    "too_costly",
    413,
    "The computation costs too much",
    "Its plan exceeds what one computation, or this key, may cost; detail has the numbers.",
)
UNSUPPORTED_MEDIA_TYPE = Type(
    "unsupported_media_type",
    415,
    "The media type or coding of the body is not supported",
    "Send application/json in UTF-8 without content coding; to /v1/systems also "
    "application/x-matrix-market or application/x-npy.",
)
RANGE_NOT_SATISFIABLE = Type(
    "range_not_satisfiable", 416, "No such bytes", "Content-Range tells the size."
)
MISDIRECTED = Type(
    "misdirected",
    421,
    "The service does not go by this name",
    "Host must be a name of this machine, or one that the setting hosts lists.",
)
INVALID = Type(
    "invalid_request",
    422,
    "The request is well-formed but wrong",
    "Each of errors points at a faulty field and says what is wrong with it.",
)
NOT_POSSIBLE = Type(
    "not_possible",
    422,
    "Nothing available can compute this",
    "Ask for less or for something else; detail says what stands in the way.",
)
NO_CONVERGENCE = Type(
    "no_convergence",
    422,
    "A numerical method did not reach its tolerance",
    "Loosen the tolerance or change the method.",
)
KEY_REUSED = Type(
    "idempotency_key_reused",
    422,
    "The Idempotency-Key was used for another request",
    "Take a new key for each new request.",
)
WORKER_LOST = Type(
    "worker_lost",
    422,
    "The computation killed its worker process",
    "It was tried several times, also alone: most likely it needs more memory than there is. "
    "Ask for less at a time.",
)
DEADLINE = Type(
    "deadline_passed",
    422,
    "The job was not done by its deadline",
    "Ask for less, or set a later deadline.",
)
TOO_MANY = Type(
    "too_many_requests",
    429,
    "There were too many requests",
    "Ask again after Retry-After.",
    retryable=True,
)
QUOTA_SPENT = Type(
    "quota_spent",
    429,
    "The key has too little computing left",
    "Ask for less, or again after Retry-After; detail has the numbers.",
    retryable=True,
)
TOO_MANY_JOBS = Type(
    "too_many_jobs",
    429,
    "Too many jobs are unfinished",
    "Wait until some have ended, or cancel some.",
    retryable=True,
)
HEADER_TOO_LARGE = Type(
    "header_too_large", 431, "The header is too large", "Send fewer and shorter header fields."
)
INTERNAL = Type(
    "internal_error",
    500,
    "The service failed",
    "The fault is ours. Please report it with the request id.",
)
STORE_FULL = Type(
    "store_full",
    507,
    "The store has no room",
    "Results that nobody needs must be removed first; nothing that was stored is lost.",
    retryable=True,
)
UNAVAILABLE = Type(
    "unavailable",
    503,
    "The service cannot do this now",
    "It is starting, stopping, overloaded or out of room; ask again after Retry-After.",
    retryable=True,
)

TYPES: Final[Mapping[str, Type]] = {
    t.code: t
    for t in (
        *(
            MALFORMED,
            MALFORMED_FILE,
            BAD_REQUEST,
            UNAUTHENTICATED,
            FORBIDDEN,
            NOT_FOUND,
            NOT_READY,
            NO_RESULT,
        ),
        *(METHOD_NOT_ALLOWED, NOT_ACCEPTABLE, TIMEOUT, TOO_LARGE, TOO_COSTLY),
        *(UNSUPPORTED_MEDIA_TYPE, RANGE_NOT_SATISFIABLE, MISDIRECTED, INVALID, NOT_POSSIBLE),
        *(NO_CONVERGENCE, KEY_REUSED, WORKER_LOST, DEADLINE, TOO_MANY, QUOTA_SPENT),
        *(TOO_MANY_JOBS, HEADER_TOO_LARGE, INTERNAL, STORE_FULL, UNAVAILABLE),
    )
}
_OF_STATUS: Final = {
    t.status: t
    for t in (
        *(BAD_REQUEST, UNAUTHENTICATED, FORBIDDEN, NOT_FOUND, METHOD_NOT_ALLOWED),
        *(NOT_ACCEPTABLE, TIMEOUT, TOO_LARGE, UNSUPPORTED_MEDIA_TYPE, RANGE_NOT_SATISFIABLE),
        *(MISDIRECTED, INVALID, TOO_MANY, HEADER_TOO_LARGE, INTERNAL, UNAVAILABLE),
    )
}


class ProblemError(Exception):
    """A request that is answered by a problem.

    Parameters
    ----------
    type : Type
        What sort of problem.
    detail : str
        This occurrence in words; never words of the request.
    errors : sequence of Fault
        The faults that can be located.
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
        """Survive the way through a process boundary."""
        return (ProblemError, (self.type, self.detail, self.errors, self.headers))

    def document(self, request_id: str) -> Problem:
        """Return the document that answers a request."""
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
    return _OF_STATUS.get(status, BAD_REQUEST if status < 500 else INTERNAL)


def of(error: BaseException) -> ProblemError:
    """Return the problem that answers an exception."""
    match error:
        case ProblemError():
            return error
        case ModelError():
            return invalid(pointer(error.pointer), error.code, error.message)
        case PlanError():
            return ProblemError(NOT_POSSIBLE, str(error))
        case ConvergenceError():
            return ProblemError(NO_CONVERGENCE, str(error))
        case OSError() if error.errno in (errno.ENOSPC, errno.EDQUOT):
            return ProblemError(STORE_FULL, "The store has no room for the result.")
        case ConnectionError():
            detail = "The records or the store cannot be reached."
            return ProblemError(UNAVAILABLE, detail, headers={"Retry-After": "2"})
        case MemoryError():
            return ProblemError(TOO_LARGE, "The computation needs more memory than there is.")
        case _:
            return ProblemError(INTERNAL, "An unexpected error occurred; it has been logged.")


def invalid(where: str, code: str, message: str) -> ProblemError:
    """Return the problem of one faulty place, given by its JSON pointer."""
    sentence = f"{where}: {message}" if where else message
    return ProblemError(INVALID, sentence, [Fault(pointer=where, code=code, message=message)])


def too_large(where: str, code: str, message: str) -> ProblemError:
    """Return the problem of one place that claims too much."""
    return ProblemError(TOO_LARGE, message, [Fault(pointer=where, code=code, message=message)])


def of_validation(error: ValidationError, document: Any, *prefix: str) -> ProblemError:
    """Return the problem of a document that does not fit its model.

    Parameters
    ----------
    error : ValidationError
        What pydantic found.
    document : object
        What was validated; only its structure is used, to tell the parts of an error's
        path that lie in it from those that name a branch of a union.
    prefix : str
        Path from the body to the document.
    """
    found = error.errors(include_url=False, include_input=False)
    faults = [
        Fault(
            pointer=pointer((*prefix, *_place(item["loc"], document), *_tag(item))),
            code=_CODES.get(item["type"], item["type"]),
            message=sentence(item["type"], item["msg"], item.get("ctx", {})),
        )
        for item in found[:_MOST_FAULTS]
    ]
    first = faults[0]
    detail = f"{first.pointer}: {first.message}" if first.pointer else first.message
    if len(found) > 1:
        detail += f" (and {len(found) - 1} more)"
    return ProblemError(INVALID, detail, faults)


_CODES: Final = {
    "missing": "missing",
    "extra_forbidden": "unknown_field",
    "finite_number": "not_finite",
    "float_type": "wrong_type",
    "int_type": "wrong_type",
    "bool_type": "wrong_type",
    "string_type": "wrong_type",
    "string_unicode": "wrong_type",
    "list_type": "wrong_type",
    "dict_type": "wrong_type",
    "model_type": "wrong_type",
    "greater_than": "out_of_range",
    "greater_than_equal": "out_of_range",
    "less_than": "out_of_range",
    "less_than_equal": "out_of_range",
    "too_short": "too_short",
    "too_long": "too_long",
    "string_too_long": "too_long",
    "string_pattern_mismatch": "wrong_format",
    "literal_error": "unknown_choice",
    "union_tag_invalid": "unknown_choice",
    "union_tag_not_found": "missing",
}


def sentence(kind: str, message: str, context: Mapping[str, Any]) -> str:
    """Return pydantic's sentence, or one of ours where its own quotes the input or is obscure."""
    if kind == "union_tag_invalid":
        return f"must be one of {context['expected_tags']}"
    if kind == "extra_forbidden":
        return "there is no such field"
    if kind == "missing":
        return "this field is required"
    if kind == "model_type":
        return "must be an object"
    if kind == "too_short":
        least = context["min_length"]
        return "must not be empty" if least == 1 else f"needs at least {least} items"
    return message.replace("Input should be", "must be")


def _place(path: Sequence[str | int], document: Any) -> list[str | int]:
    """Return the parts of an error's path that lie in the document."""
    here, place = document, []
    for part in path:
        inside = (isinstance(here, dict) and part in here) or (
            isinstance(here, list) and isinstance(part, int) and part < len(here)
        )
        if inside:
            here = here[part]
        elif part in _TAGS or part == "[key]":
            continue
        place.append(part if isinstance(part, int) else _shown(part))
    return place


def _tag(item: ErrorDetails) -> tuple[str, ...]:
    """Return the field that should have told which of several documents was meant."""
    if item["type"] not in {"union_tag_invalid", "union_tag_not_found"}:
        return ()
    return (item["ctx"]["discriminator"].strip("'"),)


def _shown(name: str) -> str:
    """Return a field name as it may be shown: short and printable."""
    cut = name if len(name) <= _LONGEST_NAME else name[:_LONGEST_NAME] + "…"
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in cut)


def pointer(parts: Sequence[str | int]) -> str:
    """Return the JSON pointer (RFC 6901) of a path."""
    return "".join("/" + str(p).replace("~", "~0").replace("/", "~1") for p in parts)
