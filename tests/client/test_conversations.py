"""Every conversation is the same, whether it is waited for or awaited."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import httpx2
import pytest

from vibroimpact import conversations, errors
from vibroimpact.jobs import Submitted
from vibroimpact.transport import AsyncTransport, Transport

Hold = Callable[..., Any]


class Service:
    """Plays jobs that end after they were looked at a number of times."""

    def __init__(self, **looks: int) -> None:
        self.looks = looks
        self.seen: list[str] = []
        self.keys: list[str | None] = []
        self.bodies: list[Any] = []

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        self.seen.append(f"{request.method} {request.url.path}")
        self.keys.append(request.headers.get("Authorization"))
        name = request.url.path.rpartition("/")[2]
        if request.method == "POST":
            self.bodies.append(json.loads(request.content))
            if b"bad" in request.content:
                return httpx2.Response(422, json={"detail": "bad", "code": "x"})
            return httpx2.Response(201, json=self.job("new", reused=b"known" in request.content))
        self.looks[name] -= 1
        return httpx2.Response(200, json=self.job(name, final=self.looks[name] <= 0))

    def job(self, name: str, *, final: bool = False, reused: bool = False) -> dict[str, Any]:
        state = "succeeded" if final else "running"
        return {"id": name, "version": 1, "state": state, "final": final, "reused": reused}


@pytest.fixture(params=["waiting", "async"])
def hold(request: pytest.FixtureRequest) -> Hold:
    """Return the function that holds a conversation with a played service."""

    def waiting(service: Service, conversation: Any, key: str | None = None) -> Any:
        transport = Transport("http://service", 5.0, httpx2.MockTransport(service), key)
        try:
            return transport.hold(conversation)
        finally:
            transport.close()

    def awaited(service: Service, conversation: Any, key: str | None = None) -> Any:
        async def holding() -> Any:
            transport = AsyncTransport("http://service", 5.0, httpx2.MockTransport(service), key)
            try:
                return await transport.hold(conversation)
            finally:
                await transport.close()

        return asyncio.run(holding())

    return waiting if request.param == "waiting" else awaited


@pytest.fixture(autouse=True)
def pauses(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    pauses: list[float] = []

    async def sleep(seconds: float) -> None:
        pauses.append(seconds)

    # Those of the transport alone: other threads of this process sleep as well.
    monkeypatch.setattr("vibroimpact.transport.time", SimpleNamespace(sleep=pauses.append))
    monkeypatch.setattr("vibroimpact.transport.asyncio", SimpleNamespace(sleep=sleep))
    return pauses


def test_a_job_is_looked_at_until_it_is_final(hold: Hold) -> None:
    service, noted = Service(a=3), []
    final = hold(service, conversations.wait(service.job("a"), None, noted.append))
    assert final["final"]
    assert [document["final"] for document in noted] == [False, False, True]


def test_waiting_ends_with_the_time(hold: Hold) -> None:
    service = Service(a=99)
    with pytest.raises(errors.JobTimeout, match="job a is running"):
        hold(service, conversations.wait(service.job("a"), 0.0, lambda _: None))


def test_the_first_final_of_many(hold: Hold) -> None:
    service = Service(a=5, b=2, c=2)
    jobs = [service.job(name) for name in "abc"]
    final, current = hold(service, conversations.first_final(jobs, None))
    assert final == [1, 2]
    assert [document["final"] for document in current] == [False, True, True]
    with pytest.raises(errors.JobTimeout, match="none of 1 jobs has ended"):
        hold(service, conversations.first_final(current[:1], 0.0))


def test_one_wrong_request_does_not_keep_the_others(hold: Hold) -> None:
    requests = [{"n": "fine"}, {"n": "bad"}, {"n": "known"}]
    answers = hold(Service(), conversations.submit_many("kind", requests, conversations.Terms()))
    sorted_out = Submitted.of(answers, lambda document: document["id"])
    assert (len(sorted_out.inserted), len(sorted_out.existing)) == (1, 1)
    assert sorted_out.jobs == ["new", "new"]
    assert sorted_out.of_request == {0: "new", 2: "new"}
    assert isinstance(sorted_out.errors[1], errors.InvalidRequest)


def test_jobs_are_in_the_order_of_their_requests() -> None:
    """New jobs and those whose results exist alternate; one request is refused."""
    refused = errors.ServerError({"status": 422})
    answers = [{"id": "a", "reused": False}, {"id": "b", "reused": True}, refused]
    answers += [{"id": "c", "reused": False}, {"id": "d", "reused": True}]
    submitted = Submitted.of(answers, lambda document: document["id"])
    assert submitted.jobs == ["a", "b", "c", "d"]
    assert submitted.of_request == {0: "a", 1: "b", 3: "c", 4: "d"}
    assert (submitted.inserted, submitted.existing) == (["a", "c"], ["b", "d"])


def test_jobs_are_queued_on_the_terms_that_are_given(hold: Hold) -> None:
    service = Service()
    hook = {"url": "https://example.org/hook", "secret": "whsec_" + "A" * 32}
    hold(service, conversations.submit("kind", {}, conversations.Terms(3, 60.0, hook)))
    hold(service, conversations.submit("kind", {}, conversations.Terms()))
    assert service.bodies == [
        {"kind": "kind", "request": {}, "priority": 3, "deadline_seconds": 60.0, "webhook": hook},
        {"kind": "kind", "request": {}, "priority": 0},
    ]


def test_the_key_goes_with_every_request(hold: Hold) -> None:
    service = Service(a=1)
    hold(service, conversations.job("a"), "vik_mine")
    assert service.keys == ["Bearer vik_mine"]
    hold(service, conversations.job("a"))
    assert service.keys[1] is None


def test_passing_faults_are_tried_again(hold: Hold, pauses: list[float]) -> None:
    answers: list[Any] = [
        httpx2.ConnectError("down"),
        httpx2.Response(503, json={"detail": "so"}, headers={"Retry-After": "3"}),
        httpx2.Response(200, json={"version": "1"}),
    ]

    def service(request: httpx2.Request) -> httpx2.Response:
        answer = answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        response: httpx2.Response = answer
        return response

    assert hold(service, conversations.version()) == {"version": "1"}
    assert pauses[1:] == [3.0]


def test_a_dead_service_is_given_up_on(hold: Hold) -> None:
    def service(request: httpx2.Request) -> httpx2.Response:
        raise httpx2.ConnectError("down")

    with pytest.raises(errors.ConnectionFailed, match="http://service"):
        hold(service, conversations.version())


def test_jobs_are_shared_and_no_longer(hold: Hold) -> None:
    seen: list[tuple[str, str, bytes]] = []

    def service(request: httpx2.Request) -> httpx2.Response:
        seen.append((request.method, request.url.path, request.content))
        return httpx2.Response(200, json={"job": "a", "owner": "ann", "readers": ["bob"]})

    assert hold(service, conversations.share({"id": "a"}, ["bob"])) == ["bob"]
    hold(service, conversations.share({"id": "a"}, []))
    assert hold(service, conversations.readers({"id": "a"})) == ["bob"]
    assert [method for method, _, _ in seen] == ["PUT", "DELETE", "GET"]
    assert {path for _, path, _ in seen} == {"/v1/jobs/a/share"}
    assert b"bob" in seen[0][2]


class ManyJobs:
    """Plays a service whose jobs are listed ten a page, some final at the second round."""

    def __init__(self, ours: int, others: int) -> None:
        self.names = [f"other{i}" for i in range(others)] + [f"job{i}" for i in range(ours)]
        self.listed = self.looked = self.rounds = 0

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        if request.url.path != "/v1/jobs":
            self.looked += 1
            return httpx2.Response(200, json=self.job(request.url.path.rpartition("/")[2]))
        self.listed += 1
        self.rounds += "cursor" not in request.url.params
        start = int(request.url.params.get("cursor", 0))
        stop = start + 10
        page = {"jobs": [self.job(name) for name in self.names[start:stop]]}
        return httpx2.Response(
            200, json=page | {"next": str(stop) if stop < len(self.names) else None}
        )

    def job(self, name: str) -> dict[str, Any]:
        final = self.rounds >= 2 and name.endswith(("3", "7"))
        return {"id": name, "version": 1, "state": "running", "final": final, "reused": False}


@pytest.mark.parametrize(("others", "looks"), [(0, 2), (5, 2)])
def test_many_jobs_are_looked_for_in_pages(hold: Hold, others: int, looks: int) -> None:
    """Thirty of them: three or four exchanges for all instead of thirty."""
    service = ManyJobs(30, others)
    documents = [service.job(f"job{i}") for i in range(30)]
    final, current = hold(service, conversations.first_final(documents, 60.0))
    assert [current[place]["id"] for place in final] == [
        f"job{i}" for i in range(30) if i % 10 in (3, 7)
    ]
    assert [one["id"] for one in current] == [f"job{i}" for i in range(30)]
    assert service.looked <= looks


def test_jobs_behind_those_of_others_are_looked_at_one_by_one(hold: Hold) -> None:
    service = ManyJobs(30, 100)
    documents = [service.job(f"job{i}") for i in range(30)]
    final, current = hold(service, conversations.first_final(documents, 60.0))
    assert len(final) == 6
    assert [one["id"] for one in current] == [f"job{i}" for i in range(30)]
    # Each round asks for one page, which has none of ours, and then for all of them.
    assert service.looked == 31 * service.listed


def test_a_wait_ends_with_any_change_since_the_version_that_is_known() -> None:
    known = {"id": "a", "version": 7}
    waiting = next(conversations.look(known, 12.5))
    assert isinstance(waiting, dict)
    assert waiting["params"] == {"wait": "12.5", "since": "7"}
    at_once = next(conversations.look(known))
    assert isinstance(at_once, dict)
    assert at_once["params"] is None
