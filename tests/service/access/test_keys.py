"""API keys: recognised, refused, revoked, scoped; what is someone else's is not there."""

from __future__ import annotations

import sqlite3
from typing import Any

import pytest
from fastapi.routing import APIRoute
from starlette.testclient import TestClient

from vibroimpact_service.access import keys
from vibroimpact_service.access.caller import Scope
from vibroimpact_service.api.route import Authentication
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.settings import Settings

Headers = dict[str, str]


ANYBODY = None
RULES = {
    **{("POST", f"/v1/compute/{kind}"): Scope.SUBMIT for kind in KINDS},
    ("POST", "/v1/batch"): Scope.SUBMIT,
    **{("POST", f"/v1/plan/{kind}"): Scope.SUBMIT for kind in KINDS},
    ("POST", "/v1/jobs"): Scope.SUBMIT,
    ("POST", "/v1/retry"): Scope.SUBMIT,
    **{("POST", f"/v1/jobs/{{job}}/{act}"): Scope.SUBMIT for act in ("hold", "release", "retry")},
    ("GET", "/v1/jobs"): Scope.READ,
    ("GET", "/v1/jobs/{job}"): Scope.READ,
    ("DELETE", "/v1/jobs/{job}"): Scope.SUBMIT,
    ("GET", "/v1/jobs/{job}/result"): Scope.READ,
    ("GET", "/v1/jobs/{job}/events"): Scope.READ,
    ("GET", "/v1/jobs/{job}/share"): Scope.READ,
    ("PUT", "/v1/jobs/{job}/share"): Scope.SUBMIT,
    ("DELETE", "/v1/jobs/{job}/share"): Scope.SUBMIT,
    ("GET", "/v1/results/{digest}"): Scope.READ,
    ("POST", "/v1/systems"): Scope.SUBMIT,
    ("GET", "/v1/systems/{system}"): Scope.READ,
    ("GET", "/v1/keys"): Scope.ADMIN,
    ("POST", "/v1/keys"): Scope.ADMIN,
    ("DELETE", "/v1/keys/{key}"): Scope.ADMIN,
    ("GET", "/v1/audit"): Scope.ADMIN,
    ("GET", "/metrics"): Scope.METRICS,
    # Load balancers, and people who have no key yet, ask these.
    ("GET", "/v1/health/live"): ANYBODY,
    ("GET", "/v1/health/ready"): ANYBODY,
    ("GET", "/v1/version"): ANYBODY,
    ("GET", "/openapi.json"): ANYBODY,
    ("GET", "/"): ANYBODY,
    ("GET", "/docs"): ANYBODY,
    ("GET", "/console/{file:path}"): ANYBODY,
    ("GET", "/docs/problems/{code}"): ANYBODY,
}
"""(method, path) -> the scope that the caller must have."""


def routes(http: TestClient) -> list[APIRoute]:
    return [route for route in http.app.routes if isinstance(route, APIRoute)]  # type: ignore[attr-defined]


def declared(route: APIRoute) -> Scope | None:
    """Return the scope that a route declares by its dependencies."""
    scopes = [
        each.dependency.scope
        for each in route.dependencies
        if isinstance(each.dependency, Authentication)
    ]
    assert len(scopes) <= 1, route.path
    return scopes[0] if scopes else None


def address(path: str) -> str:
    values = {"job": "job_" + "0" * 32, "digest": "0" * 64, "system": "sys_" + "0" * 64}
    return path.replace(":path", "").format(
        **values, key="0" * 12, code="not_found", file="none.js"
    )


def test_every_route_declares_the_scope_of_the_rules(http: TestClient) -> None:
    found = {(method, r.path): declared(r) for r in routes(http) for method in r.methods}
    assert found == RULES
    assert len(routes(http)) == len(http.app.routes)  # type: ignore[attr-defined]


