"""POST /v1/compute and /v1/plan: headers, encodings, and every refusal as a problem."""

from __future__ import annotations

import io
import json
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray
from starlette.testclient import TestClient

from vibroimpact_schema.problems import Problem
from vibroimpact_service.app import create_app
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.settings import Settings
from vibroimpact_solvers import impact_modes

COMPUTE = "/v1/compute/impact-modes"
HDF5 = {"Accept": "application/x-hdf5"}


def post(http: TestClient, content: Any, **headers: str) -> Any:
    body = content if isinstance(content, bytes) else json.dumps(content).encode()
    names = {name.replace("_", "-"): value for name, value in headers.items()}
    return http.post(COMPUTE, content=body, headers={"Content-Type": "application/json", **names})


def problem(answer: Any, status: int) -> Problem:
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.headers["cache-control"] == "no-store"
    document = Problem.model_validate_json(answer.content)
    assert document.status == status
    assert document.request_id == answer.headers["x-request-id"]
    return document


def test_a_result_comes_with_its_name(http: TestClient, request_body: dict[str, Any]) -> None:
    first = post(http, request_body)
    assert first.status_code == 200
    result: Any = KINDS["impact-modes"].result.model_validate_json(first.content)
    headers = first.headers
    assert headers["content-type"] == "application/json"
    assert headers["content-location"] == f"/v1/results/{result.digest}"
    assert headers["cache-status"] == "vibroimpact; fwd=miss"
    assert headers["cache-control"] == "private, max-age=31536000, immutable"
    assert headers["vary"] == "Accept, Accept-Encoding"
    assert all(part in headers["server-timing"] for part in ("plan;", "solve;", "encode;"))
    again = post(http, request_body)
    assert again.headers["cache-status"] == "vibroimpact; hit"
    assert again.content == first.content
    assert again.headers["etag"] == headers["etag"]
    assert again.headers["repr-digest"] == headers["repr-digest"]


def test_what_one_has_is_not_sent_again(http: TestClient, request_body: dict[str, Any]) -> None:
    etag = post(http, request_body).headers["etag"]
    answer = post(http, request_body, If_None_Match=etag)
    assert answer.status_code == 304
    assert answer.content == b""
    assert answer.headers["etag"] == etag
    assert post(http, request_body, If_None_Match='"other"').status_code == 200
    assert post(http, request_body, If_None_Match=etag, **HDF5).status_code == 200


def test_both_encodings_hold_the_same_bits(http: TestClient, request_body: dict[str, Any]) -> None:
    request_body["outputs"] = ["impulse", "exists", "reason", "shape", "waveform", "energy"]
    request_body["tau"] = [0.0, 0.5, 1.0]
    request_body["dofs"] = [3, 0]
    document = post(http, request_body).json()
    answer = post(http, request_body, **HDF5)
    assert answer.headers["content-type"] == "application/x-hdf5"
    with h5py.File(io.BytesIO(answer.content)) as file:
        for path in (
            *("impulse", "shape", "waveform", "energy"),
            *("frequency/Omega", "frequency/omega", "tau", "error/impulse"),
        ):
            value: Any = document
            for part in path.split("/"):
                value = value[part]
            assert np.array(value, dtype=float).tobytes() == file[path][...].tobytes(), path
        reasons = file["reason"].attrs["flag_meanings"].split()
        assert [reasons[code] for code in file["reason"]] == document["reason"]
        assert [bool(code) for code in file["exists"]] == document["exists"]
        assert file["dof"][...].tolist() == document["dof"] == [3, 0]
        assert file["waveform"].shape == (5, 3, 2)
        assert file.attrs["digest"] == document["digest"]
        assert json.loads(file.attrs["plan"]) == document["plan"]
        assert json.loads(file.attrs["request"])["dofs"] == [3, 0]
    with xarray.open_dataset(io.BytesIO(answer.content), engine="h5netcdf") as data:
        assert data["waveform"].dims == ("Omega", "tau", "dof")
        assert float(data["impulse"].sel(Omega=1.25, constraint=0)) == document["impulse"][1][0]


def test_units_reach_the_file(http: TestClient, request_body: dict[str, Any]) -> None:
    request_body["system"]["units"] = {"length": "mm", "mass": "kg", "time": "s"}
    with h5py.File(io.BytesIO(post(http, request_body, **HDF5).content)) as file:
        assert file["impulse"].attrs["units"] == "mN"


