"""The contract: complete, consistent, with examples that work, and the committed one is it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jsonschema_rs
import numpy as np
import pytest
from starlette.testclient import TestClient

from vibroimpact_schema import examples
from vibroimpact_service import cli
from vibroimpact_service.access import records
from vibroimpact_service.access.caller import Scope
from vibroimpact_service.access.gate import open_records
from vibroimpact_service.api import contract
from vibroimpact_service.app import create_app
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.settings import Settings

ROOT = Path(__file__).parents[3]
DOCUMENT = contract.document(create_app(Settings(data=Path("unused"))))
OPERATIONS = [
    (method, path, operation)
    for path, methods in DOCUMENT["paths"].items()
    for method, operation in methods.items()
]


def test_the_committed_contract_is_the_one_that_is_spoken() -> None:
    assert (ROOT / "openapi" / "openapi.json").read_text() == cli.contract_text(), (
        "write it anew: python -m vibroimpact_service.cli openapi"
    )


def test_every_route_is_in_the_contract(http: TestClient) -> None:
    for kind in KINDS:
        assert f"/v1/compute/{kind}" in DOCUMENT["paths"]
        assert f"/v1/plan/{kind}" in DOCUMENT["paths"]
    listed = {path for _, path, _ in OPERATIONS}
    routers = http.app.state.routers  # type: ignore[attr-defined]
    routes = {route.path for router in routers for route in router.routes}
    assert {path for path in routes if path.startswith(("/v1", "/metrics"))} == listed
    assert len(listed) > 10


def test_operations_have_names_fit_for_code(  # a client generator makes functions of them
) -> None:
    names = [operation["operationId"] for _, _, operation in OPERATIONS]
    assert len(set(names)) == len(names)
    assert all(name.isidentifier() for name in names)


@pytest.mark.parametrize(("method", "path", "operation"), OPERATIONS)
def test_operations_say_what_goes_wrong(method: str, path: str, operation: dict[str, Any]) -> None:
    assert operation["summary"]
    assert operation["description"]
    failures = {s: a for s, a in operation["responses"].items() if s >= "400"}
    assert "500" in failures
    for answer in failures.values():
        reference = answer["content"]["application/problem+json"]["schema"]["$ref"]
        assert reference == "#/components/schemas/Problem"
    if method == "post":
        assert {"400", "413", "415", "422"} <= set(failures)
    assert "x-problems" not in operation


def references(node: Any) -> set[str]:
    if isinstance(node, dict):
        own = {node["$ref"]} if isinstance(node.get("$ref"), str) else set()
        return own.union(*(references(value) for value in node.values()))
    if isinstance(node, list):
        return set().union(*(references(value) for value in node))
    return set()


def test_references_lead_somewhere_and_nothing_is_left_over() -> None:
    prefix = "#/components/schemas/"
    wanted = {reference.removeprefix(prefix) for reference in references(DOCUMENT)}
    assert wanted == set(DOCUMENT["components"]["schemas"])


def test_numbers_are_described_with_shapes_and_units() -> None:
    result = DOCUMENT["components"]["schemas"]["ImpactModesResult"]["properties"]
    assert "[frequency, constraint]" in result["impulse"]["description"]
    assert "mass length / time²" in result["impulse"]["description"]


EXAMPLES = [
    (path, name, example["value"])
    for _, path, operation in OPERATIONS
    for name, example in operation.get("requestBody", {})
    .get("content", {})
    .get("application/json", {})
    .get("examples", {})
    .items()
]


@pytest.mark.parametrize(("path", "name", "value"), EXAMPLES)
def test_examples_work(
    settings: Settings, queue: Any, path: str, name: str, value: dict[str, Any]
) -> None:
    engine = open_records(settings)
    with engine.begin() as connection:
        key, _ = records.create(connection, "test", records.NewKey("ann", "", frozenset(Scope)))
    engine.dispose()
    with TestClient(create_app(settings, queue)) as http:
        answer = http.post(path, json=value, headers={"Authorization": f"Bearer {key}"})
    assert answer.is_success, (name, answer.text)


def test_every_request_has_an_example() -> None:
    shown = {path for path, _, _ in EXAMPLES}
    assert shown == {path for method, path, _ in OPERATIONS if method == "post"}


ANSWERS = [
    (operation["operationId"], status, media_type, content)
    for _, _, operation in OPERATIONS
    for status, answer in operation["responses"].items()
    for media_type, content in answer.get("content", {}).items()
]
BINARY = ("application/x-hdf5",)


@pytest.mark.parametrize(("operation", "status", "media_type", "content"), ANSWERS)
def test_every_answer_has_an_example_that_fits(
    operation: str, status: str, media_type: str, content: dict[str, Any]
) -> None:
    if media_type in BINARY or status == "206":
        assert "example" not in content
        return
    if operation.startswith(("compute_", "plan_")) and "example" not in content:
        assert operation not in ("compute_impact_modes", "plan_impact_modes")
        return
    if media_type in ("text/event-stream", "text/plain"):
        assert isinstance(content["example"], str)
        return
    schema = {**content["schema"], "components": DOCUMENT["components"]}
    jsonschema_rs.Draft202012Validator(schema).validate(content["example"])


def test_examples_of_answers_are_what_is_answered_now(
    http: TestClient, request_body: dict[str, Any]
) -> None:
    shown = examples.answers("compute_impact_modes")["200"]
    request_body["frequency"] = {"values": shown["frequency"]["Omega"]}
    now = http.post("/v1/compute/impact-modes", json=request_body).json()
    assert set(now) == set(shown)
    assert now["reason"] == shown["reason"]
    assert np.allclose(now["impulse"], shown["impulse"], rtol=1e-12)


def test_links_lead_to_operations_and_fill_their_parameters() -> None:
    operations = {operation["operationId"]: operation for _, _, operation in OPERATIONS}
    for operation in operations.values():
        for answer in operation["responses"].values():
            for link in answer.get("links", {}).values():
                target = operations[link["operationId"]]
                needed = {p["name"] for p in target["parameters"] if p["in"] == "path"}
                assert set(link["parameters"]) == needed


def test_operations_have_distinct_plain_names() -> None:
    names = [operation["operationId"] for _, _, operation in OPERATIONS]
    assert len(set(names)) == len(names)
    assert all(name.isidentifier() for name in names)


def test_values_have_names_that_generators_can_tell_apart() -> None:
    """Some name values of an enumeration in capitals; Omega and omega must not become one."""

    def enumerations(node: Any) -> list[dict[str, Any]]:
        parts = node.values() if isinstance(node, dict) else node if isinstance(node, list) else ()
        found = [one for part in parts for one in enumerations(part)]
        return [node, *found] if isinstance(node, dict) and "enum" in node else found

    everything = enumerations(DOCUMENT["components"]["schemas"])
    assert len(everything) > 10
    for found in everything:
        if isinstance(found["enum"], list):
            names = found.get("x-enum-varnames", [str(value).upper() for value in found["enum"]])
            assert len(set(names)) == len(found["enum"]), found
