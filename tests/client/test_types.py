"""What type checkers see: documents and results by kind, as the contract and the solvers say.

``nox -s types`` reads `typed_script` with mypy and pyright, both strict; here it runs.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import Any

import pytest

import vibroimpact as vi
from tests.client import typed_script
from vibroimpact.tables import Table
from vibroimpact_service.kinds import KINDS
from vibroimpact_solvers.arrays import declared


def _signatures() -> Iterator[tuple[str, inspect.Signature]]:
    for name in vi.__all__:
        thing = getattr(vi, name)
        if inspect.isfunction(thing) or inspect.ismethod(thing):
            yield name, inspect.signature(thing)
        elif inspect.isclass(thing):
            for key, value in inspect.getmembers(thing):
                method = value.fget if isinstance(value, property) else value
                if inspect.isfunction(method) and (not key.startswith("_") or key == "__init__"):
                    yield f"{name}.{key}", inspect.signature(method)


def test_no_public_signature_has_a_dictionary_of_anything() -> None:
    signatures = dict(_signatures())
    assert len(signatures) > 100
    vague = {
        name: str(signature)
        for name, signature in signatures.items()
        if re.search(r"dict\[str, (typing\.)?Any\]|\bDocument\b", str(signature))
    }
    assert vague == {}


@pytest.mark.needs("compiled kernels")
def test_the_typed_script_runs_and_its_results_are_of_their_classes() -> None:
    results = typed_script.by_kind(vi.Local())
    assert [type(result) for result in results] == [
        vi.ImpactModes,
        vi.ExistenceBands,
        vi.TimeHistory,
        vi.Sweep,
        vi.Resonances,
    ]
    for result in results[:-2]:
        assert _undeclared(result) == {}


def test_p_is_called_impulse_parameter_and_its_unit_is_that_of_a_force() -> None:
    """The momentum exchanged, which users expect under the name impulse, is a column beside it."""
    for name in ("impact-modes", "slow-flow"):
        fields = declared(KINDS[name].solver.Result)
        p, momentum = fields["impulse"].quantity, fields["momentum"].quantity
        assert p.long_name.startswith("impulse parameter p")
        assert (p.unit, momentum.unit) == ("mass length time-2", "mass length time-1")


def _undeclared(result: vi.Result) -> dict[str, Any]:
    """Return what a file has and its class does not declare."""
    known = set(inspect.get_annotations(type(result)))
    names = {*result._arrays, *result._tables} - known
    columns = {name: set(table) - _declared(table) for name, table in result._tables.items()}
    return {name: more for name, more in {"": names, **columns}.items() if more}


def _declared(table: Table) -> set[str]:
    return {key for one in type(table).mro() for key in inspect.get_annotations(one)}
