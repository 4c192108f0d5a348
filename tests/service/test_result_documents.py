"""Documents of results follow from the declarations."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from vibroimpact_service.kinds import KINDS
from vibroimpact_service.result_documents import description, formula
from vibroimpact_solvers.arrays import Quantity, declared

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("unit", "expected"),
    [
        ("1", ""),
        ("length", "length"),
        ("time-1", "1/time"),
        ("mass length2 time-2", "mass length² / time²"),
        ("length time-1", "length / time"),
    ],
)
def test_units_are_written_as_fractions(unit: str, expected: str) -> None:
    assert formula(unit) == expected


def test_a_description_says_everything_that_is_declared() -> None:
    quantity = Quantity(
        ("time", "dof"), "length time-1", "velocity", note="from the left", missing="unknown"
    )
    expected = "Velocity [time, dof], length / time; from the left; null: unknown."
    assert description(quantity) == expected


def test_groups_that_kinds_share_are_one_document() -> None:
    one, many = KINDS["time-history"].result, KINDS["ensemble"].result
    assert one.model_fields["impacts"].annotation == many.model_fields["impacts"].annotation
    assert one.model_fields["error"].annotation != many.model_fields["error"].annotation


@pytest.mark.needs("processes")
def test_the_documentation_has_a_table_of_every_kind() -> None:
    path = ROOT / "docs" / "result_tables.py"
    spec = importlib.util.spec_from_file_location("result_tables", path)
    assert spec is not None
    assert spec.loader is not None
    hook = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hook)
    page = hook.on_page_markdown((ROOT / "docs" / "service" / "files.md").read_text())
    for kind in set(KINDS) - {"sweep"}:  # whose fields are those of the swept kind
        for field in declared(KINDS[kind].solver.Result).values():
            assert f"| `{field.path}` |" in page, kind
    assert "| `energy` | `t` | mass length² / time² |" in page


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("outputs", [["exists"], ["extremes"], ["energy"], ["stability"]])
def test_errors_of_columns_come_with_their_outputs(http: TestClient, outputs: list[str]) -> None:
    request = {
        "system": {
            "preset": "oscillator",
            "Omega0": 1.0,
            "zeta": 0.1,
            "constraints": [{"dof": 0, "gap": {"upper": 1.0}, "restitution": 0.8}],
        },
        "load": [{"dof": 0, "amplitude": 1.0}],
        "frequency": {"values": [1.1]},
        "outputs": outputs,
    }
    answer = http.post("/v1/compute/periodic-motions", json=request)
    assert answer.status_code == 200, answer.text
    KINDS["periodic-motions"].result.model_validate_json(answer.content)
