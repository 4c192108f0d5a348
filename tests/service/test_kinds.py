"""Every row of the table leads to things that exist and fit together."""

from __future__ import annotations

import dataclasses
import inspect
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

import pytest

from vibroimpact_schema import examples
from vibroimpact_service import kinds
from vibroimpact_service.documents import branch_paths, decode, sweep_axes, unknowns
from vibroimpact_service.kinds import KINDS, Kind
from vibroimpact_service.problems import ProblemError
from vibroimpact_solvers.arrays import declared


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
class TestEveryKind:
    def test_the_solver_offers_what_is_needed(self, kind: Kind) -> None:
        solver = kind.solver
        assert list(inspect.signature(solver.plan).parameters)[:1] == ["problem"]
        assert list(inspect.signature(solver.solve).parameters)[:2] == ["problem", "plan"]
        assert list(inspect.signature(solver.split).parameters)[:2] == ["problem", "plan"]
        assert list(inspect.signature(solver.join).parameters)[:2] == ["problem", "plan"]
        assert dataclasses.is_dataclass(solver.Result)

    def test_the_decoder_exists(self, kind: Kind) -> None:
        if kind.name == "sweep":
            assert callable(sweep_axes.problem)
        elif kind.name == "branches":
            assert callable(branch_paths.problem)
        elif kind.name == "calibration":
            assert callable(unknowns.problem)
        else:
            assert callable(getattr(decode, kind.identifier))

    def test_there_are_examples(self, kind: Kind) -> None:
        assert examples.requests(kind.name)

    def test_the_document_of_the_result_names_every_field(self, kind: Kind) -> None:
        for field in declared(kind.solver.Result).values():
            model: Any = kind.result
            for part in field.path.split("/"):
                assert part in model.model_fields, f"{kind.name}: {field.path}"
                model = _inner(get_type_hints(model)[part])

    def test_names_agree(self, kind: Kind) -> None:
        assert KINDS[kind.name] is kind
        assert kind.result.model_fields["kind"].annotation.__args__ == (kind.name,)  # type: ignore[union-attr]


def test_unknown_kinds_are_refused() -> None:
    with pytest.raises(ProblemError) as caught:
        kinds.named("no-such-kind", "kind")
    assert caught.value.errors[0].pointer == "/kind"


def _inner(hint: Any) -> Any:
    """Return the model of an optional field, or of the rows of a table."""
    if isinstance(hint, UnionType):
        return _inner(next(part for part in get_args(hint) if part is not type(None)))
    rows = get_args(hint)
    if get_origin(hint) is list and hasattr(rows[0], "model_fields"):
        return rows[0]
    return hint
