"""The service as a whole: real processes, a real queue, starting, stopping and starting again."""

from __future__ import annotations

import json
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx2
import pytest

CHAIN = {"preset": "chain", "n": 13, "constraints": [{"dof": 5, "gap": 0.2}]}


def request(num: int = 50, start: float = 0.6, n: int = 13) -> dict[str, Any]:
    return {"system": {**CHAIN, "n": n}, "frequency": {"start": start, "stop": 2.4, "num": num}}


def heavy(start: float = 0.6) -> dict[str, Any]:
    """Return a request that takes a few seconds and is cut into chunks."""
    return {
        "system": {**CHAIN, "n": 2000, "constraints": [{"dof": 5, "gap": 0.2}]},
        "frequency": {"start": start, "stop": 2.4, "num": 400_000},
        "outputs": ["impulse"],
    }


def submit(service: Any, content: dict[str, Any], **headers: str) -> dict[str, Any]:
    body = {"kind": "impact-modes", "request": content}
    answer = service.http.post("/v1/jobs", json=body, headers=headers)
    assert answer.status_code == 201, answer.text
    document: dict[str, Any] = answer.json()
    return document


def wait(service: Any, job: str) -> dict[str, Any]:
    end = time.monotonic() + 60
    while time.monotonic() < end:
        document: dict[str, Any] = service.http.get(f"/v1/jobs/{job}?wait=25").json()
        if document["final"]:
            return document
    raise AssertionError(f"the job does not end: {document}")


def events(lines: Any) -> Any:
    """Yield (id, event, job) of a stream of server-sent events."""
    event: dict[str, str] = {}
    for line in lines:
        if not line and "data" in event:
            yield int(event["id"]), event["event"], json.loads(event["data"])
            event = {}
        elif line and not line.startswith(":"):
            name, _, value = line.partition(": ")
            event[name] = value


def test_a_job_gives_the_same_bytes_as_an_answer_at_once(service: Any) -> None:
    job = submit(service, request(997))
    done = wait(service, job["id"])
    assert done["state"] == "succeeded"
    assert done["progress"]["done"] == done["progress"]["total"]
    assert done["started"] >= done["created"]
    result = service.http.get(done["result"])
    direct = service.http.post("/v1/compute/impact-modes", json=request(997))
    assert direct.headers["cache-status"] == "vibroimpact; hit"
    assert direct.content == result.content


def test_large_work_becomes_a_job_by_itself(service: Any) -> None:
    content = heavy(0.61)
    plan = service.http.post("/v1/plan/impact-modes", json=content).json()
    assert not plan["inline"]
    answer = service.http.post("/v1/compute/impact-modes", json=content)
    assert answer.status_code == 202
    assert answer.json()["estimate"] == pytest.approx(plan["seconds"], rel=0.5)
    done = wait(service, answer.json()["id"])
    assert done["state"] == "succeeded"
    assert len(service.http.get(done["result"]).json()["impulse"]) == 400_000


def test_equal_requests_at_the_same_time_are_computed_once(service: Any) -> None:
    content = request(20_000, 0.7)

    def post(_: int) -> Any:
        return service.http.post("/v1/compute/impact-modes", json=content)

    with ThreadPoolExecutor(16) as pool:
        answers = list(pool.map(post, range(48)))
    assert {answer.status_code for answer in answers} == {200}
    assert len({answer.content for answer in answers}) == 1
    caches = [answer.headers["cache-status"] for answer in answers]
    assert caches.count("vibroimpact; fwd=miss") == 1


def test_prefer_wait_gives_the_result_of_the_job(service: Any) -> None:
    headers = {"Prefer": "respond-async, wait=20"}
    answer = service.http.post("/v1/compute/impact-modes", json=request(51), headers=headers)
    assert answer.status_code == 200
    assert answer.headers["preference-applied"] == "respond-async, wait=20"


def test_events_go_on_where_they_were_cut(service: Any) -> None:
    job = submit(service, heavy(0.62))["id"]
    address, seen, last = f"/v1/jobs/{job}/events", 0, ""
    numbers: list[int] = []
    while last != "end":
        headers = {"Last-Event-ID": str(seen)} if seen else {}
        with service.http.stream("GET", address, headers=headers) as stream:
            # One event of each stream, then it is cut.
            seen, last, document = next(events(stream.iter_lines()))
        numbers.append(seen)
        assert document["id"] == job
        assert document["final"] == (last == "end")
    assert numbers == sorted(set(numbers))
    assert len(numbers) > 2


def test_cancelled_jobs_stop(service: Any) -> None:
    job = submit(service, heavy(0.63))["id"]
    while service.http.get(f"/v1/jobs/{job}").json()["state"] == "queued":
        time.sleep(0.02)
    assert service.http.delete(f"/v1/jobs/{job}").is_success
    assert wait(service, job)["state"] == "cancelled"
    assert service.http.get(f"/v1/jobs/{job}/result").json()["code"] == "no_result"
    assert service.http.delete(f"/v1/jobs/{job}").json()["state"] == "cancelled"


