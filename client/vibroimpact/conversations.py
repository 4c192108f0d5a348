"""Conversations with the service, each written once for the waiting and the async client.

A conversation is a generator. It yields requests to send and pauses to make, receives the
answers, and returns its outcome; the two classes of `transport` carry it out.
"""

from __future__ import annotations

import math
import random
import time
import uuid
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NotRequired, TypedDict, TypeVar

# httpx2 is the maintained successor of httpx, with the same interface.
import httpx2

from vibroimpact.arguments import Document, hyphenated
from vibroimpact.cache import Cache
from vibroimpact.errors import (
    ConnectionFailed,
    InvalidRequest,
    JobTimeout,
    ServerError,
    VibroimpactError,
    from_problem,
    warn_of_structure,
)
from vibroimpact.parts import Parts
from vibroimpact.plain import plain
from vibroimpact_schema import entries

if TYPE_CHECKING:
    from vibroimpact import documents

Outcome = TypeVar("Outcome")

_RETRIED: Final = frozenset({408, 429, 500, 502, 503, 504})
_LONGEST_PAUSE: Final = 120.0
_FIRST_BACKOFF: Final = 0.5
_LONGEST_BACKOFF: Final = 8.0
"""Seconds before the first retry and before later ones, which double; jitter takes up to half."""
_POLL: Final = 25.0
"""Longest poll of a job in seconds; the service answers earlier when something changes."""
_FEW: Final = 8
"""Up to so many jobs are read one by one, more of them from the list of jobs."""
_PAGE: Final = 500
_HDF5: Final = {"Accept": "application/x-hdf5"}
_ARRAYS: Final = {"Accept": f"{entries.MEDIA_TYPE}, application/x-hdf5;q=0.5"}
"""For results that go to memory. Large ones come as HDF5, and so do those of a service that has
no other form.
"""


class Send(TypedDict):
    """A request to send; the conversation receives its response, of any status, or `NoAnswer`."""

    method: str
    url: str
    json: Any
    params: Mapping[str, str] | None
    headers: Mapping[str, str]
    to: NotRequired[Path]
    """Where the body of a successful response goes, instead of to memory."""


@dataclass(frozen=True, slots=True)
class Pause:
    """A pause in seconds before an attempt, counted from 1 at the first repetition."""

    seconds: float
    attempt: int


class GiveUp:
    """The answer to a pause: there are no more attempts."""


@dataclass(frozen=True, slots=True)
class NoAnswer:
    """A request without a response: connecting, sending or receiving failed."""

    url: str
    error: httpx2.TransportError


Reply = httpx2.Response | NoAnswer | GiveUp | None
Conversation = Generator[Send | Pause, Reply, Outcome]


def request(
    method: str,
    path: str,
    *,
    json: Any = None,
    params: Mapping[str, str] | None = None,
    headers: Mapping[str, str] | None = None,
    to: Path | None = None,
) -> Conversation[httpx2.Response]:
    """Send a request, repeat it after temporary failures, and return the successful response.

    How often it is repeated is decided by the transport. With `to` the body goes to that file.

    Raise `ConnectionFailed` if the service does not respond, `ServerError` if it responds with a
    problem document.
    """
    step = Send(method=method, url=path, json=json, params=params, headers=headers or {})
    if to is not None:
        step["to"] = to
    for attempt in count():
        answer = yield step
        if isinstance(answer, httpx2.Response):
            if answer.status_code < 400:
                return answer
            problem = _problem(answer)
            again = answer.status_code in _RETRIED and problem.get("retryable", True)
            wait = Pause(_pause(attempt, answer.headers.get("Retry-After")), attempt + 1)
            if not again or isinstance((yield wait), GiveUp):
                raise from_problem(problem)
        elif isinstance(answer, NoAnswer):
            given_up = yield Pause(_pause(attempt, None), attempt + 1)
            if isinstance(given_up, GiveUp):
                message = f"no answer from {answer.url}: {answer.error}"
                raise ConnectionFailed(message) from answer.error
    raise AssertionError("the last attempt returns or raises")


def read(method: str, path: str, **options: Any) -> Conversation[Any]:
    """Send a request and return the document that answers it; parameters as of `request`."""
    answer = yield from request(method, path, **options)
    return answer.json()


def not_finite(content: Any, pointer: str = "") -> InvalidRequest | None:
    """Return the error of a document with a NaN or an infinity, which JSON cannot represent."""
    if isinstance(content, float) and not math.isfinite(content):
        fault = {"pointer": pointer, "code": "not_finite", "message": f"{content} is not finite"}
        detail = f"{pointer}: {fault['message']}"
        known = {"status": 422, "code": "invalid_request", "detail": detail}
        return InvalidRequest(known | {"errors": [fault]})
    parts: Iterable[tuple[Any, Any]] = ()
    if isinstance(content, Mapping):
        parts = content.items()
    elif isinstance(content, list | tuple):
        parts = enumerate(content)
    errors = (not_finite(part, f"{pointer}/{name}") for name, part in parts)
    return next((error for error in errors if error is not None), None)


