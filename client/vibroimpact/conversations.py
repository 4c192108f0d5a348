"""Conversations with the service, each written once and held by `transport`, waiting or async.

A conversation is a generator: it yields what is to be sent and how long to pause, is given the
answers, and returns its outcome.
"""

from __future__ import annotations

import math
import random
import time
import uuid
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, TypeVar

# httpx2 is the maintained successor of httpx, with the same interface.
import httpx2

from vibroimpact.errors import (
    ConnectionFailed,
    InvalidRequest,
    JobTimeout,
    ServerError,
    from_problem,
)

Document = dict[str, Any]
Outcome = TypeVar("Outcome")

_AGAIN: Final = frozenset({408, 429, 500, 502, 503, 504})
_TRIES: Final = 4
_LONGEST_PAUSE: Final = 120.0
_POLL: Final = 25.0
"""Longest look at a job; the service answers earlier when something changes."""
_FEW: Final = 8
"""Jobs that are looked at one by one; more are looked for in the list of jobs."""
_PAGE: Final = 500
_HDF5: Final = {"Accept": "application/x-hdf5"}


@dataclass(frozen=True, slots=True)
class Send:
    """A request to be sent; its answer is given back, good or bad, or a `NoAnswer`."""

    method: str
    path: str
    json: Any = None
    params: Mapping[str, str] | None = None
    headers: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Pause:
    """A time to wait, in seconds."""

    seconds: float


@dataclass(frozen=True, slots=True)
class NoAnswer:
    """Nobody answered at an address."""

    url: str
    error: httpx2.TransportError


Reply = httpx2.Response | NoAnswer | None
Conversation = Generator[Send | Pause, Reply, Outcome]


def request(
    method: str,
    path: str,
    *,
    json: Any = None,
    params: Mapping[str, str] | None = None,
    headers: Mapping[str, str] | None = None,
) -> Conversation[httpx2.Response]:
    """Send a request, again where that is safe, and return a good answer.

    Raises
    ------
    ConnectionFailed
        Where nobody answers.
    ServerError
        Where the answer is a problem.
    """
    sent = dict(headers or {})
    if method == "POST":
        # The same for all tries, so that the service does it once.
        sent.setdefault("Idempotency-Key", uuid.uuid4().hex)
    for turn in range(_TRIES):
        last = turn == _TRIES - 1
        answer = yield Send(method, path, json, params, sent)
        if isinstance(answer, httpx2.Response):
            if answer.status_code < 400:
                return answer
            problem = _problem(answer)
            again = answer.status_code in _AGAIN and problem.get("retryable", True)
            if last or not again:
                raise from_problem(problem)
            yield Pause(_pause(turn, answer.headers.get("Retry-After")))
        elif isinstance(answer, NoAnswer):
            if last:
                message = f"no answer from {answer.url}: {answer.error}"
                raise ConnectionFailed(message) from answer.error
            yield Pause(_pause(turn, None))
    raise AssertionError("every try returns or raises in the end")


def not_finite(content: Any, pointer: str = "") -> InvalidRequest | None:
    """Return the error of a document that holds a number which JSON has not: the first of them."""
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
    found = (not_finite(part, f"{pointer}/{name}") for name, part in parts)
    return next((error for error in found if error is not None), None)


def _pause(turn: int, asked: str | None) -> float:
    if asked is not None and asked.isdigit():
        return min(float(asked), _LONGEST_PAUSE)
    return min(8.0, 0.5 * 2.0**turn) * random.uniform(0.5, 1.0)


def _problem(answer: httpx2.Response) -> Document:
    try:
        problem = answer.json()
    except ValueError:
        problem = None
    if not isinstance(problem, dict):
        problem = {"detail": answer.text[:200]}
    return {"status": answer.status_code} | problem


# -- Computations -------------------------------------------------------------------------


def ask(kind: str, content: Mapping[str, Any]) -> Conversation[bytes | Document]:
    """Return the file of a result, or the job that the service makes of the request."""
    path = f"/v1/compute/{kind}"
    answer = yield from request("POST", path, json=dict(content), headers=_HDF5)
    return dict(answer.json()) if answer.status_code == 202 else answer.content


def plan(kind: str, content: Mapping[str, Any]) -> Conversation[Document]:
    """Return the plan of a request."""
    answer = yield from request("POST", f"/v1/plan/{kind}", json=dict(content))
    return dict(answer.json())


def result(digest: str) -> Conversation[bytes]:
    """Return the file of a result by its name."""
    answer = yield from request("GET", f"/v1/results/{digest}", headers=_HDF5)
    return answer.content


def store(system: Mapping[str, Any]) -> Conversation[Document]:
    """Keep a system; return the document that stands for it."""
    answer = yield from request("POST", "/v1/systems", json=dict(system))
    return {"id": answer.json()["id"]}


def batch(
    kind: str, contents: Sequence[Mapping[str, Any]]
) -> Conversation[list[Document | ServerError]]:
    """Return the result document of each request, or the problem that it met."""
    body = {"kind": kind, "requests": [dict(content) for content in contents]}
    answer = yield from request("POST", "/v1/batch", json=body)
    return [
        one["result"] if one.get("problem") is None else from_problem(one["problem"])
        for one in answer.json()["answers"]
    ]


