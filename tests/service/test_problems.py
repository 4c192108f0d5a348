"""Exceptions become problems; faults point into the body and never quote it."""

from __future__ import annotations

import errno
import pickle
from typing import Any

import pytest
from pydantic import ValidationError

from vibroimpact_schema.requests import ImpactModesRequest
from vibroimpact_service import problems
from vibroimpact_service.problems import ProblemError, Type
from vibroimpact_solvers.errors import Cancelled, ConvergenceError, ModelError, PlanError

CHAIN = {"preset": "chain", "n": 3, "constraints": [{"dof": 0, "gap": 0.2}]}


@pytest.mark.parametrize(
    ("error", "type_"),
    [
        (ModelError(("K",), "wrong", code="not_symmetric"), problems.INVALID),
        (PlanError("no method"), problems.NOT_POSSIBLE),
        (ConvergenceError("gave up"), problems.NO_CONVERGENCE),
        (MemoryError(), problems.TOO_LARGE),
        (OSError(errno.ENOSPC, "full"), problems.STORE_FULL),
        (OSError(errno.EIO, "broken"), problems.INTERNAL),
        (Cancelled(), problems.INTERNAL),
        (ZeroDivisionError("secret"), problems.INTERNAL),
        (ProblemError(problems.NOT_FOUND, "gone"), problems.NOT_FOUND),
    ],
)
def test_the_table_of_exceptions(error: Exception, type_: Type) -> None:
    problem = problems.of(error)
    assert problem.type is type_
    assert "secret" not in problem.document("r").model_dump_json()


def test_a_fault_of_the_model_keeps_its_place_and_code() -> None:
    error = ModelError(("constraints", 0, "gap"), "no room", code="gap_not_positive")
    document = problems.of(error.under("system")).document("r1")
    assert document.status == 422
    assert document.request_id == "r1"
    assert document.errors[0].pointer == "/system/constraints/0/gap"
    assert document.errors[0].code == "gap_not_positive"


def test_types_have_unique_codes_and_client_errors_are_only_retryable_where_time_helps() -> None:
    assert all(code == type_.code for code, type_ in problems.TYPES.items())
    defined = [value for value in vars(problems).values() if isinstance(value, Type)]
    assert {type_.code for type_ in defined} == set(problems.TYPES)
    assert len({id(type_) for type_ in defined}) == len(problems.TYPES)
    retryable = {code for code, type_ in problems.TYPES.items() if type_.retryable}
    assert retryable == {
        *("not_ready", "quota_spent", "store_full", "timeout", "too_many_jobs"),
        *("too_many_requests", "unavailable"),
    }


@pytest.mark.parametrize("status", [400, 404, 405, 406, 413, 415, 418, 422, 431, 500, 503, 599])
def test_every_status_has_a_type(status: int) -> None:
    type_ = problems.of_status(status)
    assert (type_.status >= 500) == (status >= 500)


def test_pointers_are_escaped() -> None:
    assert problems.pointer(["a/b", 0, "c~d", ""]) == "/a~1b/0/c~0d/"
    assert problems.pointer([]) == ""


def of_validation(content: Any, *prefix: str) -> ProblemError:
    with pytest.raises(ValidationError) as caught:
        ImpactModesRequest.model_validate(content)
    return problems.of_validation(caught.value, content, *prefix)


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
    first = of_validation(content).errors[0]
    assert (first.pointer, first.code) == (pointer, code)


def test_a_prefix_leads_to_documents_inside_of_the_body() -> None:
    assert of_validation({"system": CHAIN}, "request").errors[0].pointer == "/request/frequency"


def test_the_input_is_not_quoted() -> None:
    problem = of_validation({"system": {"preset": "s3cret", "n": "s3cret"}, "tau": ["s3cret"]})
    assert "s3cret" not in problem.document("r").model_dump_json()


def test_names_of_unknown_fields_are_shown_short_and_printable() -> None:
    content = {"system": CHAIN, "frequency": {"values": [1]}, "x" * 10_000: 1, "a\nb": 2}
    pointers = [fault.pointer for fault in of_validation(content).errors]
    assert pointers == ["/" + "x" * 64 + "…", "/a\N{REPLACEMENT CHARACTER}b"]


def test_of_many_faults_a_few_are_listed_and_all_are_counted() -> None:
    content = {"system": CHAIN, "frequency": {"values": [1]}, **{f"x{i}": 1 for i in range(500)}}
    problem = of_validation(content)
    assert len(problem.errors) == 20
    assert "499 more" in problem.detail


def test_problems_survive_the_way_between_processes() -> None:
    problem = problems.invalid("/system/K", "not_symmetric", "it is not")
    again = pickle.loads(pickle.dumps(problem))
    assert again.document("r") == problem.document("r")
