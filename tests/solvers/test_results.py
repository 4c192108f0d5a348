"""Fields of results are declared once, and completely."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from typing import Any

import pytest

from vibroimpact_solvers.arrays import declared
from vibroimpact_solvers.results import (
    ensemble,
    existence_bands,
    impact_modes,
    resonances,
    slow_flow,
    time_history,
)

MODULES = (ensemble, existence_bands, impact_modes, resonances, slow_flow, time_history)
UNITS = {"1", "s", "mass", "length", "time"}


@pytest.mark.parametrize(
    "result", [module.Result for module in MODULES], ids=lambda r: r.__module__
)
class TestEveryResult:
    def test_every_field_is_declared(self, result: type[Any]) -> None:
        assert list(declared(result)) == [field.name for field in dataclasses.fields(result)]

    def test_every_group_is_declared_and_used(self, result: type[Any]) -> None:
        groups = {f.path.partition("/")[0] for f in declared(result).values() if "/" in f.path}
        assert groups == set(result.GROUPS)

    def test_paths_are_different(self, result: type[Any]) -> None:
        paths = [field.path for field in declared(result).values()]
        assert len(set(paths)) == len(paths)

    def test_errors_are_fields(self, result: type[Any]) -> None:
        fields = {field.path for field in declared(result).values()}
        for field in declared(result).values():
            assert not field.quantity.error or field.quantity.error in fields, field.name

    def test_units_are_powers_of_length_mass_and_time(self, result: type[Any]) -> None:
        for field in declared(result).values():
            for factor in field.quantity.unit.split():
                assert (factor.rstrip("-0123456789") or "1") in UNITS, field.name

    def test_axes_are_those_of_the_type(self, result: type[Any]) -> None:
        for field in declared(result).values():
            assert field.array or not field.quantity.dims, field.name


def test_an_ensemble_has_the_fields_of_a_motion_with_the_member_in_front() -> None:
    one, many = declared(time_history.Result), declared(ensemble.Result)
    assert set(one) - {"error_digits"} <= set(many)
    assert many["x"].quantity.dims == ("member", *one["x"].quantity.dims)
    assert many["x"].quantity.missing
    assert many["count_impacts"].quantity.dims == ("member",)
    assert many["count_impacts"].path == "count/impacts"
    for shared in ("t", "impact_time", "contact_side", "error_tolerance"):
        assert many[shared].quantity == one[shared].quantity


def test_declarations_load_without_the_kernels() -> None:
    names = ", ".join(module.__name__ for module in MODULES)
    program = f"import sys, {names}; print('numba' in sys.modules, 'scipy' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["False", "False"]