@pytest.mark.parametrize("scope", Scope)
def test_the_scope_of_each_route_is_asked_for(
    closed: TestClient, make_key: Any, scope: Scope
) -> None:
    key = make_key("ann", scope.value)
    for (method, path), wanted in RULES.items():
        target = address(path)
        if path.endswith("/events"):
            target = target.replace("0" * 32, "x")  # a stream would not end
        stranger = closed.request(method, target)
        known = closed.request(method, target, headers=key)
        if wanted is None:
            assert stranger.status_code not in (401, 403), path
            continue
        assert stranger.status_code == 401, path
        assert stranger.headers["www-authenticate"].startswith("Bearer"), path
        assert stranger.json()["code"] == "unauthenticated"
        assert (known.status_code == 403) is (wanted is not scope), (path, known.text)
        assert known.status_code != 401


def test_the_secret_is_nowhere_in_the_records(settings: Settings, ann: Headers) -> None:
    text = ann["Authorization"].removeprefix("Bearer ")
    parsed = keys.parse(text)
    assert parsed is not None
    name, secret = parsed
    with sqlite3.connect(settings.data / "records.sqlite") as connection:
        dump = "\n".join(connection.iterdump())
    connection.close()
    assert name in dump
    assert secret not in dump
    assert keys.digest(secret) in dump


@pytest.mark.parametrize(
    "header",
    [
        "Bearer", "Bearer ", "Basic YTpi", "Bearer vik_0", f"Bearer vik_{'0' * 12}_{'A' * 43}",
        "vik_x", "Bearer a.b.c", "Bearer \u00e4", "Bearer " + "x" * 10_000, "bearer bearer x",
    ],
)  # fmt: skip
def test_bad_keys_are_refused(closed: TestClient, header: str) -> None:
    answer = closed.get("/v1/jobs", headers={b"Authorization": header.encode("latin-1")})
    assert answer.status_code == 401
    assert answer.headers["content-type"] == "application/problem+json"


def test_a_key_with_another_secret_or_another_id_is_refused(
    closed: TestClient, ann: Headers, bob: Headers
) -> None:
    assert closed.get("/v1/jobs", headers=ann).status_code == 200
    mixed = ann["Authorization"][:-43] + bob["Authorization"][-43:]
    assert closed.get("/v1/jobs", headers={"Authorization": mixed}).status_code == 401


def test_a_revoked_key_is_refused_at_once(
    closed: TestClient, ann: Headers, bob: Headers, admin: Headers
) -> None:
    name = ann["Authorization"].split("_")[1]
    assert closed.get("/v1/jobs", headers=ann).status_code == 200
    revoked = closed.delete(f"/v1/keys/{name}", headers=admin)
    assert revoked.status_code == 200
    assert not revoked.json()["valid"]
    assert closed.get("/v1/jobs", headers=ann).status_code == 401
    assert closed.get("/v1/jobs", headers=bob).status_code == 200
    again = closed.delete(f"/v1/keys/{name}", headers=admin)
    assert again.json() == revoked.json()
    assert closed.delete("/v1/keys/" + "0" * 12, headers=admin).status_code == 404


def test_an_expired_key_is_refused(closed: TestClient, make_key: Any) -> None:
    assert closed.get("/v1/jobs", headers=make_key("ann", days=1.0)).status_code == 200
    assert closed.get("/v1/jobs", headers=make_key("ann", days=-1.0)).status_code == 401


def test_administrators_make_keys_and_leave_traces(closed: TestClient, admin: Headers) -> None:
    asked = {"owner": "eve", "label": "cluster", "scopes": ["read"], "days": 1.5}
    made = closed.post("/v1/keys", json=asked, headers=admin)
    assert made.status_code == 201
    key = {"Authorization": f"Bearer {made.json()['key']}"}
    assert closed.get("/v1/jobs", headers=key).status_code == 200
    listed = closed.get("/v1/keys", headers=admin).json()["keys"]
    assert listed[-1]["owner"] == "eve"
    assert all("key" not in row and "hash" not in row for row in listed)
    acts = closed.get("/v1/audit", headers=admin, params={"limit": 1}).json()
    assert acts["acts"][0]["act"] == "key created"
    assert acts["acts"][0]["subject"] == made.json()["id"]
    assert acts["acts"][0]["actor"].startswith("key-")
    older = closed.get("/v1/audit", headers=admin, params={"cursor": acts["next"]}).json()
    assert older["acts"][0]["subject"] != made.json()["id"]
    for wrong in ({"owner": ""}, {"owner": "a b"}, {"owner": "a", "scopes": ["root"]}, {}):
        assert closed.post("/v1/keys", json=wrong, headers=admin).status_code == 422