def test_idempotency_keys_hold(service: Any) -> None:
    with ThreadPoolExecutor(8) as pool:
        jobs = list(
            pool.map(
                lambda _: submit(service, request(60), **{"Idempotency-Key": "once"}), range(8)
            )
        )
    assert len({job["id"] for job in jobs}) == 1


def test_bad_requests_leave_nothing_on_disk(start: Callable[..., Any], tmp_path: Path) -> None:
    service = start(tmp_path)
    bad = [
        {**request(), "system": {"M": [[1, 2], [2, 1]], "K": [[1, 0], [0, 1]], "constraints": []}},
        {**request(), "color": "red"},
        {**request(), "frequency": {"values": []}},
        {**request(), "system": {**CHAIN, "n": 10**9}},
    ]
    for content in bad:
        for address, body in (
            ("/v1/compute/impact-modes", content),
            ("/v1/plan/impact-modes", content),
            ("/v1/jobs", {"kind": "impact-modes", "request": content}),
        ):
            assert service.http.post(address, json=body).status_code in (413, 422)
    assert not (tmp_path / "store").exists()
    assert service.http.get("/v1/jobs").json()["jobs"] == []
    assert service.stop() == 0


def test_hostile_bodies_are_refused_quickly_and_the_service_lives_on(service: Any) -> None:
    header = {"Content-Type": "application/json"}
    for body in (
        b"[" * 10**6,
        b'{"a":' * 10**6,
        b'{"system":' + b'{"M":{"scalar":1,"n":1000000000}}' * 2 + b"}",
        b'{"system":{"preset":"chain","n":' + b"9" * 10**6 + b"}}",
        b'{"frequency":{"values":[' + b"1e999," * 10**5 + b"1]}}",
        json.dumps({str(i): i for i in range(90_000)}).encode(),
        b"\x1f\x8b\x08" + bytes(1000),
        b"PK\x03\x04" + bytes(1000),
    ):
        answer = service.http.post("/v1/compute/impact-modes", content=body, headers=header)
        assert 400 <= answer.status_code < 500
        assert answer.headers["content-type"] == "application/problem+json"
        assert len(answer.content) < 20_000
    assert service.http.get("/v1/health/ready").is_success


def test_sigterm_ends_streams_and_waits_and_leaves_jobs_for_later(
    start: Callable[..., Any], tmp_path: Path
) -> None:
    service = start(tmp_path, threads="1")
    service.wait_ready()
    known = service.http.post("/v1/compute/impact-modes", json=request(70))
    etag, address = known.headers["etag"], known.headers["content-location"]
    job = submit(service, heavy())["id"]
    opened, asked, ended = threading.Event(), threading.Event(), threading.Event()

    def follow() -> None:
        with httpx2.stream("GET", f"{service.url}/v1/jobs/{job}/events", timeout=60) as stream:
            for _ in stream.iter_bytes():
                opened.set()
        ended.set()

    def sent(step: str, _: Any) -> None:
        if step == "http11.receive_response_headers.started":
            asked.set()

    def poll() -> Any:
        with httpx2.Client(base_url=service.url, timeout=60) as http:
            address = f"/v1/jobs/{job}?wait=25"
            return http.request("GET", address, extensions={"trace": sent})

    with ThreadPoolExecutor(2) as pool:
        following, polling = pool.submit(follow), pool.submit(poll)
        assert opened.wait(60)
        assert asked.wait(60)
        for _ in range(5):  # answered after what was sent before has been read
            assert service.http.get("/v1/health/live").is_success
        assert service.stop() == 0
        following.result(60)
        assert polling.result(60).is_success
    assert ended.is_set()
    assert not service.note.exists()
    assert "Traceback" not in (tmp_path / "stderr.txt").read_text()
    again = start(tmp_path)
    kept = again.http.get(address)
    assert (kept.headers["etag"], kept.content) == (etag, known.content)
    assert wait(again, job)["state"] == "succeeded"
    assert again.stop(signal.SIGINT) == 0


def test_a_flipped_bit_in_a_stored_result_is_noticed_and_made_good(
    start: Callable[..., Any], tmp_path: Path
) -> None:
    service = start(tmp_path)
    first = service.http.post("/v1/compute/impact-modes", json=request(80)).json()
    assert service.stop() == 0
    for path in (tmp_path / "store" / "results").rglob(f"{first['digest']}*"):
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 4
        path.write_bytes(bytes(data))
    again = start(tmp_path)
    answer = again.http.post("/v1/compute/impact-modes", json=request(80))
    assert answer.headers["cache-status"] == "vibroimpact; fwd=miss"
    assert answer.json()["impulse"] == first["impulse"]
    assert again.stop() == 0