@pytest.mark.parametrize(
    ("path", "value", "pointer", "code"),
    [
        (("system", "K"), [[1, 2, 3], [2, 1, 3]], "/system/K", "not_square"),
        (("system", "K"), [[1, 2], [3, 1]], "/system/K", "not_symmetric"),
        (("system", "K"), [[1, 2], [2]], "/system/K", "not_square"),
        (("system", "M"), [[1, 2], [3, 1]], "/system/M", "not_symmetric"),
        (("system", "M"), [[1, 2], [2, 1]], "/system/M", "not_positive_definite"),
        (("system", "M"), [[1, 1], [1, 1]], "/system/M", "not_positive_definite"),
        (("system", "M"), [[0, 0], [0, 1]], "/system/constraints/0", "massless_constraint"),
        (("system", "K"), [[1, float("nan")], [0, 1]], "/system/K/0/1", "not_finite"),
        (("system", "K"), [[1, float("inf")], [0, 1]], "/system/K/0/1", "not_finite"),
        (("system", "K"), [["1", 0], [0, 1]], "/system/K/0/0", "wrong_type"),
        (("system", "constraints", 0, "dof"), 2, "/system/constraints/0/dof", "index_out_of_range"),
        (("system", "constraints", 0, "dof"), -1, "/system/constraints/0/dof", "out_of_range"),
        (
            ("system", "constraints"),
            [{"dof": 0, "gap": 1}, {"dof": 0, "gap": 2}],
            "/system/constraints/1",
            "duplicate_constraint",
        ),
        (("system", "constraints", 0, "gap"), 0, "/system/constraints/0/gap", "out_of_range"),
        (("system", "constraints", 0, "gap"), -0.1, "/system/constraints/0/gap", "out_of_range"),
        (
            ("system", "constraints", 0, "gap"),
            {"lower": 0.2, "upper": -0.2},
            "/system/constraints/0/gap",
            "gap_not_positive",
        ),
        (("frequency",), {"values": []}, "/frequency/values", "too_short"),
        (("frequency",), {"start": 2, "stop": 1, "num": 3}, "/frequency/stop", "reversed_grid"),
        (("frequency",), {"start": 1, "stop": 2, "num": 0}, "/frequency/num", "out_of_range"),
        (("frequency",), {"values": [float("nan")]}, "/frequency/values/0", "not_finite"),
        (("color",), "red", "/color", "unknown_field"),
        (("system", "color"), "red", "/system/color", "unknown_field"),
        (("active",), [1], "/active/0", "index_out_of_range"),
        (("active",), [0, 0], "/active", "duplicate_index"),
        (("dofs",), [2], "/dofs/0", "index_out_of_range"),
        (("outputs",), ["force"], "/outputs/0", "unknown_choice"),
        (("outputs",), ["waveform"], "/tau", "missing_tau"),
        (("tau",), [1.5], "/tau/0", "out_of_range"),
        (("tolerance",), 0, "/tolerance", "out_of_range"),
    ],
)
def test_wrong_requests_are_pointed_at_and_leave_nothing(
    http: TestClient, tmp_path: Path, path: tuple[Any, ...], value: Any, pointer: str, code: str
) -> None:
    body: dict[str, Any] = {
        "system": {
            "M": [[1, 0], [0, 1]],
            "K": [[2, -1], [-1, 2]],
            "constraints": [{"dof": 0, "gap": 0.2}],
        },
        "frequency": {"values": [1.2]},
    }
    place: Any = body
    for part in path[:-1]:
        place = place[part]
    place[path[-1]] = value
    for address in (COMPUTE, "/v1/plan/impact-modes"):
        answer = http.post(
            address, content=json.dumps(body), headers={"Content-Type": "application/json"}
        )
        first = problem(answer, 422).errors[0]
        assert (first.pointer, first.code) == (pointer, code)
    job = json.dumps({"kind": "impact-modes", "request": body})
    answer = http.post("/v1/jobs", content=job, headers={"Content-Type": "application/json"})
    assert problem(answer, 422).errors[0].pointer.removeprefix("/request") == pointer
    assert not (tmp_path / "store").exists()
    assert http.get("/v1/jobs").json()["jobs"] == []


