"""/v1/jobs: what is answered in every state of a job, and to whom."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from vibroimpact_schema.jobs import Job
from vibroimpact_service.app import create_app
from vibroimpact_service.settings import Settings

UNKNOWN = "job_" + "0" * 32


OUTSIDE = {
    "system": {"preset": "chain", "n": 3, "constraints": [{"dof": 7, "gap": 0.2}]},
    "frequency": {"values": [1.0]},
}


def submit(http: TestClient, request: dict[str, Any], key: str | None = None, **more: Any) -> Any:
    headers = {} if key is None else {"Idempotency-Key": key}
    content = {"kind": "impact-modes", "request": request, **more}
    return http.post("/v1/jobs", json=content, headers=headers)


def test_a_job_from_its_submission_to_its_result(
    http: TestClient, queue: Any, request_body: dict[str, Any]
) -> None:
    answer = submit(http, request_body, priority=3)
    assert answer.status_code == 201
    job = Job.model_validate_json(answer.content)
    assert answer.headers["location"] == f"/v1/jobs/{job.id}"
    assert answer.headers["cache-control"] == "no-store"
    assert (job.state, job.final, job.priority, job.result) == ("queued", False, 3, None)
    assert job.queue_position == 0
    assert job.waiting_reason
    early = http.get(f"/v1/jobs/{job.id}/result")
    assert early.status_code == 404
    assert early.json()["code"] == "not_ready"
    assert early.json()["retryable"]
    assert early.headers["retry-after"] == "1"
    queue.run(job.id)
    done = Job.model_validate_json(http.get(f"/v1/jobs/{job.id}").content)
    assert (done.state, done.final, done.queue_position) == ("succeeded", True, None)
    assert done.result == f"/v1/jobs/{job.id}/result"
    result = http.get(done.result)
    assert result.status_code == 200
    assert result.json()["digest"] == job.digest
    assert result.headers["content-location"] == f"/v1/results/{job.digest}"
    assert result.headers["etag"]
    direct = http.post("/v1/compute/impact-modes", json=request_body)
    assert direct.headers["cache-status"] == "vibroimpact; hit"
    assert direct.content == result.content
    file = http.get(done.result, headers={"Accept": "application/x-hdf5"})
    assert file.content.startswith(b"\x89HDF")
    assert http.get(done.result, headers={"Accept": "text/html"}).status_code == 406


def test_a_known_result_makes_a_finished_job(
    http: TestClient, request_body: dict[str, Any]
) -> None:
    http.post("/v1/compute/impact-modes", json=request_body)
    job = submit(http, request_body).json()
    assert (job["state"], job["final"], job["reused"]) == ("succeeded", True, True)
    assert http.get(f"/v1/jobs/{job['id']}/result").status_code == 200


def test_failed_and_cancelled_jobs_say_so(
    http: TestClient, queue: Any, request_body: dict[str, Any]
) -> None:
    job = submit(http, request_body).json()["id"]
    error = {
        "type": "/docs/problems/no_convergence", "title": "t", "status": 422, "detail": "d",
        "instance": "i", "request_id": "r", "code": "no_convergence", "retryable": False,
        "errors": [],
    }  # fmt: skip
    queue.change(job, state="failed", error=error)
    assert http.get(f"/v1/jobs/{job}").json()["error"]["code"] == "no_convergence"
    answer = http.get(f"/v1/jobs/{job}/result")
    assert (answer.status_code, answer.json()["code"]) == (404, "no_result")
    other = submit(http, request_body).json()["id"]
    for _ in range(2):
        cancelled = http.delete(f"/v1/jobs/{other}")
        assert (cancelled.status_code, cancelled.json()["state"]) == (200, "cancelled")
    assert http.get(f"/v1/jobs/{other}/result").json()["code"] == "no_result"
    assert http.delete(f"/v1/jobs/{job}").json()["state"] == "failed"


def test_the_result_of_a_quick_job_that_was_lost_is_computed_again(
    http: TestClient, queue: Any, settings: Settings, request_body: dict[str, Any]
) -> None:
    job = submit(http, request_body).json()
    queue.run(job["id"])
    first = http.get(f"/v1/jobs/{job['id']}/result").json()
    queue.rows[job["id"]] = replace(queue.rows[job["id"]], queue="quick")
    # What a power failure can leave of a file: half of it, and nothing of what was made of it.
    (place,) = Path(queue.store.url).glob(f"results/*/{job['digest']}")
    with TestClient(create_app(settings, queue)) as later:
        place.write_bytes(place.read_bytes()[:100])
        for made in place.parent.glob(f"{job['digest']}.*"):
            made.unlink()
        again = later.get(f"/v1/jobs/{job['id']}/result").json()
        assert first.pop("provenance")["created"] != again.pop("provenance")["created"]
        for document in (first, again):
            document.pop("plan")  # the second time the spectrum is known
        assert again == first
        # Where nobody knows any more what was asked, nothing can be computed.
        job = submit(later, {**request_body, "outputs": ["impulse"]}).json()
        queue.run(job["id"])
        queue.rows[job["id"]] = replace(queue.rows[job["id"]], queue="quick", request="ab" * 32)
        queue.store.results.remove(job["digest"])
        assert later.get(f"/v1/jobs/{job['id']}/result").json()["code"] == "no_result"


@pytest.mark.parametrize("job", [UNKNOWN, "x", "job_" + "0" * 31, "job_%00", "%F0%9F%98%80"])
def test_unknown_jobs_are_not_found(http: TestClient, job: str) -> None:
    for answer in (
        http.get(f"/v1/jobs/{job}"),
        http.delete(f"/v1/jobs/{job}"),
        http.get(f"/v1/jobs/{job}/result"),
        http.get(f"/v1/jobs/{job}/events"),
    ):
        assert answer.status_code == 404
        assert answer.headers["content-type"] == "application/problem+json"


def test_waiting_ends_with_the_job_or_the_time(
    http: TestClient, queue: Any, request_body: dict[str, Any]
) -> None:
    job = submit(http, request_body).json()["id"]
    assert http.get(f"/v1/jobs/{job}?wait=0.05").json()["state"] == "queued"
    queue.run(job)
    assert http.get(f"/v1/jobs/{job}?wait=1000").json()["state"] == "succeeded"
    for wrong in ("-1", "nan", "inf", "soon"):
        answer = http.get(f"/v1/jobs/{job}?wait={wrong}")
        assert answer.status_code == 422
        assert answer.json()["errors"][0]["parameter"] == "wait"


def test_with_a_known_version_any_change_ends_the_wait(
    http: TestClient, queue: Any, request_body: dict[str, Any]
) -> None:
    job = submit(http, request_body).json()
    address = f"/v1/jobs/{job['id']}?wait=20&since="
    queue.change(job["id"], state="running", done=1, total=3)
    changed = http.get(f"{address}{job['version']}").json()
    assert (changed["state"], changed["final"]) == ("running", False)
    same = http.get(f"/v1/jobs/{job['id']}?wait=0.05&since={changed['version']}").json()
    assert same == changed
    assert http.get(f"{address}-1").status_code == 422


def test_pages_list_every_job_once_newest_first(
    http: TestClient, queue: Any, request_body: dict[str, Any]
) -> None:
    made = [submit(http, request_body).json()["id"] for _ in range(7)]
    queue.change(made[0], state="failed")
    listed, address = [], "/v1/jobs?limit=3"
    while address:
        answer = http.get(address)
        listed += [job["id"] for job in answer.json()["jobs"]]
        link = answer.headers.get("link")
        assert (link is None) == (answer.json()["next"] is None)
        address = link.partition(">")[0].removeprefix("<") if link else ""
    assert listed == list(reversed(made))
    assert [job["id"] for job in http.get("/v1/jobs?state=failed").json()["jobs"]] == made[:1]
    assert http.get("/v1/jobs?kind=sweep").json() == {"jobs": [], "next": None}
    filtered = http.get("/v1/jobs?state=queued&limit=2").headers["link"]
    assert "state=queued" in filtered


@pytest.mark.parametrize(
    "query", ["state=done", "limit=0", "limit=501", "limit=x", "cursor=x", "cursor=0"]
)
def test_wrong_parameters_are_named(http: TestClient, query: str) -> None:
    answer = http.get(f"/v1/jobs?{query}")
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["parameter"] == query.partition("=")[0]


def test_terms_of_a_job(http: TestClient, queue: Any, request_body: dict[str, Any]) -> None:
    secret = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw"
    hook = {"url": "https://example.org/hook", "secret": secret}
    job = submit(http, request_body, deadline_seconds=60.0, webhook=hook).json()
    assert job["deadline"] == "2001-09-09T01:47:40Z"
    assert secret not in str(job)
    assert submit(http, request_body).json()["deadline"] is None
    queue.change(job["id"], state="running", done=5, total=9, kept=2)
    progress = http.get(f"/v1/jobs/{job['id']}").json()["progress"]
    assert progress == {"done": 5, "total": 9, "kept": 2}


def test_a_job_has_the_name_that_it_was_queued_with(
    http: TestClient, request_body: dict[str, Any]
) -> None:
    job = submit(http, request_body, key="n-1", name="tube, gap 0.2 mm").json()
    assert job["name"] == "tube, gap 0.2 mm"
    assert http.get(f"/v1/jobs/{job['id']}").json()["name"] == "tube, gap 0.2 mm"
    assert submit(http, request_body).json()["name"] is None
    named = {each["id"]: each["name"] for each in http.get("/v1/jobs").json()["jobs"]}
    assert named[job["id"]] == "tube, gap 0.2 mm"
    # A name is not what is asked for: a repeated request may have another one.
    assert submit(http, request_body, key="n-1", name="other").json()["id"] == job["id"]
    for wrong in ("x" * 121, "two\nlines", 5):
        answer = submit(http, request_body, name=wrong)
        assert answer.status_code == 422
        assert answer.json()["errors"][0]["pointer"] == "/name"


@pytest.mark.parametrize(
    ("changes", "pointer"),
    [
        ({"url": "http://example.org/"}, "/webhook/url"),
        ({"url": "https://192.168.0.1/"}, "/webhook/url"),
        ({"url": "https://example.org/\u00e4"}, "/webhook/url"),
        ({"secret": "short"}, "/webhook/secret"),
        ({"secret": "whsec_" + "A" * 33}, "/webhook/secret"),
    ],
)
def test_wrong_webhooks(
    http: TestClient, request_body: dict[str, Any], changes: dict[str, str], pointer: str
) -> None:
    hook = {"url": "https://example.org/hook", "secret": "whsec_" + "A" * 32, **changes}
    answer = submit(http, request_body, webhook=hook)
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["pointer"] == pointer


def test_idempotency_keys(http: TestClient, request_body: dict[str, Any]) -> None:
    first = submit(http, request_body, key="k-1").json()["id"]
    assert submit(http, request_body, key="k-1").json()["id"] == first
    assert submit(http, request_body, key='"k-1"').json()["id"] == first
    assert submit(http, request_body, key="k-2").json()["id"] != first
    request_body["frequency"]["num"] = 6
    clash = submit(http, request_body, key="k-1")
    assert (clash.status_code, clash.json()["code"]) == (422, "idempotency_key_reused")
    request_body["frequency"]["num"] = 5
    hook = {"url": "https://example.org/hook", "secret": "whsec_" + "A" * 32}
    for other in ({"priority": 1}, {"deadline_seconds": 60.0}, {"webhook": hook}):
        clash = submit(http, request_body, key="k-1", **other)
        assert (clash.status_code, clash.json()["code"]) == (422, "idempotency_key_reused")
        own = submit(http, request_body, key=f"k-{next(iter(other))}", **other).json()["id"]
        again = submit(http, request_body, key=f"k-{next(iter(other))}", **other)
        assert (again.status_code, again.json()["id"]) == (201, own)
    assert submit(http, request_body, key="k-1", priority=0).json()["id"] == first
    for wrong in ("", "a b", "x" * 256):
        assert submit(http, request_body, key=wrong).status_code == 400


@pytest.mark.parametrize(
    ("content", "pointer"),
    [
        ({"kind": "no-such-kind", "request": {}}, "/kind"),
        ({"kind": "impact-modes"}, "/request"),
        ({"kind": "impact-modes", "request": 5}, "/request"),
        ({"kind": "impact-modes", "request": {}}, "/request/system"),
        ({"kind": "impact-modes", "request": {}, "priority": 11}, "/priority"),
        ({"kind": "impact-modes", "request": {}, "priority": 1.5}, "/priority"),
        ({"kind": "impact-modes", "request": OUTSIDE}, "/request/system/constraints/0/dof"),
        ({"kind": 5, "request": {}}, "/kind"),
        ({"request": {}}, "/kind"),
    ],
)
def test_wrong_submissions_are_pointed_at(
    http: TestClient, content: dict[str, Any], pointer: str
) -> None:
    answer = http.post("/v1/jobs", json=content)
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["pointer"] == pointer


def events(text: str) -> list[dict[str, str]]:
    found = []
    for block in text.split("\n\n"):
        lines = [line.partition(": ") for line in block.split("\n") if line and line[0] != ":"]
        found.append({name: value for name, _, value in lines})
    return [event for event in found if "data" in event]


@pytest.mark.parametrize("last", ["-1", "1e3", "9" * 40, "x"])
def test_an_unknown_number_of_an_event_is_the_begin(
    http: TestClient, queue: Any, request_body: dict[str, Any], last: str
) -> None:
    job = submit(http, request_body).json()["id"]
    queue.run(job)
    answer = http.get(f"/v1/jobs/{job}/events", headers={"Last-Event-ID": last})
    assert answer.status_code == 200, answer.text
    assert [event["event"] for event in events(answer.text)] == ["end"]


def test_events_end_with_the_job(
    http: TestClient, queue: Any, request_body: dict[str, Any]
) -> None:
    job = submit(http, request_body).json()["id"]
    queue.run(job)
    answer = http.get(f"/v1/jobs/{job}/events")
    assert answer.headers["content-type"].startswith("text/event-stream")
    assert answer.headers["cache-control"] == "no-store"
    (last,) = events(answer.text)
    assert last["event"] == "end"
    assert last["id"] == str(queue.rows[job].version)
    assert json.loads(last["data"])["state"] == "succeeded"


@pytest.mark.parametrize("seen", ["", "x", "-1", "9" * 40, "0"])
def test_unusable_event_ids_start_from_the_beginning(
    http: TestClient, queue: Any, request_body: dict[str, Any], seen: str
) -> None:
    job = submit(http, request_body).json()["id"]
    queue.run(job)
    answer = http.get(f"/v1/jobs/{job}/events", headers={"Last-Event-ID": seen})
    assert len(events(answer.text)) == 1


def test_head_of_a_stream_ends_at_once(http: TestClient, request_body: dict[str, Any]) -> None:
    job = submit(http, request_body).json()["id"]
    answer = http.head(f"/v1/jobs/{job}/events")
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/event-stream")


def test_what_was_seen_is_not_repeated(
    http: TestClient, queue: Any, request_body: dict[str, Any]
) -> None:
    job = submit(http, request_body).json()["id"]
    queue.run(job)
    seen = str(queue.rows[job].version)
    answer = http.get(f"/v1/jobs/{job}/events", headers={"Last-Event-ID": seen})
    assert (answer.status_code, answer.content) == (204, b"")
    head = http.head(f"/v1/jobs/{job}/events", headers={"Last-Event-ID": seen})
    assert head.status_code == 204


def test_a_stopping_service_ends_waits_and_streams(
    http: TestClient, request_body: dict[str, Any]
) -> None:
    job = submit(http, request_body).json()["id"]
    http.app.state.services.drain.set()  # type: ignore[attr-defined]
    assert http.get(f"/v1/jobs/{job}?wait=25").json()["state"] == "queued"
    assert http.get(f"/v1/jobs/{job}/events").status_code == 200
    assert http.get("/v1/health/ready").status_code == 503
