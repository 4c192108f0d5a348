"""Degrees of freedom without mass over HTTP: reasons in plans, fields of refusals."""

from __future__ import annotations

import copy
from typing import Any

import pytest
from starlette.testclient import TestClient

STRUCTURE = {
    "M": {"diagonal": [1.0, 0.0, 1.0]},
    "K": [[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]],
    "constraints": [{"dof": 0, "gap": 0.2, "restitution": 0.8}],
}
FREQUENCY = {"values": [0.9, 2.0]}
STATE = {"x": [0.0, 0.0, 0.0], "v": [1.0, 0.0, 0.0]}
DRIVEN = {
    "system": STRUCTURE, "load": [{"dof": 2, "amplitude": 1.0}], "frequency": FREQUENCY,
    "sequence": "symmetric",
}  # fmt: skip
REQUESTS: dict[str, dict[str, Any]] = {
    "impact-modes": {"system": STRUCTURE, "frequency": FREQUENCY, "outputs": ["shape", "exists"]},
    "existence-bands": {"system": STRUCTURE, "frequency": {"start": 0.8, "stop": 3.0}},
    "resonances": {"system": STRUCTURE, "constraint": 0, "odd_max": 5},
    "periodic-motions": DRIVEN,
    "branches": {
        "base": DRIVEN | {"frequency": {"values": [0.8]}}, "path": "frequency.values.0",
        "start": 0.8, "stop": 2.0,
    },
    "time-history": {
        "system": STRUCTURE, "initial": STATE, "t_end": 5.0, "t": {"num": 6}, "outputs": ["x", "v"],
    },
    "ensemble": {
        "system": STRUCTURE, "initial": {"x": [STATE["x"]] * 2, "v": [STATE["v"]] * 2},
        "t_end": 5.0,
    },
    "sweep": {
        "kind": "impact-modes", "base": {"system": STRUCTURE, "frequency": FREQUENCY},
        "axes": [{"path": "system.constraints.0.gap", "start": 0.1, "stop": 0.3, "num": 3}],
    },
}  # fmt: skip


@pytest.mark.parametrize("kind", REQUESTS)
def test_plans_state_the_reason_and_are_followed(http: TestClient, kind: str) -> None:
    plan = http.post(f"/v1/plan/{kind}", json=REQUESTS[kind])
    assert plan.status_code == 200, plan.text
    assert "1 degree of freedom has no mass: it follows the others statically" in plan.text
    answer = http.post(f"/v1/compute/{kind}", json=REQUESTS[kind])
    # Where kernels are not compiled yet, it is a job.
    assert answer.status_code in {200, 202}, answer.text


def test_what_has_no_mass_is_between_its_neighbours(http: TestClient) -> None:
    body = http.post("/v1/compute/time-history", json=REQUESTS["time-history"]).json()
    for name in ("x", "v"):
        for left, middle, right in body[name]:
            assert middle == pytest.approx(0.5 * (left + right), abs=1e-15)


@pytest.mark.parametrize(
    ("kind", "path", "value", "pointer", "code"),
    [
        ("impact-modes", ("system", "M"), {"diagonal": [0, 0, 1]}, "/system/constraints/0",
         "massless_constraint"),
        ("impact-modes", ("system", "constraints", 0),
         {"direction": {"dofs": [0, 1], "weights": [1, -1]}, "gap": 1}, "/system/constraints/0",
         "massless_constraint"),
        ("impact-modes", ("system", "force"), [0, 1, 0], "/system/force", "massless_load"),
        ("impact-modes", ("system", "C"), {"diagonal": [0, 1, 0]}, "/system/C",
         "massless_damping"),
        ("impact-modes", ("system", "K"), {"diagonal": [1, 0, 1]}, "/system/K",
         "massless_not_held"),
        ("impact-modes", ("system", "M"), [[1, 0, 1], [0, 0, 0], [1, 0, 1]], "/system/M",
         "not_positive_definite"),
        ("time-history", ("initial", "x", 1), 0.1, "/initial/x", "massless_state"),
        ("time-history", ("initial", "v", 1), 0.1, "/initial/v", "massless_state"),
        ("time-history", ("load",), [{"dof": 1, "amplitude": 1, "frequency": 1}], "/load/0/dof",
         "massless_load"),
        ("ensemble", ("initial", "v", 1, 1), 0.1, "/initial/v", "massless_state"),
        ("periodic-motions", ("load", 0, "dof"), 1, "/load/0/dof", "massless_load"),
    ],
)  # fmt: skip
def test_refusals_name_the_field(
    http: TestClient, kind: str, path: tuple[Any, ...], value: Any, pointer: str, code: str
) -> None:
    body = copy.deepcopy(REQUESTS[kind])
    place: Any = body
    for part in path[:-1]:
        place = place[part]
    place[path[-1]] = value
    answer = http.post(f"/v1/compute/{kind}", json=body)
    assert answer.status_code == 422, answer.text
    first = answer.json()["errors"][0]
    assert (first["pointer"], first["code"]) == (pointer, code)


def test_slow_flows_are_refused(http: TestClient) -> None:
    body = {
        "system": {"M": {"diagonal": [1, 0]}, "K": [[2, -1], [-1, 2]],
                   "constraints": [{"dof": 0, "gap": 1}]},
        "model": "oscillator", "variant": "exact", "t": {"values": [0, 1]},
        "initial": {"gamma": 1.0},
    }  # fmt: skip
    answer = http.post("/v1/compute/slow-flow", json=body)
    assert answer.status_code == 422, answer.text
    assert answer.json()["errors"][0]["pointer"] == "/system/M"