@pytest.mark.parametrize("key", ["key-0", "key-" + "0" * 32, "0" * 500])
def test_only_keys_that_there_are_can_be_revoked(
    closed: TestClient, admin: Headers, key: str
) -> None:
    answer = closed.delete(f"/v1/keys/{key}", headers=admin)
    assert answer.status_code == 404
    assert answer.json()["code"] == "not_found"


def test_what_is_someone_elses_is_not_there(
    closed: TestClient,
    ann: Headers,
    bob: Headers,
    queue: Any,
    request_body: dict[str, Any],
    chain: dict[str, Any],
) -> None:
    queue.at_once = True
    job = closed.post(
        "/v1/jobs", json={"kind": "impact-modes", "request": request_body}, headers=ann
    ).json()
    system = closed.post("/v1/systems", json=chain, headers=ann).headers["location"]
    result = f"/v1/results/{job['digest']}"
    own = [f"/v1/jobs/{job['id']}", job["result"], f"/v1/jobs/{job['id']}/events", result, system]
    for path in own:
        assert closed.get(path, headers=ann).status_code == 200, path
        foreign = closed.get(path, headers=bob)
        assert foreign.status_code == 404, path
        known = {"If-None-Match": closed.get(path, headers=ann).headers.get("etag", "*")}
        assert closed.get(path, headers=bob | known).status_code == 404, path
        assert closed.head(path, headers=bob).status_code == 404, path
    assert closed.delete(own[0], headers=bob).status_code == 404
    assert closed.get("/v1/jobs", headers=bob).json()["jobs"] == []
    named = {**request_body, "system": {"id": system.rpartition("/")[2]}}
    assert closed.post("/v1/compute/impact-modes", json=named, headers=ann).is_success
    for path, body, pointer in (
        ("/v1/compute/impact-modes", named, "/system/id"),
        ("/v1/plan/impact-modes", named, "/system/id"),
        ("/v1/jobs", {"kind": "impact-modes", "request": named}, "/request/system/id"),
        ("/v1/systems", named["system"], "/id"),
    ):
        answer = closed.post(path, json=body, headers=bob)
        assert answer.status_code == 422, path
        assert answer.json()["errors"][0]["pointer"] == pointer
        assert answer.json()["errors"][0]["code"] == "unknown_system"
    batch = {"kind": "impact-modes", "requests": [request_body, named]}
    own, foreign = closed.post("/v1/batch", json=batch, headers=bob).json()["answers"]
    assert own["result"]["impulse"]
    assert foreign["problem"]["errors"][0]["code"] == "unknown_system"
    assert foreign["problem"]["errors"][0]["pointer"] == "/system/id"


def test_equal_requests_of_two_owners_know_nothing_of_each_other(
    closed: TestClient, ann: Headers, bob: Headers, request_body: dict[str, Any]
) -> None:
    first = closed.post("/v1/compute/impact-modes", json=request_body, headers=ann)
    other = closed.post("/v1/compute/impact-modes", json=request_body, headers=bob)
    assert other.headers["cache-status"] == "vibroimpact; fwd=miss"
    assert first.json()["digest"] != other.json()["digest"]
    assert first.json()["impulse"] == other.json()["impulse"]
    plan = closed.post("/v1/plan/impact-modes", json=request_body, headers=bob)
    assert plan.json()["cached"]


def test_keys_of_one_owner_share_everything(
    closed: TestClient, ann: Headers, make_key: Any, request_body: dict[str, Any]
) -> None:
    first = closed.post("/v1/compute/impact-modes", json=request_body, headers=ann)
    second = make_key("ann", "read")
    assert closed.get(first.headers["content-location"], headers=second).status_code == 200


def test_without_keys_their_routes_say_so(http: TestClient) -> None:
    for method, path in (("GET", "/v1/keys"), ("DELETE", "/v1/keys/" + "0" * 12)):
        answer = http.request(method, path)
        assert answer.status_code == 404
        assert "VIBROIMPACT_ACCESS" in answer.json()["detail"]
