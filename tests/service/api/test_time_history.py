"""POST /v1/compute/time-history: what cannot be computed is refused with a pointer to it."""

from __future__ import annotations

import json
from typing import Any

import pytest
from starlette.testclient import TestClient

from vibroimpact_schema.problems import Problem

COMPUTE = "/v1/compute/time-history"


def request(**changes: Any) -> bytes:
    base: dict[str, Any] = {
        "system": {"preset": "chain", "n": 3, "constraints": [{"dof": 1, "gap": 0.2}]},
        "initial": {"x": [0.0, 0.0, 0.0], "v": [0.5, 0.0, 0.1]},
        "t_end": 10.0,
    }
    return json.dumps({**base, **changes}).encode()


def post(http: TestClient, body: bytes) -> Any:
    return http.post(COMPUTE, content=body, headers={"Content-Type": "application/json"})


LOAD = {"dof": 0, "amplitude": 0.1, "frequency": 1.0, "phase": 0.0}


@pytest.mark.parametrize(
    ("changes", "pointer"),
    [
        ({"initial": {"x": [0.0, 0.3, 0.0], "v": [0.0, 0.0, 0.0]}}, "/initial/x"),
        ({"initial": {"x": [0.0, 0.0], "v": [0.0, 0.0, 0.0]}}, "/initial/x"),
        ({"t_end": 0.0}, "/t_end"),
        ({"t_end": -1.0}, "/t_end"),
        ({"tolerance": 1e-17}, "/tolerance"),
        ({"load": [{**LOAD, "dof": 3}]}, "/load/0/dof"),
        ({"load": [{"dof": 0, "force": [0.0, 1.0], "interval": 1e-200}]}, "/load/0/interval"),
        ({"load": [{"dof": 0, "force": [0.0, 1.0], "interval": 1.0}]}, "/load/0/interval"),
        ({"load": [{"dof": 0, "force": [0.0, 1.0], "t": [0.0, 1.0]}]}, "/load/0/t"),
        ({"load": [{"dof": 0, "force": [0.0, 1e200], "interval": 99.0}]}, "/load/0/force"),
        (
            {"load": [{"base": [1.0] * 3, "acceleration": [0.0, 1e200], "interval": 99.0}]},
            "/load/0/acceleration",
        ),
        (
            {
                "load": [
                    {
                        "direction": {"dofs": [7], "weights": [1.0]},
                        "force": [0.0, 1.0],
                        "interval": 99.0,
                    }
                ]
            },
            "/load/0/direction",
        ),
        (
            {
                "load": [
                    LOAD,
                    {
                        "direction": {"dofs": [7], "weights": [1.0]},
                        "force": [0.0, 1.0],
                        "interval": 99.0,
                    },
                ]
            },
            "/load/1/direction",
        ),
        ({"load": [LOAD, {**LOAD, "dof": 3}]}, "/load/1/dof"),
        ({"initial": {"impact_mode": {"Omega": 1e200}}}, "/initial/impact_mode/Omega"),
        ({"outputs": ["x"]}, "/t"),
        ({"t": [1.0, 11.0], "outputs": ["x"]}, "/t"),
    ],
)
def test_refusals_point_at_what_is_wrong(
    http: TestClient, changes: dict[str, Any], pointer: str
) -> None:
    answer = post(http, request(**changes))
    assert answer.status_code == 422, answer.text
    found = Problem.model_validate_json(answer.content)
    assert found.errors[0].pointer.removeprefix("/request") == pointer


@pytest.mark.parametrize("number", [b"NaN", b"Infinity", b"1e400"])
def test_loads_without_a_number_are_refused(http: TestClient, number: bytes) -> None:
    body = request(load=[{**LOAD, "amplitude": 0.25}]).replace(b"0.25", number)
    answer = post(http, body)
    assert answer.status_code == 422, answer.text
    assert "load/0/amplitude" in Problem.model_validate_json(answer.content).errors[0].pointer


def test_a_load_in_resonance_is_followed(http: TestClient) -> None:
    """The chain's lowest natural frequency is sqrt(2 - sqrt(2)); the mode is driven to its wall."""
    load = [{**LOAD, "dof": 1, "frequency": (2.0 - 2.0**0.5) ** 0.5}]
    answer = post(http, request(load=load, t_end=40.0))
    assert answer.status_code == 200, answer.text
    assert len(answer.json()["impacts"]["time"]) > 5
