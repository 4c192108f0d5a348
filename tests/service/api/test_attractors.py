"""Attractors over HTTP: tables, files, wrong fields, the plan, and bifurcation diagrams."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
import xarray
from starlette.testclient import TestClient

from vibroimpact_schema import examples
from vibroimpact_service.kinds import KINDS

COMPUTE = "/v1/compute/attractors"
HDF5 = {"Accept": "application/x-hdf5"}


@pytest.fixture
def content() -> dict[str, Any]:
    example: dict[str, Any] = examples.requests("attractors")["oscillator"]["request"]
    return example


def test_both_encodings_have_the_tables(http: TestClient, content: dict[str, Any]) -> None:
    content["initial"]["x"][4] = [7.0]
    answer = http.post(COMPUTE, json=content)
    assert answer.status_code == 200, answer.text
    result: Any = KINDS["attractors"].result.model_validate_json(answer.content)
    assert result.attractor.nature == ["periodic", "periodic"]
    assert sorted(result.attractor.period) == [1, 3]
    assert sum(result.attractor.motions) == 8
    assert sum(result.attractor.fraction) == pytest.approx(1.0)
    assert result.settled.status[4] == "invalid"
    assert result.settled.attractor[4] == -1
    assert result.settled.exponent[4] is None
    assert result.attractor.verification == ["confirmed", "confirmed"]
    assert len(result.impact.phase) == len(result.section.x) == 4
    file = http.post(COMPUTE, json=content, headers=HDF5)
    with (
        xarray.open_dataset(io.BytesIO(file.content), engine="h5netcdf") as data,
        xarray.open_dataset(io.BytesIO(file.content), engine="h5netcdf", group="attractor") as rows,
    ):
        assert not [dim for dim in data.dims if str(dim).startswith("phony")]
        assert data.motion.size == 9
        assert rows.x.dims == ("attractor_index", "dof")
        assert rows.nature.attrs["flag_meanings"].split()[1] == "quasi-periodic"
        np.testing.assert_array_equal(rows.period, result.attractor.period)


@pytest.mark.parametrize(
    ("path", "value", "pointer"),
    [
        ("load", [], "/load"),
        ("load", [{"dof": 3, "amplitude": 1.0}], "/load/0/dof"),
        ("load", [{"dof": 0, "amplitude": 1.0, "frequency": 1.7}], "/load/0/frequency"),
        ("load", [{"dof": 0, "amplitude": 1.0, "harmonic": 1.5}], "/load/0/harmonic"),
        ("frequency", {"values": [1.0, 2.0]}, "/frequency"),
        ("observe", 20, "/observe"),
        ("longest", 0, "/longest"),
        ("section", "nowhere", "/section"),
        ("tolerance", 0.5, "/tolerance"),
        ("dofs", [1], "/dofs/0"),
        ("initial", {"x": [[0.0, 0.0]], "v": [[0.0, 0.0]]}, "/initial/x"),
        ("initial", {"x": [[0.0]] * 3, "v": [[1e200]] * 3}, "/initial/v"),
        ("frequency", {"values": [1e-99]}, "/frequency"),
    ],
)
def test_wrong_fields_are_named(
    http: TestClient, content: dict[str, Any], path: str, value: Any, pointer: str
) -> None:
    answer = http.post(COMPUTE, json={**content, path: value})
    assert answer.status_code == 422, answer.text
    assert [error["pointer"] for error in answer.json()["errors"]] == [pointer]


def test_a_structure_without_losses_is_refused(http: TestClient, content: dict[str, Any]) -> None:
    """There is no attractor, and the answer says so."""
    content["system"] |= {"zeta": 0.0, "constraints": [{"dof": 0, "gap": 1.0}]}
    answer = http.post(COMPUTE, json=content)
    assert answer.status_code == 422
    (error,) = answer.json()["errors"]
    assert error["pointer"] == "/system/zeta"
    assert "no attractor" in error["message"]


def test_the_plan_says_what_is_done_once(http: TestClient, content: dict[str, Any]) -> None:
    content["outputs"] = ["section"]
    plan = http.post("/v1/plan/attractors", json=content).json()
    counts = {step["stage"]: step["count"] for step in plan["steps"]}
    assert counts == {"spectrum": 1, "flight": 9, "history": 1, "stability": 1, "response": 1}
    assert not plan["bounded"]
    assert plan["skips"] == [{"what": "stability", "why": "not requested"}]


def test_a_plan_of_long_observations_of_many_motions_is_queued(
    http: TestClient, content: dict[str, Any]
) -> None:
    content["initial"] = {name: [[0.0]] * 2000 for name in ("x", "v")}
    answer = http.post(COMPUTE, json={**content, "observe": 10_000})
    assert answer.status_code == 202


def test_a_sweep_is_a_bifurcation_diagram(http: TestClient, content: dict[str, Any]) -> None:
    content |= {"points": 40, "observe": 400}
    axes = [{"path": "frequency.values.0", "name": "Omega_drive", "values": [2.0, 2.7, 2.8]}]
    answer = http.post(
        "/v1/compute/sweep",
        json={"kind": "attractors", "base": content, "axes": axes},
        headers={"Prefer": "wait=60"},
    )
    assert answer.status_code == 200, answer.text
    result = answer.json()
    assert result["section_count"] == [1, 2, 40]
    assert len(result["section"]["x"]) == 43
    assert result["attractor"]["nature"] == ["periodic", "periodic", "chaotic"]
