"""The contract: complete, consistent, with examples that work, and the committed one is it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema_rs
import numpy as np
import pytest
from starlette.testclient import TestClient

from vibroimpact_schema import examples
from vibroimpact_schema.keys import KeyRequest
from vibroimpact_service import cli
from vibroimpact_service.access import records
from vibroimpact_service.access.caller import Scope
from vibroimpact_service.api import openapi
from vibroimpact_service.app import create_app
from vibroimpact_service.kinds import KINDS, Kind
from vibroimpact_service.settings import Settings

ROOT = Path(__file__).parents[3]
DOCUMENT = openapi.document(create_app(Settings(data=Path("unused"))))
OPERATIONS = [
    (method, path, operation)
    for path, methods in DOCUMENT["paths"].items()
    for method, operation in methods.items()
]


def test_the_committed_contract_is_the_one_that_is_spoken() -> None:
    assert (ROOT / "openapi" / "openapi.json").read_text() == cli.contract_text(), (
        "write it anew: python -m vibroimpact_service.cli openapi"
    )


def lost(old: Any, new: Any, where: str = "") -> list[str]:
    """Return the places where a document says less than, or other than, an older one."""
    if isinstance(old, dict) and isinstance(new, dict):
        if "Request/" in where and "$ref" in old and "oneOf" in new:
            # A part of a request that may have other forms now, too.
            return [] if any(not lost(old, form) for form in new["oneOf"]) else [where]
        return [
            place
            for name, value in old.items()
            for place in (
                lost(value, new[name], f"{where}/{name}") if name in new else [f"{where}/{name}"]
            )
        ]
    if isinstance(old, list) and isinstance(new, list):
        if where.endswith("/parameters"):
            by_name = [{f"{p['in']} {p['name']}": p for p in each} for each in (old, new)]
            return lost(*by_name, where)
        if where.endswith(("/enum", "/required", "/x-enum-varnames")):
            return [f"{where}/{value}" for value in old if value not in new]
        if where.endswith(("/anyOf", "/oneOf")):
            apart = [all(lost(form, n, where) for n in new) for form in old]
            return [f"{where}/{i}" for i, is_lost in enumerate(apart) if is_lost]
        if len(old) == len(new):
            pairs = enumerate(zip(old, new, strict=True))
            return [place for i, pair in pairs for place in lost(*pair, f"{where}/{i}")]
    return [] if old == new else [where]


_STRUCTURES = ["MatrixSystem", "Chain", "Oscillator", "TwoMass", "DoublePendulum", "BouncingBall"]
CHANGED = {
    # It was relative to the largest impulse of its frequency; every error is absolute now.
    "/components/schemas/ImpulseError/properties/impulse/items/anyOf",
    # Steps may be negative.
    "/components/schemas/AxisSteps/properties/step/exclusiveMinimum",
    # It takes what it took, and composed units such as lbf s2/in.
    "/components/schemas/Units/properties/mass/pattern",
    # Requests may leave them out: there are none. Stored structures are returned with them.
    *(f"/components/schemas/{name}/required/constraints" for name in _STRUCTURES),
    # The same of the state from which a motion starts: it is rest.
    "/components/schemas/TimeHistoryRequest/required/initial",
    "/components/schemas/TimeHistoryRequest/properties/initial/oneOf",
}
"""Places whose meaning has changed on purpose, which the changelog tells."""


def test_nothing_of_version_0_1_0_is_lost() -> None:
    """Its paths, methods, parameters, fields, values, media types, statuses and headers are there.

    The file is that version's document without descriptions, summaries and examples.
    """
    old = json.loads(Path(__file__).with_name("openapi-0.1.0.json").read_text())
    del old["info"]["version"]
    told = {place for place in lost(old, DOCUMENT) if default_in_words(old, place)}
    assert told
    assert set(lost(old, DOCUMENT)) - told == CHANGED


def default_in_words(old: dict[str, Any], place: str) -> bool:
    """Whether what is lost is a default that the description of the field tells now."""
    *path, last = place.strip("/").split("/")
    if last != "default":
        return False
    before, now = old, DOCUMENT
    for name in path:
        before, now = before[name], now[name]
    given = before["default"]
    return given is None or f"Default: {json.dumps(given)}." in now["description"]


def test_a_loss_would_be_noticed() -> None:
    old = {
        "parameters": [{"in": "query", "name": "a", "schema": {"enum": [1, 2]}}],
        "responses": {"200": {"headers": {"ETag": {}}, "content": {"text/plain": {}}}},
    }
    more = {
        "parameters": [
            {"in": "path", "name": "b"},
            {"in": "query", "name": "a", "schema": {"enum": [1, 2, 3]}},
        ],
        "responses": {**old["responses"], "404": {}},  # type: ignore[dict-item]
    }
    assert lost(old, more) == []
    one, forms = {"$ref": "a"}, {"oneOf": [{"$ref": "b"}, {"$ref": "a"}]}
    assert lost(one, forms, "/ARequest/load") == []
    assert lost({"$ref": "c"}, forms, "/ARequest/load") == ["/ARequest/load"]
    assert lost(one, forms, "/AResult/x") == ["/AResult/x/$ref"]
    assert lost(more, old) == [
        "/parameters/path b",
        "/parameters/query a/schema/enum/3",
        "/responses/404",
    ]
    other = {**old, "responses": {"200": {"headers": {}, "content": {"text/html": {}}}}}
    assert lost(old, other) == [
        "/responses/200/headers/ETag",
        "/responses/200/content/text/plain",
    ]


def test_every_route_is_in_the_contract(http: TestClient) -> None:
    for kind in KINDS:
        assert f"/v1/compute/{kind}" in DOCUMENT["paths"]
        assert f"/v1/plan/{kind}" in DOCUMENT["paths"]
    listed = {path for _, path, _ in OPERATIONS}
    routes = {route.path for route in http.app.routes}  # type: ignore[attr-defined]
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
    if method == "post" and "requestBody" in operation:
        assert {"400", "413", "415", "422"} <= set(failures)


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
    (method, path, name, example["value"])
    for method, path, operation in OPERATIONS
    for name, example in operation.get("requestBody", {})
    .get("content", {})
    .get("application/json", {})
    .get("examples", {})
    .items()
]


@pytest.mark.parametrize(("method", "path", "name", "value"), EXAMPLES)
def test_examples_work(
    settings: Settings, queue: Any, method: str, path: str, name: str, value: dict[str, Any]
) -> None:
    engine = records.open_keys(settings.database_url)
    with engine.begin() as connection:
        key, _ = records.create(connection, "test", KeyRequest(owner="ann", scopes=[*Scope]))
    engine.dispose()
    with TestClient(create_app(settings, queue)) as http:
        headers = {"Authorization": f"Bearer {key}"}
        if "{job}" in path:
            request = examples.requests("impact-modes")["chain"]["request"]
            body = {"kind": "impact-modes", "request": request}
            path = path.format(job=http.post("/v1/jobs", json=body, headers=headers).json()["id"])
        answer = http.request(method, path, json=value, headers=headers)
    assert answer.is_success, (name, answer.text)


def test_every_request_has_an_example() -> None:
    shown = {(method, path) for method, path, _, _ in EXAMPLES}
    assert shown == {(method, path) for method, path, it in OPERATIONS if "requestBody" in it}
    without_body = {f"/v1/jobs/{{job}}/{action}" for action in ("hold", "release", "retry")}
    assert {path for method, path in shown if method == "post"} | without_body == {
        path for method, path, _ in OPERATIONS if method == "post"
    }


ANSWERS = [
    (operation["operationId"], status, media_type, content)
    for _, _, operation in OPERATIONS
    for status, answer in operation["responses"].items()
    for media_type, content in answer.get("content", {}).items()
]
BINARY = ("application/x-hdf5", "text/csv", "application/x-vibroimpact")


@pytest.mark.parametrize(("operation", "status", "media_type", "content"), ANSWERS)
def test_every_answer_has_an_example_that_fits(
    operation: str, status: str, media_type: str, content: dict[str, Any]
) -> None:
    if media_type in BINARY or status == "206":
        assert "example" not in content
        return
    if media_type in ("text/event-stream", "text/plain"):
        assert isinstance(content["example"], str)
        return
    schema = {**content["schema"], "components": DOCUMENT["components"]}
    jsonschema_rs.Draft202012Validator(schema).validate(content["example"])


def close(now: Any, shown: Any) -> bool:
    """Whether two documents are alike, numbers up to what another processor may round."""
    if isinstance(shown, dict) and isinstance(now, dict):
        return set(now) == set(shown) and all(close(now[name], shown[name]) for name in shown)
    if isinstance(shown, list) and isinstance(now, list):
        return len(now) == len(shown) and all(map(close, now, shown))
    if isinstance(shown, float) and isinstance(now, float):
        return bool(np.isclose(now, shown, rtol=1e-9, atol=1e-12))
    return bool(now == shown)


def told(document: dict[str, Any]) -> dict[str, Any]:
    """Return a result without when, by which version and at what price it was computed."""
    apart = ("digest", "plan", "provenance", "error")
    rest = {name: value for name, value in document.items() if name not in apart}
    if document["kind"] == "branches":
        points = rest["points"]
        rest["points"] = [{name: p[name] for name in p if name != "along"} for p in points]
    return rest


def at_the_same_places(now: dict[str, Any], shown: dict[str, Any]) -> bool:
    """Whether special points lie where they are shown along their branches, within both errors.

    What is found by bisection agrees to no more digits than it has.
    """
    found = [
        [(point["along"], error) for point, error in zip(each["points"], errors, strict=True)]
        for each in (now, shown)
        for errors in [each["error"]["points"]["along"]]
    ]
    pairs = zip(*found, strict=True)
    return all(abs(a - b) <= error + other for (a, error), (b, other) in pairs)


@pytest.mark.parametrize("kind", KINDS.values(), ids=list(KINDS))
def test_examples_of_answers_are_what_is_answered_now(
    settings: Settings, queue: Any, request_body: dict[str, Any], kind: Kind
) -> None:
    shown = examples.answers(f"compute_{kind.identifier}")["200"]
    requests = [example["request"] for example in examples.requests(kind.name).values()]
    if kind.name == "impact-modes":
        frequency = {"values": shown["frequency"]["Omega"]}
        requests = [{**request_body, "frequency": frequency}]
    patient = settings.model_copy(update={"inline_seconds": 1000.0})
    with TestClient(create_app(patient, queue)) as http:
        now = [http.post(f"/v1/compute/{kind.name}", json=each).json() for each in requests]
    assert all(set(each) >= {"kind", "digest", "plan", "provenance"} for each in now)
    alike = [each for each in now if close(told(each), told(shown))]
    assert alike
    if kind.name == "branches":
        assert any(at_the_same_places(each, shown) for each in alike)


def test_the_example_of_a_batch_is_what_is_answered_now(http: TestClient) -> None:
    ((_, path, _, asked),) = [each for each in EXAMPLES if each[1] == "/v1/batch"]
    shown = examples.answers("compute_batch")["200"]["answers"]
    now = http.post(path, json=asked).json()["answers"]
    assert close([told(each["result"]) for each in now], [told(each["result"]) for each in shown])


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


def test_generators_of_clients_find_names_and_optional_fields() -> None:
    """A name twice became two with the paths of modules; a default made a field of a request one
    that generated clients asked for."""
    schemas = DOCUMENT["components"]["schemas"]
    assert len(schemas) > 100
    assert [name for name in schemas if "__" in name] == []
    for name in ("Constraint", *(kind.request.__name__ for kind in KINDS.values())):
        fields = schemas[name].get("properties", {}).values()
        assert [field for field in fields if "default" in field] == []
    assert "Default: 1.0." in schemas["Constraint"]["properties"]["restitution"]["description"]