def _pause(attempt: int, retry_after: str | None) -> float:
    if retry_after is not None and retry_after.isdecimal():
        return min(float(retry_after), _LONGEST_PAUSE)
    return min(_LONGEST_BACKOFF, _FIRST_BACKOFF * 2.0**attempt) * random.uniform(0.5, 1.0)


def _problem(answer: httpx2.Response) -> Document:
    try:
        problem = answer.json()
    except ValueError:
        problem = None
    if not isinstance(problem, dict):
        problem = {"detail": answer.text[:200]}
    return {"status": answer.status_code} | problem


# -- Computations -------------------------------------------------------------------------


def ask(
    kind: str, content: Mapping[str, Any], cache: Cache | None = None
) -> Conversation[bytes | Parts | documents.Job]:
    """Return the result, or the job in which the service computes it.

    With a cache, a result that is in it is not sent again, and serves where no service answers.
    """
    kind, content = hyphenated(kind), plain(content)
    known = None if cache is None else cache.known(kind, content)
    kept = None if cache is None or known is None else cache.result(known.digest)
    headers = dict(_ARRAYS if cache is None else _HDF5)
    if kept is not None and known is not None and known.etag is not None:
        headers["If-None-Match"] = known.etag
    try:
        path = f"/v1/compute/{kind}"
        answer = yield from request("POST", path, json=content, headers=headers)
    except ConnectionFailed:
        if kept is None:
            raise
        return kept
    if answer.status_code == 304 and kept is not None:
        return kept
    if answer.status_code == 202:
        job: documents.Job = answer.json()
        return job
    if cache is not None:
        digest = cache.keep(answer.content)
        cache.learn(kind, content, digest, answer.headers.get("ETag"))
    return _content(answer)


def _content(answer: httpx2.Response) -> bytes | Parts:
    """Return what an answer has of a result: its file, or its parts."""
    if answer.headers.get("Content-Type") != entries.MEDIA_TYPE:
        return answer.content
    try:
        return Parts(entries.unpack(answer.content))
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        message = f"the service answered with arrays that are damaged: {error}"
        raise VibroimpactError(message) from None


def plan(kind: str, content: Mapping[str, Any]) -> Conversation[documents.Plan]:
    """Return the plan of a request."""
    return read("POST", f"/v1/plan/{hyphenated(kind)}", json=plain(content))


def result(
    digest: str, to: Path | None = None, cache: Cache | None = None
) -> Conversation[bytes | Parts | Path]:
    """Return a result by its digest, or write its file to a path and return that."""
    kept = None if cache is None or to is not None else cache.result(digest)
    if kept is not None:
        return kept
    return (yield from _file(f"/v1/results/{digest}", to, cache))


def _file(address: str, to: Path | None, cache: Cache | None) -> Conversation[bytes | Parts | Path]:
    headers = _ARRAYS if to is None and cache is None else _HDF5
    answer = yield from request("GET", address, headers=headers, to=to)
    if to is not None:
        return to
    if cache is not None:
        cache.keep(answer.content)
    return _content(answer)


def store(system: Mapping[str, Any]) -> Conversation[documents.SystemReference]:
    """Store a system; return the document that stands for it."""
    answer = yield from request("POST", "/v1/systems", json=plain(system))
    return {"id": answer.json()["id"]}


def batch(
    kind: str, contents: Sequence[Mapping[str, Any]]
) -> Conversation[list[Mapping[str, Any] | ServerError]]:
    """Return the result document of each request, or its error."""
    body = {"kind": hyphenated(kind), "requests": [plain(content) for content in contents]}
    answer = yield from request("POST", "/v1/batch", json=body)
    answers = [
        one["result"] if one.get("problem") is None else from_problem(one["problem"])
        for one in answer.json()["answers"]
    ]
    results = [one for one in answers if not isinstance(one, ServerError)]
    neglected, cautions = (
        list(dict.fromkeys(text for one in results for text in one.get(name) or ()))
        for name in ("neglected", "cautions")
    )
    warn_of_structure(kind, neglected, cautions)
    return answers


def version() -> Conversation[documents.Version]:
    """Return the version, kinds and limits of the service."""
    return read("GET", "/v1/version")


# -- Jobs ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Terms:
    """The terms on which jobs are queued: priority, deadline in seconds from now, webhook, name."""

    priority: int = 0
    deadline: float | None = None
    webhook: documents.Webhook | None = None
    name: str | None = None

    def document(self) -> Document:
        """Return the fields of a job document that state them."""
        optional = {
            "deadline_seconds": self.deadline,
            "webhook": self.webhook and dict(self.webhook),
            "name": self.name,
        }
        given = {name: value for name, value in optional.items() if value is not None}
        return {"priority": self.priority} | given


