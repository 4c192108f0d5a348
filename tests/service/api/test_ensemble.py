"""Ensembles over HTTP: ragged tables, wrong members, the plan, and jobs in pieces."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
import xarray
from starlette.testclient import TestClient

from vibroimpact_schema import examples
from vibroimpact_schema.requests import EnsembleRequest
from vibroimpact_service.documents import digest, planning, requests
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.results import encode
from vibroimpact_service.store import Store
from vibroimpact_service.use_case import chunks as job_chunks
from vibroimpact_service.use_case import computation

COMPUTE = "/v1/compute/ensemble"
HDF5 = {"Accept": "application/x-hdf5"}


@pytest.fixture
def content() -> dict[str, Any]:
    example: dict[str, Any] = examples.requests("ensemble")["oscillator"]["request"]
    return example


def test_rows_of_the_tables_are_found_by_count_and_offset(
    http: TestClient, content: dict[str, Any]
) -> None:
    content["initial"]["x"][2] = [7.0]
    answer = http.post(COMPUTE, json=content)
    assert answer.status_code == 200, answer.text
    result: Any = KINDS["ensemble"].result.model_validate_json(answer.content)
    assert result.status == ["ok", "ok", "invalid", "ok"]
    assert result.x[2] == [[None]]
    assert result.impact_count[2:] == [0, 0]
    assert sum(result.impact_count) == len(result.impacts.time)
    file = http.post(COMPUTE, json=content, headers=HDF5)
    with (
        xarray.open_dataset(io.BytesIO(file.content), engine="h5netcdf") as data,
        xarray.open_dataset(io.BytesIO(file.content), engine="h5netcdf", group="impacts") as rows,
    ):
        assert not [dim for dim in data.dims if str(dim).startswith("phony")]
        assert data.x.dims == ("member", "t", "dof")
        assert data.impact_count.attrs["sample_dimension"] == "impact"
        np.testing.assert_array_equal(data.impact_count, result.impact_count)
        assert data.status.attrs["flag_meanings"].split()[int(data.status[2])] == "invalid"
        assert rows.time.dims == ("impact",)
        start, count = int(data.impact_offset[1]), int(data.impact_count[1])
        mine = rows.time[start : start + count].values
    alone = {
        **content,
        "initial": {name: content["initial"][name][1] for name in ("x", "v")},
    }
    single = http.post("/v1/compute/time-history", json=alone)
    expected: Any = KINDS["time-history"].result.model_validate_json(single.content)
    np.testing.assert_array_equal(mine, expected.impacts.time)
    assert result.x[1] == expected.x


def test_the_plan_says_what_members_share(http: TestClient, content: dict[str, Any]) -> None:
    plan = http.post("/v1/plan/ensemble", json=content).json()
    counts = {step["stage"]: step["count"] for step in plan["steps"]}
    assert counts == {"spectrum": 1, "flight": 4, "history": 4}
    assert any(skip["what"] == "spectrum at 3 of 4 members" for skip in plan["skips"])


@pytest.mark.parametrize(
    ("change", "pointer"),
    [
        ({"initial": {"x": [[0.0], [0.0, 1.0]], "v": [[1.0], [1.0]]}}, "/initial/x"),
        ({"initial": {"x": [[0.0], [0.0]], "v": [[1.0]]}}, "/initial"),
        ({"initial": {"x": [[0.0, 1.0]], "v": [[1.0, 1.0]]}}, "/initial/x"),
        ({"initial": {"x": [], "v": []}}, "/initial/x"),
        ({"initial": {"x": [[]], "v": [[]]}}, "/initial/x/0"),
        ({"initial": {"x": [0.0], "v": [[1.0]]}}, "/initial/v/0"),
        ({"initial": [{"x": [0.0], "v": [1.0]}, {"x": [0.0]}]}, "/initial/1/v"),
        ({"t_end": 0}, "/t_end"),
        ({"t": [1.0, 50.0]}, "/t"),
        ({"dofs": [1]}, "/dofs/0"),
        ({"tolerance": 1e-20}, "/tolerance"),
        ({"initial": {"x": [[1e200]] * 3, "v": [[1.0]] * 3}}, "/initial/x"),
        ({"initial": {"x": [[0.0]] * 3, "v": [[1e-200]] * 3}}, "/initial/v"),
    ],
)
def test_wrong_fields_are_named(
    http: TestClient, content: dict[str, Any], change: dict[str, Any], pointer: str
) -> None:
    answer = http.post(COMPUTE, json={**content, **change})
    assert answer.status_code == 422, answer.text
    assert pointer in [error["pointer"] for error in answer.json()["errors"]]


@pytest.mark.parametrize("address", [COMPUTE, "/v1/plan/ensemble"])
def test_many_members_all_out_of_range_are_one_fault(
    http: TestClient, content: dict[str, Any], address: str
) -> None:
    content["initial"] = {"x": [[1e200]] * 5000, "v": [[1.0]] * 5000}
    answer = http.post(address, json=content)
    assert answer.status_code == 422, answer.text
    assert [error["code"] for error in answer.json()["errors"]] == ["out_of_range"]
    assert len(answer.content) < 1000


def test_a_job_in_pieces_has_the_numbers_of_one_in_one_go(
    store: Store, content: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(job_chunks, "CHUNK_SECONDS", 0.002)
    rng = np.random.default_rng(2)
    content["initial"] = {
        "x": rng.uniform(-0.9, 0.9, (70, 1)).tolist(),
        "v": (3.0 * rng.standard_normal((70, 1))).tolist(),
    }
    content["initial"]["x"][33] = [1.5]
    request = EnsembleRequest.model_validate(content)
    data, kind = digest.canonical(request), KINDS["ensemble"]
    store.requests.put("b" * 64, requests.stored_form("ann", data))
    chunks = job_chunks.split(store.url, kind.name, "b" * 64, "c" * 64)
    assert len(chunks) > 10
    job_chunks.solve(store.url, kind.name, "b" * 64, "c" * 64, range(len(chunks)))
    job_chunks.join(store.url, kind.name, "b" * 64, "c" * 64, chunks)
    computation.put(
        store,
        computation.compute(planning.plan(store, kind, request), "d" * 64, data),
        durable=False,
    )
    joined, once = (encode.unpack(store.results.get(n * 64) or b"") for n in "cd")
    assert set(joined.arrays) == set(once.arrays)
    for field, values in once.arrays.items():
        np.testing.assert_array_equal(joined.arrays[field], values)
    assert joined.plain == once.plain