@pytest.mark.parametrize(
    ("system", "pointer"),
    [
        ({"preset": "chain", "n": 501}, "/system"),
        ({"preset": "chain", "n": 10**12}, "/system"),
        ({"M": {"scalar": 1, "n": 10**9}, "K": {"scalar": 1, "n": 10**9}}, "/system"),
        (
            {
                "M": {"scalar": 1, "n": 2},
                "K": {"shape": [10**9, 10**9], "row": [], "col": [], "data": []},
            },
            "/system",
        ),
    ],
)
def test_too_large_systems(
    http: TestClient, tmp_path: Path, system: dict[str, Any], pointer: str
) -> None:
    content = {
        "system": {"constraints": [{"dof": 0, "gap": 1}], **system},
        "frequency": {"values": [1]},
    }
    document = problem(post(http, content), 413)
    assert document.errors[0].pointer == pointer
    assert not (tmp_path / "store").exists()


@pytest.mark.parametrize(
    "frequency", [{"start": 1, "stop": 2, "num": 10**12}, {"start": 1, "stop": 2, "step": 1e-14}]
)
def test_too_many_points(
    http: TestClient, request_body: dict[str, Any], frequency: dict[str, Any]
) -> None:
    answer = post(http, {**request_body, "frequency": frequency})
    assert problem(answer, 413).errors[0].pointer == "/frequency"


def test_too_large_results(http: TestClient, request_body: dict[str, Any]) -> None:
    large = {
        **request_body,
        "frequency": {"start": 1, "stop": 2, "num": 100_000},
        "outputs": ["waveform"],
        "tau": [i / 10_000 for i in range(10_000)],
    }
    assert problem(post(http, large), 413).errors[0].code == "result_too_large"


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b"", 400),
        (b"{", 400),
        (b'{"system": {}, "system": {}}', 400),
        (b"[" * 10_000, 400),
        (b'{"a":' * 10_000 + b"1" + b"}" * 10_000, 400),
        (b'{"\\ud800": 1}', 400),
        (b'"\\ud800"', 400),
        (b"\x89HDF\r\n\x1a\n" * 100, 400),
        (b"9" * 10_000, 400),
        (b"null", 422),
        (b"NaN", 422),
        (b"1e400", 422),
        (b"[]", 422),
        (b"{}", 422),
        (b'{"system": "s3cret", "frequency": "s3cret"}', 422),
        (b"[" + b"1," * 2**20 + b"1]", 413),
        (json.dumps({str(i): 1 for i in range(100)}).encode(), 422),
    ],
)
def test_malformed_bodies(http: TestClient, body: bytes, status: int) -> None:
    answer = post(http, body)
    problem(answer, status)
    assert "s3cret" not in answer.text


def test_media_types(http: TestClient, request_body: dict[str, Any]) -> None:
    text = post(http, request_body, Content_Type="text/plain")
    problem(text, 415)
    assert text.headers["accept"] == "application/json"
    problem(post(http, request_body, Content_Type="application/json; charset=latin-1"), 415)
    assert post(http, request_body, Content_Type="application/json; charset=utf-8").is_success
    compressed = post(http, request_body, Content_Encoding="gzip")
    problem(compressed, 415)
    assert compressed.headers["accept-encoding"] == "identity"
    problem(http.post(COMPUTE, content=b"{}"), 415)
    problem(post(http, request_body, Accept="text/html"), 406)


def test_a_claimed_length_is_believed(http: TestClient) -> None:
    problem(post(http, b"{}", Content_Length=str(10**12)), 413)


def test_a_body_without_length_is_counted(http: TestClient) -> None:
    def parts() -> Any:
        for _ in range(64):
            yield b" " * 2**16

    answer = http.post(COMPUTE, content=parts(), headers={"Content-Type": "application/json"})
    problem(answer, 413)


def test_a_plan_says_what_is_done_and_what_not(
    http: TestClient, request_body: dict[str, Any]
) -> None:
    plan = http.post("/v1/plan/impact-modes", json=request_body).json()
    assert {step["stage"] for step in plan["steps"]} == {"spectrum", "impulse", "existence"}
    assert all(step["method"] and step["reason"] for step in plan["steps"])
    assert {"waveform", "energy"} <= {skip["what"] for skip in plan["skips"]}
    assert plan["inline"]
    assert not plan["cached"]
    answer = post(http, request_body)
    assert answer.headers["content-location"].endswith(plan["digest"])
    assert http.post("/v1/plan/impact-modes", json=request_body).json()["cached"]


