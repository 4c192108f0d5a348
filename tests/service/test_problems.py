"""Exceptions become problems, of types that are documented."""

from __future__ import annotations

import errno
import pickle
import re
from pathlib import Path

import pytest

from vibroimpact_schema.problems import Fault
from vibroimpact_service import problems
from vibroimpact_service.problems import ProblemError, Type
from vibroimpact_solvers.errors import Cancelled, ConvergenceError, ModelError, PlanError


@pytest.mark.parametrize(
    ("error", "type_"),
    [
        (ModelError(("K",), "wrong", code="not_symmetric"), problems.INVALID),
        (PlanError("no method"), problems.NOT_POSSIBLE),
        (ConvergenceError("gave up"), problems.NO_CONVERGENCE),
        (MemoryError(), problems.TOO_LARGE),
        (OSError(errno.ENOSPC, "full"), problems.STORE_FULL),
        (OSError(errno.EMFILE, "too many"), problems.UNAVAILABLE),
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


def test_an_obstacle_names_the_field_to_change_where_there_is_one() -> None:
    error = PlanError("too many impacts: ask for less time", ("t",))
    assert pickle.loads(pickle.dumps(error)).pointer == ("t",)
    found = problems.of(error.under("base"))
    assert found.type is problems.NOT_POSSIBLE
    assert [(fault.pointer, fault.code) for fault in found.errors] == [("/base/t", "not_possible")]
    assert found.detail == "too many impacts: ask for less time"
    assert problems.of(PlanError("no method").under("base")).errors == ()


def test_faults_of_a_request_within_a_document_point_into_the_document() -> None:
    inner = problems.invalid("/system/K", "not_symmetric", "is not symmetric").under("request")
    assert inner.errors[0].pointer == "/request/system/K"
    assert inner.detail == "/request/system/K: is not symmetric"
    header = Fault(pointer="", parameter="Prefer", code="wrong_format", message="is wrong")
    outside = ProblemError(problems.BAD_REQUEST, "is wrong", [header]).under("request")
    assert outside.errors == (header,)
    assert outside.detail == "is wrong"


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


def test_problems_survive_the_way_between_processes() -> None:
    problem = problems.invalid("/system/K", "not_symmetric", "it is not")
    again = pickle.loads(pickle.dumps(problem))
    assert again.document("r") == problem.document("r")


def test_the_page_has_every_type() -> None:
    page = Path(__file__).parents[2] / "docs" / "problems.md"
    rows = re.findall(r"^\| `(\w+)` \| (\d+) \| (.+) \| (.+) \|$", page.read_text(), re.M)
    types = problems.TYPES.values()
    assert sorted(rows) == sorted((t.code, str(t.status), t.title, t.about) for t in types)
