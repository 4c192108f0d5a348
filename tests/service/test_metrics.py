"""The service's own figures count what happened."""

from __future__ import annotations

import re
from typing import Any

from starlette.testclient import TestClient


def figures(http: TestClient) -> dict[str, float]:
    answer = http.get("/metrics")
    assert answer.headers["content-type"].startswith("text/plain; version=1.0.0")
    found = re.findall(r"^(vibroimpact.*) (\S+)$", answer.text, re.M)
    return {name: float(value) for name, value in found}


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
    assert found['vibroimpact_jobs{state="queued"}'] == 1
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
