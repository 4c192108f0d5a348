"""Slow flows over HTTP: both representations, the plan, a job, and wrong fields by name."""

from __future__ import annotations

import io
import math
from typing import Any

import numpy as np
import pytest
import xarray
from starlette.testclient import TestClient

from vibroimpact_schema import examples
from vibroimpact_service.kinds import KINDS

COMPUTE = "/v1/compute/slow-flow"
HDF5 = {"Accept": "application/x-hdf5"}


@pytest.fixture
def content() -> dict[str, Any]:
    example: dict[str, Any] = examples.requests("slow-flow")["restitution"]["request"]
    return example


@pytest.mark.parametrize("name", examples.requests("slow-flow"))
def test_json_and_hdf5_hold_the_same_numbers(http: TestClient, name: str) -> None:
    body = examples.requests("slow-flow")[name]["request"]
    answer = http.post(COMPUTE, json=body)
    assert answer.status_code == 200, answer.text
    result: Any = KINDS["slow-flow"].result.model_validate_json(answer.content)
    file = http.post(COMPUTE, json=body, headers=HDF5)
    with xarray.open_dataset(io.BytesIO(file.content), engine="h5netcdf") as data:
        assert not [dim for dim in data.dims if str(dim).startswith("phony")]
        np.testing.assert_array_equal(data.t, result.t)
        np.testing.assert_array_equal(data.x, np.array(result.x))
        expected = math.inf if result.t_max is None else result.t_max
        assert float(data.t_max) == expected
    with xarray.open_dataset(io.BytesIO(file.content), engine="h5netcdf", group="error") as data:
        np.testing.assert_array_equal(data.phi, np.array(result.error.phi, dtype=float))
        assert float(data.seconds) == result.error.seconds
        assert data.attrs["statement"] == result.error.statement
    assert len(result.impacts.time) == len(result.impact or [])


def test_what_is_not_asked_is_absent(http: TestClient, content: dict[str, Any]) -> None:
    answer = http.post(COMPUTE, json={**content, "outputs": ["state"]}).json()
    assert "phi" in answer
    assert not {"x", "v", "impulse", "impacts", "dof"} & set(answer)
    assert set(answer["error"]) == {"seconds", "statement", "t_max", "t_max_exact"}


def test_the_plan_compares_with_the_exact_motion(http: TestClient, content: dict[str, Any]) -> None:
    plan = http.post("/v1/plan/slow-flow", json=content).json()
    assert [step["stage"] for step in plan["steps"]] == ["slow_flow", "flight"]
    assert plan["inline"]


def test_a_job_has_the_same_result(http: TestClient, content: dict[str, Any]) -> None:
    direct = http.post(COMPUTE, json=content)
    job = http.post("/v1/jobs", json={"kind": "slow-flow", "request": content})
    assert job.status_code == 201
    found = http.get(f"/v1/jobs/{job.json()['id']}/result")
    assert found.headers["etag"] == direct.headers["etag"]


@pytest.mark.parametrize(
    ("change", "pointer"),
    [
        ({"variant": "averaged"}, "/variant"),
        ({"variant": "wrong"}, "/variant"),
        ({"model": "wrong"}, "/model"),
        ({"initial": {}}, "/initial/omega"),
        ({"initial": {"omega": -1}}, "/initial/omega"),
        ({"initial": {"omega": 0.5}}, "/initial/omega"),
        ({"initial": {"A": 1}}, "/initial/A"),
        ({"t": {"values": [-1]}}, "/t/values/0"),
        ({"t": {"values": []}}, "/t/values"),
        ({"outputs": []}, "/outputs"),
        ({"system": {"preset": "chain", "n": 3, "constraints": []}}, "/system"),
    ],
)
def test_wrong_fields_are_named(
    http: TestClient, content: dict[str, Any], change: dict[str, Any], pointer: str
) -> None:
    answer = http.post(COMPUTE, json=content | change)
    assert answer.status_code == 422, answer.text
    assert pointer in [error["pointer"] for error in answer.json()["errors"]]


def test_too_many_times(http: TestClient, content: dict[str, Any]) -> None:
    answer = http.post(COMPUTE, json=content | {"t": {"stop": 1, "num": 2**40}})
    assert answer.status_code == 413
    assert answer.json()["errors"][0]["pointer"] == "/t"
