"""Retry, hold and release by HTTP, with a real queue."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import pytest
from starlette.testclient import TestClient

from vibroimpact_service.app import create_app
from vibroimpact_service.settings import Settings


@pytest.fixture
def real(settings: Settings) -> Iterator[TestClient]:
    """Return a client of a service with records; jobs of it that are held do not run."""
    with TestClient(create_app(settings.model_copy(update={"workers": 1}))) as client:
        end = time.monotonic() + 60
        while not client.get("/v1/health/ready").is_success:
            assert time.monotonic() < end
            time.sleep(0.1)
        yield client


def state(client: TestClient, job: str) -> dict[str, Any]:
    """Return a job that has ended."""
    end = time.monotonic() + 60
    while True:
        answer = client.get(f"/v1/jobs/{job}", params={"wait": 20})
        assert answer.status_code == 200
        document = dict(answer.json())
        if document["final"]:
            return document
        assert time.monotonic() < end, document


def test_a_job_is_held_fails_and_is_retried(real: TestClient, request_body: dict[str, Any]) -> None:
    # Long enough that the workers are not done before it is held.
    frequency = {"start": 0.6, "stop": 2.4, "num": 60_000}
    content = request_body | {"frequency": frequency, "outputs": ["impulse", "exists"]}
    body = {"kind": "impact-modes", "request": content, "deadline_seconds": 20.0}
    job = real.post("/v1/jobs", json=body).json()["id"]
    held = real.post(f"/v1/jobs/{job}/hold").json()
    assert (held["state"], held["phase"]) == ("queued", "held")
    assert "held" in held["waiting_reason"]
    failed = state(real, job)
    assert failed["error"]["code"] == "deadline_passed"
    assert real.post("/v1/retry", json={"kind": "sweep"}).json() == {"jobs": []}
    again = real.post(f"/v1/jobs/{job}/retry").json()
    assert (again["final"], again["error"]) == (False, None)
    done = state(real, job)
    assert done["state"] == "succeeded"
    assert done["history"][-1]["why"] == "succeeded"
    assert all(each["worker"] and each["began"] and each["ended"] for each in done["history"])
    assert real.get("/v1/jobs").json()["jobs"][0]["history"] is None
    unchanged = real.post(f"/v1/jobs/{job}/release").json()
    assert unchanged["version"] == done["version"]


def test_a_released_job_runs(real: TestClient, request_body: dict[str, Any]) -> None:
    job = real.post("/v1/jobs", json={"kind": "impact-modes", "request": request_body}).json()["id"]
    real.post(f"/v1/jobs/{job}/hold")
    time.sleep(0.5)
    real.post(f"/v1/jobs/{job}/release")
    assert state(real, job)["state"] == "succeeded"


def test_what_is_not_there_or_wrong_is_refused(http: TestClient) -> None:
    for action in ("retry", "hold", "release"):
        assert http.post(f"/v1/jobs/job_{'0' * 32}/{action}").status_code == 404
    answer = http.post("/v1/retry", json={"kinds": "sweep"})
    assert answer.status_code == 422
