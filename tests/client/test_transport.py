"""Retries, idempotency keys and problems, against a transport that plays the service."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import httpx2
import pytest

from vibroimpact import conversations, errors
from vibroimpact.transport import Transport


class Played:
    """Answers in order, and remembers the requests."""

    def __init__(self, *answers: httpx2.Response | Exception) -> None:
        self.answers, self.requests = list(answers), []

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        self.requests.append(request)
        answer = self.answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def ask(self, method: str, path: str, json: Any = None) -> httpx2.Response:
        transport = Transport("http://service", 5.0, httpx2.MockTransport(self))
        return transport.hold(conversations.request(method, path, json=json))


pytestmark = pytest.mark.usefixtures("pauses")


def problem(status: int, **more: object) -> httpx2.Response:
    return httpx2.Response(status, json={"status": status, "detail": "so", "code": "x"} | more)


def test_a_passing_fault_of_a_job_is_tried_again_with_the_same_key(pauses: list[float]) -> None:
    played = Played(
        httpx2.ConnectError("down"),
        problem(503),
        httpx2.Response(200, json={"ok": True}),
    )
    transport = Transport("http://service", 5.0, httpx2.MockTransport(played))
    submitted = conversations.submit("impact-modes", {}, conversations.Terms())
    assert transport.hold(submitted) == {"ok": True}
    keys = {request.headers["Idempotency-Key"] for request in played.requests}
    assert len(keys) == 1
    assert len(pauses) == 2


def test_what_is_answered_at_once_is_tried_again_without_a_key(pauses: list[float]) -> None:
    played = Played(httpx2.ConnectError("down"), httpx2.Response(200, content=b"file"))
    transport = Transport("http://service", 5.0, httpx2.MockTransport(played))
    assert transport.hold(conversations.ask("impact-modes", {})) == b"file"
    assert not any("Idempotency-Key" in request.headers for request in played.requests)
    assert len(pauses) == 1


def test_retry_after_is_obeyed(pauses: list[float]) -> None:
    busy = httpx2.Response(429, json={"detail": "busy"}, headers={"Retry-After": "7"})
    played = Played(busy, httpx2.Response(200, json=1))
    played.ask("GET", "/v1/x")
    assert pauses == [7.0]


def test_retry_after_that_is_no_number_is_none(pauses: list[float]) -> None:
    busy = httpx2.Response(429, json={"detail": "busy"}, headers=[(b"Retry-After", b"\xb2")])
    played = Played(busy, httpx2.Response(200, json=1))
    played.ask("GET", "/v1/x")
    assert len(pauses) == 1
    assert pauses[0] < 1.0


def test_what_the_service_calls_final_is_not_tried_again() -> None:
    played = Played(problem(500, retryable=False))
    with pytest.raises(errors.Unavailable):
        played.ask("GET", "/v1/x")
    assert len(played.requests) == 1


def test_a_dead_service_is_given_up_on() -> None:
    played = Played(*[httpx2.ConnectError("down")] * 4)
    with pytest.raises(errors.ConnectionFailed, match="http://service"):
        played.ask("GET", "/v1/x")


@pytest.mark.parametrize(
    ("status", "kind"),
    [
        (400, errors.InvalidRequest),
        (401, errors.AccessDenied),
        (404, errors.NotFound),
        (413, errors.TooLarge),
        (418, errors.ServerError),
        (422, errors.InvalidRequest),
    ],
)
def test_problems_become_exceptions(status: int, kind: type[Exception]) -> None:
    faults = [{"pointer": "/system/K", "message": "not symmetric", "code": "not_symmetric"}]
    played = Played(problem(status, errors=faults, request_id="r1"))
    with pytest.raises(kind) as caught:
        played.ask("GET", "/v1/x")
    assert caught.value.status == status
    assert caught.value.request_id == "r1"
    assert "/system/K: not symmetric" in str(caught.value)


def test_an_answer_that_is_no_problem_document_is_reported() -> None:
    played = Played(httpx2.Response(404, text="<html>proxy</html>"))
    with pytest.raises(errors.NotFound, match="proxy"):
        played.ask("GET", "/v1/x")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"system": {"K": [[1.0, 2.0], [2.0, float("nan")]]}}, "/system/K/1/1: nan is not finite"),
        ({"t_end": float("inf")}, "/t_end: inf is not finite"),
    ],
)
def test_numbers_that_json_has_not_are_named_before_anything_is_sent(
    content: dict[str, object], said: str
) -> None:
    played = Played()
    with pytest.raises(errors.InvalidRequest) as caught:
        played.ask("POST", "/v1/x", json=content)
    assert str(caught.value) == said
    assert caught.value.errors[0]["pointer"] == said.partition(":")[0]
    assert played.requests == []


def test_a_fault_is_said_once() -> None:
    fault = {"pointer": "/a", "code": "x", "message": "is wrong"}
    more = {"pointer": "/b", "code": "x", "message": "too"}
    one = errors.from_problem({"status": 422, "detail": "/a: is wrong", "errors": [fault]})
    assert str(one) == "/a: is wrong"
    two = {"status": 422, "detail": "/a: is wrong (and 1 more)", "errors": [fault, more]}
    assert str(errors.from_problem(two)) == "/a: is wrong\n  /b: too"
    other = errors.from_problem({"status": 413, "detail": "too much", "errors": [fault]})
    assert str(other) == "too much\n  /a: is wrong"


def test_the_number_of_retries_is_chosen(pauses: list[float]) -> None:
    for retries, sent in ((0, 1), (1, 2), (6, 7)):
        played = Played(*[httpx2.ConnectError("down")] * 10)
        transport = Transport("http://service", 5.0, httpx2.MockTransport(played), retries=retries)
        with pytest.raises(errors.ConnectionFailed):
            transport.hold(conversations.version())
        assert len(played.requests) == sent
    assert len(pauses) == 0 + 1 + 6


def test_a_streamed_result_goes_to_its_file_alone(tmp_path: Path) -> None:
    answer = httpx2.Response(200, content=iter([b"one", b"two"]))
    transport = Transport(
        "http://service", 5.0, httpx2.MockTransport(Played(httpx2.ConnectError("down"), answer))
    )
    path = tmp_path / "result.h5"
    assert transport.hold(conversations.job_result({"id": "a"}, path)) == path
    assert path.read_bytes() == b"onetwo"
    assert [each.name for each in tmp_path.iterdir()] == ["result.h5"]


@pytest.mark.parametrize(
    "content",
    [b"", b"<html>gateway</html>", (4).to_bytes(8, "little") + b"null",
     (16).to_bytes(8, "little") + b'[["array",["x"]]', (28).to_bytes(8, "little")
     + b'[["link",["a","b"]]]        ', (2**63).to_bytes(8, "little") + b"[]"],
)  # fmt: skip
def test_arrays_that_are_damaged_are_an_error_of_the_client(content: bytes) -> None:
    headers = {"Content-Type": "application/x-vibroimpact"}
    played = Played(httpx2.Response(200, content=content, headers=headers))
    transport = Transport("http://service", 5.0, httpx2.MockTransport(played))
    with pytest.raises(errors.VibroimpactError, match="arrays that are damaged"):
        transport.hold(conversations.ask("impact-modes", {}))
