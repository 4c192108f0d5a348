"""Shared jobs: seen by those who were named, by nobody else, and only seen."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
from starlette.testclient import TestClient

from vibroimpact_service.access import shared_results
from vibroimpact_service.access.authenticator import Authenticator

Headers = dict[str, str]


@pytest.fixture
def eve(make_key: Any) -> Headers:
    found: Headers = make_key("eve")
    return found


@pytest.fixture
def job(
    closed: TestClient, ann: Headers, queue: Any, request_body: dict[str, Any]
) -> dict[str, Any]:
    """Return a job of ann's that has its result."""
    queue.at_once = True
    body = {"kind": "impact-modes", "request": request_body}
    found: dict[str, Any] = closed.post("/v1/jobs", json=body, headers=ann).json()
    return found


def addresses(job: dict[str, Any]) -> list[str]:
    own = f"/v1/jobs/{job['id']}"
    return [own, f"{own}?wait=1", f"{own}/events", f"{own}/result", f"/v1/results/{job['digest']}"]


def statuses(http: TestClient, job: dict[str, Any], who: Headers) -> set[int]:
    return {http.get(path, headers=who).status_code for path in addresses(job)}


def share(http: TestClient, job: dict[str, Any], who: Headers, *readers: str) -> Any:
    address = f"/v1/jobs/{job['id']}/share"
    return http.put(address, json={"readers": list(readers)}, headers=who)


def test_a_shared_job_is_seen_by_its_readers_alone(
    closed: TestClient, ann: Headers, bob: Headers, eve: Headers, job: dict[str, Any]
) -> None:
    assert statuses(closed, job, bob) == {404}
    answer = share(closed, job, ann, "bob", "ann")
    assert answer.status_code == 200
    assert answer.json() == {"job": job["id"], "owner": "ann", "readers": ["bob"]}
    assert statuses(closed, job, ann) == {200}
    assert statuses(closed, job, bob) == {200}
    assert statuses(closed, job, eve) == {404}
    own = closed.get(f"/v1/results/{job['digest']}", headers=ann)
    assert closed.get(f"/v1/results/{job['digest']}", headers=bob).content == own.content
    assert closed.get("/v1/jobs", headers=bob).json()["jobs"] == []
    shown = closed.get(f"/v1/jobs/{job['id']}/share", headers=ann)
    assert shown.json()["readers"] == ["bob"]


def test_the_end_of_a_share_holds_at_once(
    closed: TestClient, ann: Headers, bob: Headers, eve: Headers, job: dict[str, Any]
) -> None:
    share(closed, job, ann, "bob", "eve")
    assert statuses(closed, job, eve) == {200}
    share(closed, job, ann, "eve")
    assert statuses(closed, job, bob) == {404}
    assert statuses(closed, job, eve) == {200}
    for _ in range(2):
        ended = closed.delete(f"/v1/jobs/{job['id']}/share", headers=ann)
        assert ended.json()["readers"] == []
    assert statuses(closed, job, eve) == {404}
    assert statuses(closed, job, ann) == {200}


def test_everybody_with_a_key_that_reads_can_be_let_in(
    closed: TestClient, ann: Headers, eve: Headers, make_key: Any, job: dict[str, Any]
) -> None:
    share(closed, job, ann, "*")
    assert statuses(closed, job, eve) == {200}
    assert statuses(closed, job, make_key("zoe", "submit")) == {403}
    assert statuses(closed, job, {}) == {401}


def test_readers_only_see(
    closed: TestClient, ann: Headers, bob: Headers, eve: Headers, chain: Any, queue: Any,
    request_body: dict[str, Any],
) -> None:  # fmt: skip
    system = closed.post("/v1/systems", json=chain, headers=ann).headers["location"]
    body = {"kind": "impact-modes", "request": request_body}
    job = closed.post("/v1/jobs", json=body, headers=ann).json()
    share(closed, job, ann, "bob")
    assert closed.get(f"/v1/jobs/{job['id']}/result", headers=bob).json()["code"] == "not_ready"
    own, address = f"/v1/jobs/{job['id']}", f"/v1/jobs/{job['id']}/share"
    for who, status in ((bob, 403), (eve, 404)):
        assert closed.delete(own, headers=who).status_code == status
        assert closed.get(address, headers=who).status_code == status
        assert closed.delete(address, headers=who).status_code == status
        assert share(closed, job, who, "eve").status_code == status
    assert queue.rows[job["id"]].state == "queued"
    # Of the job itself nothing else follows: not the systems of its owner, nor other jobs.
    assert closed.get(system, headers=bob).status_code == 404
    assert closed.post("/v1/jobs", json=body, headers=bob).json()["digest"] != job["digest"]


def test_an_event_stream_ends_with_the_share(
    closed: TestClient, ann: Headers, bob: Headers, queue: Any, request_body: dict[str, Any]
) -> None:
    body = {"kind": "impact-modes", "request": request_body}
    job = closed.post("/v1/jobs", json=body, headers=ann).json()
    share(closed, job, ann, "bob")
    authenticator: Authenticator = closed.app.state.services.authenticator  # type: ignore[attr-defined]

    async def watched(owner: str, name: str, seconds: float, since: int) -> Any:
        if since:  # between the first event and the next, the owner thinks better of it
            access, result = authenticator.records, job["digest"]
            await access.write(shared_results.share, "test", owner, name, result, [])
        return replace(queue.rows[name], version=since + 1)

    queue.wait = watched
    text = closed.get(f"/v1/jobs/{job['id']}/events", headers=bob).text
    assert [line for line in text.splitlines() if line.startswith("event:")] == ["event: job"]


@pytest.mark.parametrize(
    "body",
    [{}, {"readers": []}, {"readers": ["a b"]}, {"readers": "bob"}, {"readers": ["b"] * 101},
     {"readers": ["bob"], "writers": []}, {"readers": [1]}, {"readers": ["x" * 81]}],
)  # fmt: skip
def test_wrong_readers(
    closed: TestClient, ann: Headers, job: dict[str, Any], body: dict[str, Any]
) -> None:
    answer = closed.put(f"/v1/jobs/{job['id']}/share", json=body, headers=ann)
    assert answer.status_code == 422
    assert answer.json()["errors"]
    assert closed.get(f"/v1/jobs/{job['id']}/share", headers=ann).json()["readers"] == []


def test_sharing_leaves_traces(
    closed: TestClient, ann: Headers, admin: Headers, job: dict[str, Any]
) -> None:
    share(closed, job, ann, "eve", "bob")
    share(closed, job, ann, "bob", "eve")  # nothing changes
    closed.delete(f"/v1/jobs/{job['id']}/share", headers=ann)
    acts = closed.get("/v1/audit", headers=admin, params={"limit": 2}).json()["acts"]
    assert [(act["act"], act["subject"]) for act in acts] == [("job shared", job["id"])] * 2
    readers = [json.loads(act["about"])["readers"] for act in acts]
    assert readers == [[], ["bob", "eve"]]
    assert acts[0]["actor"] == f"key-{ann['Authorization'].split('_')[1]}"


def test_without_keys_everybody_sees_everything_already(
    http: TestClient, queue: Any, request_body: dict[str, Any]
) -> None:
    body = {"kind": "impact-modes", "request": request_body}
    job = http.post("/v1/jobs", json=body).json()
    answer = share(http, job, {}, "bob")
    assert answer.status_code == 404
    assert "VIBROIMPACT_ACCESS" in answer.json()["detail"]
