"""Fields of results are declared once, and completely."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from vibroimpact_solvers import time_history as solver
from vibroimpact_solvers.arrays import declared
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.results import (
    branches,
    ensemble,
    existence_bands,
    impact_modes,
    periodic_motions,
    resonances,
    slow_flow,
    time_history,
)

MODULES = (
    branches,
    ensemble,
    existence_bands,
    impact_modes,
    periodic_motions,
    resonances,
    slow_flow,
    time_history,
)
UNITS = {"1", "s", "mass", "length", "time"}


@pytest.mark.parametrize(
    "result", [module.Result for module in MODULES], ids=lambda r: r.__module__
)
class TestEveryResult:
    def test_every_field_is_declared(self, result: type[Any]) -> None:
        assert list(declared(result)) == [field.name for field in dataclasses.fields(result)]

    def test_every_group_is_declared_and_used(self, result: type[Any]) -> None:
        paths = [f.path.split("/") for f in declared(result).values()]
        groups = {"/".join(path[:depth]) for path in paths for depth in range(1, len(path))}
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
            texts = field.scalar == list[str] and len(field.quantity.dims) == 1
            assert field.array or texts or not field.quantity.dims, field.name


def test_an_ensemble_has_the_fields_of_a_motion_with_the_member_in_front() -> None:
    one, many = declared(time_history.Result), declared(ensemble.Result)
    single = {name for name in one if name.startswith(("derivative", "parameter"))}
    assert set(one) - {"error_digits"} - single <= set(many)
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


def scaled(values: Any, unit: str, scales: dict[str, float]) -> Any:
    """Return values of a unit in other units of mass, length and time."""
    for factor in unit.split():
        base = factor.rstrip("-0123456789")
        if base in scales:
            values = values * scales[base] ** int(factor[len(base) :] or 1)
    return values


def motion(scales: dict[str, float]) -> time_history.Result:
    """Return a motion with impacts and contacts, of a structure in some units."""
    mass, length, time = scales.values()
    stiffness, damping = mass / time**2, mass / time
    system = System(
        SymmetricMatrix.diagonal([mass, 2.0 * mass]),
        SymmetricMatrix.dense(np.array([[2.0, -1.0], [-1.0, 2.0]]) * stiffness),
        (Constraint.at(0, 0.1 * length, restitution=0.0), Constraint.at(1, 0.3 * length)),
        SymmetricMatrix.diagonal(np.array([0.01, 0.02]) * damping),
        force=np.array([0.3, 0.0]) * length * stiffness,
    )
    state = solver.State(np.array([0.0, 0.1]) * length, np.array([1.0, 0.5]) * length / time)
    t = np.linspace(0.0, 20.0, 9) * time
    problem = solver.Problem(system, state, 20.0 * time, t, outputs=frozenset(solver.OUTPUTS))
    return solver.solve(problem, solver.plan(problem))


def test_numbers_of_a_motion_change_with_the_units_as_declared() -> None:
    scales = {"mass": 2.0, "length": 4.0, "time": 8.0}
    one, other = motion(dict.fromkeys(scales, 1.0)), motion(scales)
    assert one.contact_impulse is not None
    assert one.contact_impulse.size
    for name, field in declared(time_history.Result).items():
        given, found = getattr(one, name), getattr(other, name)
        if given is None or isinstance(given, str) or "error" in name:
            continue
        expected = scaled(given, field.quantity.unit, scales)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12, err_msg=name)