def test_prefer(http: TestClient, request_body: dict[str, Any], queue: Any) -> None:
    answer = post(http, request_body, Prefer="respond-async")
    assert answer.status_code == 202
    assert answer.headers["preference-applied"] == "respond-async"
    assert answer.headers["location"] == f"/v1/jobs/{answer.json()['id']}"
    assert answer.headers["cache-control"] == "no-store"
    queue.at_once = True
    answer = post(http, request_body, Prefer="respond-async, wait=3600")
    assert answer.status_code == 200
    assert answer.headers["preference-applied"] == "respond-async, wait=20"
    assert "preference-applied" not in post(http, request_body).headers


def test_a_key_stands_for_the_job_that_a_request_became(
    http: TestClient, request_body: dict[str, Any]
) -> None:
    first = post(http, request_body, Prefer="respond-async", Idempotency_Key="k")
    again = post(http, request_body, Prefer="respond-async", Idempotency_Key="k")
    assert first.json()["id"] == again.json()["id"]
    request_body["frequency"]["num"] = 6
    clash = post(http, request_body, Prefer="respond-async", Idempotency_Key="k")
    assert problem(clash, 422).code == "idempotency_key_reused"
    problem(post(http, request_body, Idempotency_Key="a b"), 400)


@pytest.mark.parametrize("key", ["k", '"', '""', '"k"', "'", "~" * 255])
def test_any_visible_text_is_an_idempotency_key(
    http: TestClient, request_body: dict[str, Any], key: str
) -> None:
    first = post(http, request_body, Prefer="respond-async", Idempotency_Key=key)
    assert first.status_code == 202
    again = post(http, request_body, Prefer="respond-async", Idempotency_Key=key.strip('"') or key)
    assert again.json()["id"] == first.json()["id"]


def test_unknown_kinds_are_not_found(http: TestClient) -> None:
    problem(http.post("/v1/compute/no-such-kind", json={}), 404)
    problem(http.get(COMPUTE), 405)


def test_what_takes_longer_than_planned_becomes_a_job(
    settings: Settings, queue: Any, request_body: dict[str, Any]
) -> None:
    hasty = settings.model_copy(update={"inline_overrun_seconds": 1e-9})
    with TestClient(create_app(hasty, queue)) as http:
        answer = http.post("/v1/compute/impact-modes", json=request_body)
        assert answer.status_code == 202
        assert answer.headers["Location"] == f"/v1/jobs/{answer.json()['id']}"


def test_what_nobody_waits_for_stops_when_the_service_ends(
    settings: Settings, queue: Any, request_body: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, ended = threading.Event(), threading.Event()

    def endless(problem: Any, plan: Any, tick: Any) -> Any:
        begun.set()
        try:
            while True:
                tick(0, 1)
                time.sleep(0.001)
        finally:
            ended.set()

    monkeypatch.setattr(impact_modes, "solve", endless)
    app = create_app(settings, queue)
    answers: list[Any] = []
    with TestClient(app) as http:
        asking = threading.Thread(target=lambda: answers.append(post(http, request_body)))
        asking.start()
        assert begun.wait(60)
        app.state.services.evaluation.close()
        assert ended.wait(60)
        asking.join(60)
        problem(answers[0], 503)


def test_the_process_ends_beside_a_computation_that_notices_nothing() -> None:
    stuck = (
        "import threading\n"
        "from vibroimpact_service import cli\n"
        "threading.Thread(target=threading.Event().wait).start()\n"
        "cli._end_threads()\n"
    )
    assert subprocess.run([sys.executable, "-c", stuck], timeout=60, check=False).returncode == 0


@pytest.mark.parametrize(
    ("t_end", "status", "code"), [(1e30, 422, "not_possible"), (1e10, 413, "result_too_large")]
)
def test_histories_without_end_are_refused_by_their_end(
    http: TestClient, t_end: float, status: int, code: str
) -> None:
    stop = {"dof": 1, "gap": 0.2}
    history = {
        "system": {"preset": "chain", "n": 3, "constraints": [stop]},
        "initial": {"x": [0.0] * 3, "v": [1.0, 0.0, 0.0]},
        "t_end": t_end,
    }
    for address in ("/v1/plan/time-history", "/v1/compute/time-history"):
        refused = problem(http.post(address, json=history), status).errors[0]
        assert (refused.pointer, refused.code) == ("/t_end", code)