def version() -> Conversation[Document]:
    """Return what the service is and can."""
    answer = yield from request("GET", "/v1/version")
    return dict(answer.json())


# -- Jobs ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Terms:
    """On which terms jobs are queued: priority, seconds in which they must be done, webhook."""

    priority: int = 0
    deadline: float | None = None
    webhook: Mapping[str, str] | None = None

    def document(self) -> Document:
        """Return the members of a job's document that say so."""
        found: Document = {"priority": self.priority}
        if self.deadline is not None:
            found["deadline_seconds"] = self.deadline
        if self.webhook is not None:
            found["webhook"] = dict(self.webhook)
        return found


def submit(kind: str, content: Mapping[str, Any], terms: Terms) -> Conversation[Document]:
    """Queue a computation and return its job."""
    body = {"kind": kind, "request": dict(content), **terms.document()}
    answer = yield from request("POST", "/v1/jobs", json=body)
    return dict(answer.json())


def submit_many(
    kind: str, contents: Sequence[Mapping[str, Any]], terms: Terms
) -> Conversation[list[Document | ServerError]]:
    """Queue computations; return the job of each, or the problem that it met."""
    found: list[Document | ServerError] = []
    for content in contents:
        try:
            found.append((yield from submit(kind, content, terms)))
        except ServerError as error:
            found.append(error)
    return found


def job(job_id: str) -> Conversation[Document]:
    """Return a job by its id."""
    answer = yield from request("GET", f"/v1/jobs/{job_id}")
    return dict(answer.json())


def job_page(params: Mapping[str, str]) -> Conversation[Document]:
    """Return a page of jobs."""
    answer = yield from request("GET", "/v1/jobs", params=params)
    return dict(answer.json())


def look(document: Document, wait: float = 0.0) -> Conversation[Document]:
    """Return a job anew, after waiting up to so many seconds for a change."""
    params = None
    if wait > 0:
        params = {"wait": f"{wait:g}", "since": str(document["version"])}
    answer = yield from request("GET", f"/v1/jobs/{document['id']}", params=params)
    return dict(answer.json())


def wait(
    document: Document, timeout: float | None, note: Callable[[Document], None]
) -> Conversation[Document]:
    """Return a job once it is final; `note` is told whenever it changed.

    Raises
    ------
    JobTimeout
        Where the time is over; the job goes on.
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
    documents: Sequence[Document], timeout: float | None
) -> Conversation[tuple[list[int], list[Document]]]:
    """Return the places of the jobs that are final, as soon as there are any, and all jobs anew.

    Raises
    ------
    JobTimeout
        Where the time is over; the jobs go on.
    """
    deadline = None if timeout is None else time.monotonic() + timeout
    pause, found = 0.25, list(documents)
    while True:
        final = [place for place, document in enumerate(found) if document["final"]]
        if final:
            return final, found
        left = pause if deadline is None else min(pause, deadline - time.monotonic())
        if left <= 0:
            raise JobTimeout(f"{len(found)} jobs are not final after {timeout:g} s")
        # One is waited for, as a pause that ends early; then all are looked at.
        found[0] = yield from look(found[0], left)
        if len(found) > _FEW:
            found = yield from _look_at_many(found)
        else:
            for place in range(1, len(found)):
                found[place] = yield from look(found[place])
        pause = min(10.0, 1.5 * pause)


def _look_at_many(documents: Sequence[Document]) -> Conversation[list[Document]]:
    """Return jobs anew, by pages of the list of all jobs, newest first, as long as they bring any.

    What lies further back than other jobs fill a page is looked at one by one.
    """
    left = {document["id"]: place for place, document in enumerate(documents)}
    found, params = list(documents), {"limit": str(_PAGE)}
    while left:
        page = yield from job_page(params)
        mine = [one for one in page["jobs"] if one["id"] in left]
        for one in mine:
            found[left.pop(one["id"])] = one
        if page["next"] is None or not mine:
            break
        params["cursor"] = page["next"]
    for place in left.values():
        found[place] = yield from look(found[place])
    return found


def cancel(document: Document) -> Conversation[Document]:
    """Cancel a job and return it."""
    yield from request("DELETE", f"/v1/jobs/{document['id']}")
    return (yield from look(document))


def job_result(document: Document) -> Conversation[bytes]:
    """Return the file of the result of a job that succeeded."""
    answer = yield from request("GET", f"/v1/jobs/{document['id']}/result", headers=_HDF5)
    return answer.content


def share(document: Document, readers: Sequence[str]) -> Conversation[list[str]]:
    """Let exactly these see a job, and return them."""
    address = f"/v1/jobs/{document['id']}/share"
    if readers:
        answer = yield from request("PUT", address, json={"readers": list(readers)})
    else:
        answer = yield from request("DELETE", address)
    return list(answer.json()["readers"])


def readers(document: Document) -> Conversation[list[str]]:
    """Return who may see a job beside its owner."""
    answer = yield from request("GET", f"/v1/jobs/{document['id']}/share")
    return list(answer.json()["readers"])
