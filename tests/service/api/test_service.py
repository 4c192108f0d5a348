"""Health, version, pages and what surrounds every exchange."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import orjson
import pytest
from starlette.testclient import TestClient

from vibroimpact_schema.service import Version
from vibroimpact_service import problems
from vibroimpact_service.app import create_app
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.settings import Settings


def test_health(http: TestClient, queue: Any) -> None:
    assert http.get("/v1/health/live").json()["status"] == "ok"
    assert http.get("/v1/health/ready").json()["status"] == "ok"
    queue.engine.ready = False
    answer = http.get("/v1/health/ready")
    assert answer.status_code == 503
    assert answer.headers["retry-after"] == "1"
    assert "workers: starting" in answer.json()["detail"]
    queue.engine.ready = True
    for part in ("records", "store"):
        queue.faults = {part: "Read-only file system"}
        assert f"{part}: Read-only" in http.get("/v1/health/ready").json()["detail"]
    assert http.get("/v1/health/live").status_code == 200


def test_version_lists_kinds_and_limits(http: TestClient) -> None:
    version = Version.model_validate_json(http.get("/v1/version").content)
    assert version.kinds == list(KINDS)
    assert version.limits.dofs == 500


@pytest.mark.parametrize("code", problems.TYPES)
def test_every_type_of_problem_has_its_page(http: TestClient, code: str) -> None:
    answer = http.get(problems.TYPES[code].uri)
    assert answer.status_code == 200
    assert problems.TYPES[code].title in answer.text


def test_unknown_addresses_and_methods(http: TestClient) -> None:
    for address in (
        "/v1",
        "/console/",
        "/console/..%2fapp.py",
        "/console/__init__.py",
        "/v1/jobs/",
        "/v1//jobs",
        "/docs/problems/x",
        "/%00",
    ):
        answer = http.get(address)
        assert answer.status_code == 404
        assert answer.headers["content-type"] == "application/problem+json"
    for address, allow in (
        ("/v1/jobs", "GET, HEAD, POST"),
        ("/v1/jobs/x", "DELETE, GET, HEAD"),
        ("/v1/compute/impact-modes", "POST"),
        ("/v1/results/x", "GET, HEAD"),
    ):
        answer = http.patch(address)
        assert answer.status_code == 405
        assert answer.headers["allow"] == allow
        assert answer.json()["code"] == "method_not_allowed"


def test_a_page_of_another_origin_is_told_the_setting(http: TestClient) -> None:
    headers = {"Origin": "http://localhost:5173", "Access-Control-Request-Method": "POST"}
    answer = http.options("/v1/compute/impact-modes", headers=headers)
    assert answer.status_code == 405
    assert "VIBROIMPACT_CORS_ORIGINS" in answer.json()["detail"]
    assert "VIBROIMPACT" not in http.options("/v1/compute/impact-modes").json()["detail"]


def test_structures_need_no_stops(http: TestClient) -> None:
    for system in ({"preset": "chain", "n": 3}, {"M": [[1.0]], "K": [[4.0]]}):
        answer = http.post("/v1/compute/natural-frequencies", json={"system": system})
        assert answer.status_code == 200
        stored = http.post("/v1/systems", json=system).json()
        assert http.get(f"/v1/systems/{stored['id']}").json()["constraints"] == []
        request = {"system": system, "frequency": {"values": [1.0]}}
        refused = http.post("/v1/compute/impact-modes", json=request)
        assert refused.status_code == 422
        assert refused.json()["errors"][0]["pointer"] == "/system/constraints"


def test_every_answer_is_hardened_and_named(http: TestClient) -> None:
    for answer in (http.get("/v1/health/live"), http.get("/nowhere"), http.get("/openapi.json")):
        assert "default-src 'none'" in answer.headers["content-security-policy"]
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["x-frame-options"] == "DENY"
        assert answer.headers["x-request-id"]


def test_a_sane_request_id_is_taken_over(http: TestClient) -> None:
    name = "abc-1.2_3"
    answer = http.get("/nowhere", headers={"X-Request-ID": name})
    assert answer.headers["x-request-id"] == name
    assert answer.json()["request_id"] == name
    for odd in (b"a b", b"x" * 65, "ä".encode(), b""):
        answer = http.get("/nowhere", headers={b"X-Request-ID": odd})
        assert answer.headers["x-request-id"].encode() != odd


def test_an_unexpected_error_is_a_problem_without_its_words(http: TestClient, queue: Any) -> None:
    async def broken(*_: Any) -> Any:
        raise RuntimeError("s3cret")

    queue.get = broken
    answer = http.get("/v1/jobs/job_" + "0" * 32)
    assert answer.status_code == 500
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["code"] == "internal_error"
    assert "s3cret" not in answer.text
    assert answer.headers["x-content-type-options"] == "nosniff"


def test_a_caller_who_goes_away_is_no_error(http: TestClient) -> None:
    sent: list[Any] = []
    scope = {
        "type": "http", "asgi": {"version": "3.0"}, "http_version": "1.1", "method": "POST",
        "path": "/v1/compute/impact-modes", "raw_path": b"/v1/compute/impact-modes",
        "query_string": b"", "root_path": "", "scheme": "http",
        "headers": [(b"content-type", b"application/json"), (b"host", b"testserver")],
    }  # fmt: skip
    messages = iter(
        [
            {"type": "http.request", "body": b'{"system"', "more_body": True},
            {"type": "http.disconnect"},
        ]
    )

    async def receive() -> Any:
        return next(messages)

    async def send(message: Any) -> None:
        sent.append(message)

    asyncio.run(http.app(scope, receive, send))
    assert sent == []


def test_a_full_store_is_a_problem_that_may_pass(
    http: TestClient, queue: Any, request_body: dict[str, Any]
) -> None:
    async def full(*_: Any) -> Any:
        raise OSError(28, "No space left on device")

    queue.submit = full
    answer = http.post("/v1/jobs", json={"kind": "impact-modes", "request": request_body})
    assert answer.status_code == 507
    assert answer.json()["retryable"]


def test_the_contract_is_served(http: TestClient) -> None:
    contract = json.loads(http.get("/openapi.json").content)
    assert contract["openapi"].startswith("3.1")
    assert "/v1/compute/impact-modes" in contract["paths"]


def test_memory_of_bodies_is_limited_and_returned(
    settings: Settings, queue: Any, request_body: dict[str, Any]
) -> None:
    length = len(orjson.dumps(request_body))
    chosen = settings.model_copy(update={"max_bodies_bytes": length})
    headers = {"Content-Type": "application/json"}
    with TestClient(create_app(chosen, queue)) as http:
        for _ in range(3):
            body = orjson.dumps(request_body)
            answer = http.post("/v1/plan/impact-modes", content=body, headers=headers)
            assert answer.status_code == 200
            refused = http.post("/v1/plan/impact-modes", content=body + b" ", headers=headers)
            assert refused.status_code == 503
            assert refused.headers["retry-after"] == "2"


@pytest.mark.parametrize("coding", ["zstd", "gzip", "identity"])
def test_the_contract_is_compressed_and_fetched_once(http: TestClient, coding: str) -> None:
    whole = http.get("/openapi.json", headers={"Accept-Encoding": "identity"}).json()
    with http.stream("GET", "/openapi.json", headers={"Accept-Encoding": coding}) as answer:
        raw = b"".join(answer.iter_raw())
    assert answer.headers.get("content-encoding", "identity") == coding
    assert answer.headers["vary"] == "Accept-Encoding"
    size = len(orjson.dumps(whole))
    assert (len(raw) < size / 3) == (coding != "identity")
    tag = answer.headers["etag"]
    sent = {"Accept-Encoding": coding, "If-None-Match": tag}
    assert http.get("/openapi.json", headers=sent).status_code == 304
    assert http.get("/openapi.json", headers=sent | {"Accept-Encoding": "x"}).status_code == (
        304 if coding == "identity" else 200
    )


def test_conditions_on_what_has_no_entity_tag_do_not_hold(
    http: TestClient, queue: Any, request_body: dict[str, Any]
) -> None:
    body = {"kind": "impact-modes", "request": request_body}
    known = {"If-Match": '"abc"'}
    assert http.post("/v1/jobs", json=body, headers=known).status_code == 412
    assert queue.rows == {}
    job = http.post("/v1/jobs", json=body, headers={"If-Match": "*"}).json()["id"]
    refused = http.delete(f"/v1/jobs/{job}", headers=known)
    assert (refused.status_code, refused.json()["code"]) == (412, "precondition_failed")
    assert queue.rows[job].state == "queued"


def test_a_page_that_changed(http: TestClient) -> None:
    tag = http.get("/").headers["etag"]
    assert http.get("/", headers={"If-Match": f'"other", {tag}'}).status_code == 200
    assert http.get("/", headers={"If-Match": '"other"'}).status_code == 412
