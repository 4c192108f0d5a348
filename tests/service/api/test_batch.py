"""POST /v1/batch: every request of a batch is answered in its place."""

from __future__ import annotations

import json
import pickle
from typing import Any

import pytest
from starlette.testclient import TestClient

from vibroimpact_schema.results import BatchAnswers
from vibroimpact_service.settings import Settings
from vibroimpact_service.use_case import batches, computation


def test_answers_are_those_of_single_requests(
    http: TestClient, request_body: dict[str, Any]
) -> None:
    bodies = [
        {**request_body, "frequency": {"values": [1.0 + i / 8]}, "outputs": ["impulse", "exists"]}
        for i in range(5)
    ]
    answer = http.post("/v1/batch", json={"kind": "impact-modes", "requests": bodies})
    assert answer.status_code == 200
    BatchAnswers.model_validate_json(answer.content)
    for body, found in zip(bodies, answer.json()["answers"], strict=True):
        single = http.post("/v1/compute/impact-modes", json=body).json()
        for document in (single, found["result"]):
            assert document.pop("provenance")["created"]
            assert document.pop("plan")["steps"]  # the second one finds the spectrum known
        assert found["result"] == single


def test_a_wrong_request_affects_no_other(http: TestClient, request_body: dict[str, Any]) -> None:
    wrong = {**request_body, "color": "red"}
    large = {**request_body, "frequency": {"start": 0.5, "stop": 2.0, "num": 9_000_000}}
    impossible = {**request_body, "system": {"M": [[1, 2], [2, 1]], "K": [[1, 0], [0, 1]]}}
    batch = {"kind": "impact-modes", "requests": [request_body, wrong, large, impossible]}
    answers = http.post("/v1/batch", json=batch).json()["answers"]
    assert answers[0]["result"]["impulse"]
    assert answers[1]["problem"]["errors"][0]["pointer"] == "/color"
    assert answers[2]["problem"]["code"] in ("too_large", "too_costly")  # a plan of so many
    assert answers[3]["problem"]["status"] == 422


def test_numbers_beyond_json_are_told_in_their_place(
    http: TestClient, request_body: dict[str, Any]
) -> None:
    beyond = [
        {**request_body, "active": [10**400]},
        {**request_body, "frequency": {"values": [float("nan")]}},
        {**request_body, "tolerance": float("inf")},
    ]
    content = json.dumps({"kind": "impact-modes", "requests": [*beyond, request_body]})
    answer = http.post("/v1/batch", content=content, headers={"Content-Type": "application/json"})
    assert answer.status_code == 200
    *problems, last = answer.json()["answers"]
    pointers = [each["problem"]["errors"][0]["pointer"] for each in problems]
    assert pointers == ["/active/0", "/frequency/values/0", "/tolerance"]
    assert last["result"]["impulse"]


@pytest.mark.parametrize(
    ("batch", "status", "pointer"),
    [
        ({"kind": "impact-modes", "requests": []}, 422, "/requests"),
        ({"kind": "impact-modes", "requests": [3]}, 422, "/requests/0"),
        ({"kind": "other", "requests": [{}]}, 422, "/kind"),
        ({"kind": "impact-modes", "requests": [{}] * 1001}, 413, "/requests"),
    ],
)
def test_wrong_batches(http: TestClient, batch: Any, status: int, pointer: str) -> None:
    answer = http.post("/v1/batch", json=batch)
    assert answer.status_code == status
    assert answer.json()["errors"][0]["pointer"] == pointer


def test_an_unexpected_error_is_told_in_its_place_without_its_words(
    settings: Settings, request_body: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    compute, told = computation.compute, []

    def failing(*arguments: Any) -> Any:
        if not told:
            raise RuntimeError("/secret/path")
        return compute(*arguments)

    monkeypatch.setattr(computation, "compute", failing)
    contents = pickle.dumps([request_body, request_body])
    first, second = batches.compute(
        settings, "ann", "impact-modes", contents, 10, lambda *progress: told.append(progress)
    )
    problem = json.loads(first)["problem"]
    assert (problem["status"], problem["code"]) == (500, "internal_error")
    assert b"secret" not in first
    assert json.loads(second)["result"]["impulse"]
    assert told == [(10, 2), (11, 2)]
