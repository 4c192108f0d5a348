"""Faults of documents point into the body and never quote it."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from vibroimpact_schema.requests import ImpactModesRequest, PeriodicMotionsRequest
from vibroimpact_service import validation
from vibroimpact_service.problems import ProblemError

CHAIN = {"preset": "chain", "n": 3, "constraints": [{"dof": 0, "gap": 0.2}]}


def problem_of(content: Any, *prefix: str) -> ProblemError:
    with pytest.raises(ValidationError) as caught:
        ImpactModesRequest.model_validate(content)
    return validation.problem_of(caught.value, content, *prefix)


@pytest.mark.parametrize(
    ("content", "pointer", "code"),
    [
        ({"system": CHAIN}, "/frequency", "missing"),
        ({"system": {**CHAIN, "n": "3"}}, "/system/n", "wrong_type"),
        ({"system": {**CHAIN, "preset": "x"}}, "/system/preset", "unknown_choice"),
        (
            {"system": {**CHAIN, "constraints": [{"dof": 0}]}},
            "/system/constraints/0/gap",
            "missing",
        ),
        ({"system": {"M": {"bands": {"x": [1]}}}}, "/system/M/bands/x", "wrong_format"),
        ({"system": {"M": {"diagonal": [float("nan")]}}}, "/system/M/diagonal/0", "not_finite"),
        ({"system": {"M": [[1, "2"]]}}, "/system/M/0/1", "wrong_type"),
        ({"system": CHAIN, "frequency": {"values": []}}, "/frequency/values", "too_short"),
        ({"system": CHAIN, "a/b": 1, "frequency": {"values": [1]}}, "/a~1b", "unknown_field"),
        (5, "", "wrong_type"),
    ],
)
def test_pointers_lead_into_the_body(content: Any, pointer: str, code: str) -> None:
    first = problem_of(content).errors[0]
    assert (first.pointer, first.code) == (pointer, code)


def test_a_prefix_leads_to_documents_inside_of_the_body() -> None:
    assert problem_of({"system": CHAIN}, "request").errors[0].pointer == "/request/frequency"


@pytest.mark.parametrize("field", ["system", "load", "frequency", "sequence", "tau"])
def test_fields_that_were_not_sent_are_not_blamed_for_others(field: str) -> None:
    """The outputs of periodic motions, by default, depend on the other fields."""
    sent = {
        "system": CHAIN, "frequency": {"values": [1]}, "load": [{"dof": 0, "amplitude": 1}],
        field: 5,
    }  # fmt: skip
    with pytest.raises(ValidationError) as caught:
        PeriodicMotionsRequest.model_validate(sent)
    problem = validation.problem_of(caught.value, sent)
    assert [fault.pointer for fault in problem.errors] == [f"/{field}"]
    assert "more" not in problem.detail


def test_the_input_is_not_quoted() -> None:
    problem = problem_of({"system": {"preset": "s3cret", "n": "s3cret"}, "tau": ["s3cret"]})
    assert "s3cret" not in problem.document("r").model_dump_json()


def test_names_of_unknown_fields_are_shown_short_and_printable() -> None:
    content = {"system": CHAIN, "frequency": {"values": [1]}, "x" * 10_000: 1, "a\nb": 2}
    pointers = [fault.pointer for fault in problem_of(content).errors]
    assert pointers == ["/" + "x" * 64 + "…", "/a\N{REPLACEMENT CHARACTER}b"]


def test_of_many_faults_a_few_are_listed_and_all_are_counted() -> None:
    content = {"system": CHAIN, "frequency": {"values": [1]}, **{f"x{i}": 1 for i in range(500)}}
    problem = problem_of(content)
    assert len(problem.errors) == 20
    assert "499 more" in problem.detail
