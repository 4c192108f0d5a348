"""The service's own figures count what happened."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import pytest
from starlette.testclient import TestClient

from vibroimpact_service import metrics_port
from vibroimpact_service.app import create_app
from vibroimpact_service.jobs.metrics import JobMetrics
from vibroimpact_service.jobs.tables import JobRow
from vibroimpact_service.metrics import OTHERS, OWNERS, Metrics, Present
from vibroimpact_service.settings import Settings


def parsed(text: str) -> dict[str, float]:
    found = re.findall(r"^(vibroimpact.*) (\S+)$", text, re.M)
    return {name: float(value) for name, value in found}


def figures(http: TestClient) -> dict[str, float]:
    answer = http.get("/metrics")
    assert answer.headers["content-type"].startswith("text/plain; version=1.0.0")
    return parsed(answer.text)


def test_requests_results_and_jobs_are_counted(
    http: TestClient, queue: Any, request_body: dict[str, Any]
) -> None:
    for _ in range(3):
        http.post("/v1/compute/impact-modes", json=request_body)
    queue_body = {**request_body, "frequency": {"values": [1.5]}}
    http.post("/v1/jobs", json={"kind": "impact-modes", "request": queue_body})
    http.get("/v1/jobs/job_" + "0" * 32)
    http.get("/some/where/else")
    http.request("BREW", "/v1/jobs")
    found = figures(http)

    def requests(method: str, route: str, status: int) -> float:
        labels = f'method="{method}",route="{route}",status="{status}"'
        return found[f"vibroimpact_http_requests_total{{{labels}}}"]

    assert requests("POST", "/v1/compute/impact-modes", 200) == 3
    assert requests("GET", "/v1/jobs/{job}", 404) == 1
    assert requests("GET", "", 404) == 1
    assert sum("other" in name and "405" in name for name in found) >= 1
    assert found['vibroimpact_results_total{cache="miss",kind="impact-modes"}'] == 1
    assert found['vibroimpact_results_total{cache="hit",kind="impact-modes"}'] == 2
    assert found['vibroimpact_results_total{cache="job",kind="impact-modes"}'] == 1
    assert found['vibroimpact_jobs{kind="impact-modes",state="queued"}'] == 1
    assert found["vibroimpact_worker_slots"] == 2
    assert found["vibroimpact_ready"] == 1
    solves = {name: value for name, value in found.items() if "solve_seconds_count" in name}
    assert len(solves) == 1
    (name,) = solves
    assert 'kind="impact-modes"' in name
    assert "closed form" in name
    assert solves[name] == 1
    queue.engine.ready = False
    assert figures(http)["vibroimpact_ready"] == 0


def test_addresses_do_not_become_names_of_figures(http: TestClient) -> None:
    http.get("/metrics")
    before = len(figures(http))
    for number in range(50):
        http.get(f"/v1/jobs/job_{number}")
        http.get(f"/nowhere/{number}")
    assert len(figures(http)) < before + 60
    assert "nowhere" not in "".join(figures(http))


def test_readiness_is_told_part_by_part(http: TestClient, queue: Any) -> None:
    queue.faults = {"store": "the store is full"}
    found = figures(http)
    assert http.get("/v1/health/ready").status_code == 503
    assert found["vibroimpact_ready"] == 0
    parts = {part: found[f'vibroimpact_check_ok{{part="{part}"}}'] for part in queue.faults}
    assert parts == {"store": 0}
    assert found['vibroimpact_check_ok{part="records"}'] == 1
    queue.faults = {}
    assert figures(http)["vibroimpact_ready"] == 1
    assert 'vibroimpact_jobs_finished_total{code="internal_error",kind="sweep",state="failed"}' in (
        found  # from the start: a first failure must be an increase
    )


def text(**changed: Any) -> dict[str, float]:
    """Return what a service tells in some state."""
    metrics = Metrics(JobMetrics().registry)
    present = Present({"records": "ok"}, 3, {"sweep": "warm"}, [], None, {})
    return parsed(metrics.text(present._replace(**changed)).decode())


def test_few_owners_are_named() -> None:
    backlog = [("sweep", f"owner-{i:03}", "queued", 1000 - i, 60.0 + i) for i in range(500)]
    backlog.append(("sweep", "owner-499", "held", 600, 1e6))
    found = text(backlog=backlog)
    named = {name: value for name, value in found.items() if name.startswith("vibroimpact_owner")}
    assert len(named) == OWNERS + 1
    assert named['vibroimpact_owner_jobs{owner="owner-499"}'] == 501 + 600
    everybody = sum(count for *_, count, _ in backlog)
    assert sum(named.values()) == everybody
    assert named[f'vibroimpact_owner_jobs{{owner="{OTHERS}"}}'] > 0
    assert found['vibroimpact_jobs{kind="sweep",state="held"}'] == 600
    assert found['vibroimpact_jobs{kind="sweep",state="running"}'] == 0
    # Who holds a job knows that it waits.
    assert found['vibroimpact_queue_oldest_seconds{kind="sweep"}'] == 60.0 + 499


def test_what_is_not_known_is_not_told() -> None:
    found = text(backlog=None)
    assert not any("jobs{" in name or "oldest" in name for name in found)
    assert math.isnan(found["vibroimpact_store_free_bytes"])
    assert found["vibroimpact_worker_slots"] == 3
    found = text(room=(1, 4), expiry={"ca": 2e9})
    assert found["vibroimpact_store_free_bytes"] == 1
    assert found["vibroimpact_store_capacity_bytes"] == 4
    assert found['vibroimpact_certificate_expiry_timestamp_seconds{file="ca"}'] == 2e9


def test_jobs_that_end_are_counted_with_their_times() -> None:
    row = JobRow(
        1, "job", "ann", "sweep", "r", "d", "succeeded", "done", 0, 5.0, 3, 3, 1, False,
        100.0, 104.0, 164.0, None, None, 7, None,
    )  # fmt: skip
    metrics = JobMetrics()
    equal = replace(row, started=None, reused=True)
    at_once = replace(row, started=100.0, finished=100.0)
    failed = replace(row, state="failed", error={"code": "limit_passed"}, finished=105.0)
    metrics.finished([row, equal, at_once, failed])
    metrics.chunks("sweep", 4, planned=0.8, used=2.0)
    present = Present({}, 0, {}, None, None, {})
    found = parsed(Metrics(metrics.registry).text(present).decode())

    def value(name: str, **labels: str) -> float:
        inner = ",".join(f'{key}="{labels[key]}"' for key in sorted(labels))
        return found[f"vibroimpact_{name}{{{inner}}}"]

    assert value("jobs_finished_total", kind="sweep", state="succeeded", code="") == 3
    assert value("jobs_finished_total", kind="sweep", state="failed", code="limit_passed") == 1
    assert value("job_duration_seconds_count", kind="sweep", state="succeeded") == 1
    assert value("job_duration_seconds_sum", kind="sweep", state="succeeded") == 60.0
    assert value("job_wait_seconds_sum", kind="sweep") == 8.0
    assert value("chunk_seconds_sum", kind="sweep") == 0.5
    assert value("chunks_planned_seconds_total", kind="sweep") == 0.8
    assert value("chunks_used_seconds_total", kind="sweep") == 2.0


@pytest.fixture
def inside(settings: Settings, queue: Any) -> Any:
    """Return clients of a service that requires keys, and of its port for metrics."""
    locked = settings.model_copy(update={"access": "keys", "metrics_host": "10.0.0.1"})
    app = create_app(locked, queue)
    with TestClient(app) as outside:
        yield outside, TestClient(metrics_port.application(app.state.services))


def test_the_port_of_the_metrics_needs_no_key_and_has_nothing_else(inside: Any) -> None:
    outside, http = inside
    assert outside.get("/metrics").status_code == 401
    assert figures(http)["vibroimpact_ready"] == 1
    for path in ("/v1/health/live", "/v1/health/ready"):
        assert http.get(path).json() == outside.get(path).json()
        assert http.head(path).status_code == 200
    for path in ("/v1/jobs", "/v1/version", "/v1/keys", "/openapi.json", "/", "/docs"):
        answer = http.get(path)
        assert (answer.status_code, answer.json()["code"]) == (404, "not_found"), path
    answer = http.post("/metrics")
    assert (answer.status_code, answer.headers["allow"]) == (405, "GET, HEAD")


def test_on_a_loopback_address_the_port_answers_to_names_of_this_machine(
    settings: Settings, queue: Any
) -> None:
    """A page in a browser of this machine could otherwise read it under a name of its own."""
    app = create_app(settings, queue)
    with TestClient(app):
        http = TestClient(metrics_port.application(app.state.services))
        assert http.get("/metrics").status_code == 421
        assert http.get("/metrics", headers={"Host": "localhost:8001"}).status_code == 200