def submit(kind: str, content: Mapping[str, Any], terms: Terms) -> Conversation[documents.Job]:
    """Queue a computation and return its job."""
    body = {"kind": hyphenated(kind), "request": plain(content), **terms.document()}
    # The same key in all attempts, so that there is one job. Requests that are answered at once
    # have none: repeated, they get the same result, and to record a key takes longer than that.
    return read("POST", "/v1/jobs", json=body, headers={"Idempotency-Key": uuid.uuid4().hex})


def submit_many(
    kind: str, contents: Sequence[Mapping[str, Any]], terms: Terms
) -> Conversation[list[documents.Job | ServerError]]:
    """Queue computations; return the job of each, or its error."""
    answers: list[documents.Job | ServerError] = []
    for content in contents:
        try:
            answers.append((yield from submit(kind, content, terms)))
        except ServerError as error:
            answers.append(error)
    return answers


def job(job_id: str) -> Conversation[documents.Job]:
    """Return a job by its id."""
    return read("GET", f"/v1/jobs/{job_id}")


def job_page(params: Mapping[str, str]) -> Conversation[Document]:
    """Return a page of jobs."""
    return read("GET", "/v1/jobs", params=params)


def look(document: documents.Job, wait: float = 0.0) -> Conversation[documents.Job]:
    """Read a job again, waiting up to `wait` seconds for a change."""
    params = None
    if wait > 0:
        params = {"wait": f"{wait:g}", "since": str(document["version"])}
    return read("GET", f"/v1/jobs/{document['id']}", params=params)


def wait(
    document: documents.Job, timeout: float | None, note: Callable[[documents.Job], None]
) -> Conversation[documents.Job]:
    """Return a job once it has ended; call `note` with every change.

    Raise `JobTimeout` if it has not ended within `timeout` seconds; the job continues.
    """
    deadline = None if timeout is None else time.monotonic() + timeout
    while not document["final"]:
        left = _POLL if deadline is None else min(_POLL, deadline - time.monotonic())
        if left <= 0:
            message = f"job {document['id']} is {document['state']} after {timeout:g} s"
            raise JobTimeout(message)
        document = yield from look(document, max(left, 0.01))
        note(document)
    return document


def first_final(
    jobs: Sequence[documents.Job], timeout: float | None
) -> Conversation[tuple[list[int], list[documents.Job]]]:
    """Wait until a job has ended; return the indices of those that have, and all jobs as read.

    Raise `JobTimeout` if none has ended within `timeout` seconds; the jobs continue.
    """
    deadline = None if timeout is None else time.monotonic() + timeout
    pause, current = 0.25, list(jobs)
    while True:
        final = [index for index, document in enumerate(current) if document["final"]]
        if final:
            return final, current
        left = pause if deadline is None else min(pause, deadline - time.monotonic())
        if left <= 0:
            raise JobTimeout(f"none of {len(current)} jobs has ended after {timeout:g} s")
        # Waiting for the first job is a pause that ends early; then all of them are read.
        current[0] = yield from look(current[0], left)
        if len(current) > _FEW:
            current = yield from _look_at_many(current)
        else:
            for index in range(1, len(current)):
                current[index] = yield from look(current[index])
        pause = min(10.0, 1.5 * pause)


def _look_at_many(jobs: Sequence[documents.Job]) -> Conversation[list[documents.Job]]:
    """Read jobs again by pages of the list of all jobs, newest first.

    Pages are read as long as they contain some of the jobs; the remaining ones are read singly.
    """
    left = {document["id"]: index for index, document in enumerate(jobs)}
    current, params = list(jobs), {"limit": str(_PAGE)}
    while left:
        page = yield from job_page(params)
        listed = [document for document in page["jobs"] if document["id"] in left]
        for document in listed:
            current[left.pop(document["id"])] = document
        if page["next"] is None or not listed:
            break
        params["cursor"] = page["next"]
    for index in left.values():
        current[index] = yield from look(current[index])
    return current


def cancel(document: documents.Job) -> Conversation[documents.Job]:
    """Cancel a job and return it."""
    yield from request("DELETE", f"/v1/jobs/{document['id']}")
    return (yield from look(document))


def job_result(
    document: documents.Job, to: Path | None = None, cache: Cache | None = None
) -> Conversation[bytes | Parts | Path]:
    """Return the result of a job, or write its file to a path and return that."""
    return _file(f"/v1/jobs/{document['id']}/result", to, cache)


def share(document: documents.Job, readers: Sequence[str]) -> Conversation[list[str]]:
    """Share a job with exactly these owners, and return them."""
    address = f"/v1/jobs/{document['id']}/share"
    if readers:
        answer = yield from request("PUT", address, json={"readers": list(readers)})
    else:
        answer = yield from request("DELETE", address)
    return list(answer.json()["readers"])


def readers(document: documents.Job) -> Conversation[list[str]]:
    """Return the owners with whom a job is shared."""
    answer = yield from request("GET", f"/v1/jobs/{document['id']}/share")
    return list(answer.json()["readers"])
