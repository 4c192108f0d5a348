"""Large sparse structures by few natural modes, against all modes and direct solves."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse

from benchmarks import beams as finite_elements
from tests.solvers import beams
from vibroimpact_solvers import impact_modes, receptance, spectrum
from vibroimpact_solvers.impact_modes import Problem
from vibroimpact_solvers.impact_modes.direct import DirectFamily
from vibroimpact_solvers.impact_modes.family import Family
from vibroimpact_solvers.impact_modes.modal import ModalFamily
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.plan import Stage
from vibroimpact_solvers.receptance import Coordinates, ExpansionSize, PartialModalResponse

GAP = 0.2


def membrane(
    side: int, constraints: Any = None, *, uneven: bool = True, full_mass: bool = False
) -> System:
    """Return a square net of masses; even ones have most eigenvalues twice."""
    n = side * side
    one = scipy.sparse.identity(side)
    line = scipy.sparse.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(side, side))
    K = (scipy.sparse.kron(line, one) + scipy.sparse.kron(one, line)).tocoo()
    masses = np.random.default_rng(0).uniform(0.5, 1.5, n) if uneven else np.ones(n)
    M = SymmetricMatrix.diagonal(masses)
    if full_mass:
        # Linear elements: a sixth of the mass at each neighbour along a line.
        heavy = scipy.sparse.kron(one, line / -6.0 + scipy.sparse.identity(side))
        heavy = (heavy + heavy.T).tocoo()
        M = SymmetricMatrix.sparse((n, n), heavy.row, heavy.col, heavy.data)
    stiffness = SymmetricMatrix.sparse((n, n), K.row, K.col, K.data)
    return System(M, stiffness, constraints or (Constraint.at(n // 3 + 2, GAP),))


def problem(system: System, Omega: Any, outputs: Any = ("impulse",), **more: Any) -> Problem:
    Omega = np.atleast_1d(np.asarray(Omega, dtype=float))
    return Problem(
        system, Omega * (2 / np.pi), Omega=Omega, outputs=frozenset(outputs) | {"reason"}, **more
    )


def partial(case: Problem) -> DirectFamily:
    bound = spectrum.largest_frequency(case.system)
    directions = np.ascontiguousarray(case.system.directions(case.active).T)
    expansion = ExpansionSize.of(case.tolerance)
    response = PartialModalResponse(case.system, directions, bound, case.output_dofs, expansion)
    return DirectFamily(case, bound, frequency_response=response)


COUPLED = (Constraint.at(30, GAP), Constraint((81, 82), (1.0, -1.0), 1.5 * GAP, 1.5 * GAP))


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize(
    "system",
    [
        membrane(12),
        membrane(12, uneven=False),
        membrane(12, COUPLED),
        membrane(12, full_mass=True),
        membrane(12, COUPLED, full_mass=True),
    ],
    ids=["uneven", "repeated", "coupled", "full mass", "coupled, full mass"],
)
@pytest.mark.parametrize("tolerance", [None, 1e-6, 1e-3])
def test_solutions_are_those_of_all_modes(system: System, tolerance: float | None) -> None:
    bound = spectrum.largest_frequency(system)
    Omega = bound * np.array([0.0512, 0.25, 0.3117, 0.52])
    case = problem(system, Omega, tolerance=tolerance)
    family = partial(case)
    computed, motion = family.solutions(case.frequencies)
    natural = spectrum.spectrum(system)
    exact = ModalFamily(case, Family.of(case), natural)
    expected, modal_motion = exact.solutions(case.frequencies)
    size = np.abs(expected.plus).max(axis=1)
    off = np.abs(computed.plus - expected.plus).max(axis=1) / size
    assert (computed.error < (1e-6 if tolerance is None else 10 * tolerance)).all()
    assert (off <= computed.error + expected.error).all()
    close = 1e-9 if tolerance is None else 10 * tolerance
    np.testing.assert_allclose(
        family.energy(motion),
        exact.energy(modal_motion),
        rtol=100 * close + 1e4 * computed.error.max(),
    )
    dofs, tau = np.arange(0, system.n, 7), np.array([-0.3, 0.8, 1.0])
    x = family.displacements(motion, tau, dofs)
    y = exact.displacements(modal_motion, tau, dofs)
    scale = np.abs(y).max(axis=(1, 2), keepdims=True)
    assert (np.abs(x - y) / scale).max() < 1e3 * max(computed.error.max(), close)
    orders = np.array([1, 3, 5])
    b = family.harmonics(motion, orders, dofs)
    c = exact.harmonics(modal_motion, orders, dofs)
    assert (np.abs(b - c) / np.abs(c).max(axis=(1, 2), keepdims=True)).max() < 1e3 * max(
        computed.error.max(), close
    )


def test_the_bound_of_the_omitted_modes_holds() -> None:
    """The error stated for short series holds, and is not far from the real one."""
    system = membrane(12)
    bound = spectrum.largest_frequency(system)
    eigenvalues, modes = scipy.linalg.eigh(system.K.to_dense(), system.M.to_dense())
    seen = modes[system.constraints[0].dofs[0]]
    directions = np.ascontiguousarray(system.directions((0,)).T)
    shares = []
    for terms in (1, 4, 16):
        response = PartialModalResponse(
            system, directions, bound, np.empty(0, dtype=int), ExpansionSize(4, terms)
        )
        for frequency in bound * np.linspace(0.1, 0.9, 11):
            z = frequency**2
            computed = response.receptance(frequency)
            error = abs(computed.value[0, 0] - (seen**2 / (z - eigenvalues)).sum())
            assert error <= computed.error[0, 0]
            shares.append(error / computed.error[0, 0])
            slope = (seen**2 / (z - eigenvalues) ** 2).sum()
            if terms == 16:
                np.testing.assert_allclose(computed.slope[0, 0], slope, rtol=1e-6)
    assert max(shares) > 0.01


def test_modes_are_counted_by_inertia() -> None:
    system = membrane(14, full_mass=True)
    eigenvalues = scipy.linalg.eigvalsh(system.K.to_dense(), system.M.to_dense())
    counter = spectrum.EigenvalueCounter.of(system)
    for value in np.concatenate([[-1.0, 20.0], np.linspace(0.01, 12.0, 40)]):
        computed = counter.count(float(value))
        assert computed.below == np.count_nonzero(eigenvalues < computed.at)
        # Far below the distances between neighbours.
        assert computed.error < 1e-6 * eigenvalues[-1] / system.n


@pytest.mark.parametrize("uneven", [True, False])
def test_slices_hold_all_modes(uneven: bool) -> None:
    """Repeated eigenvalues with all their modes."""
    system = membrane(20, uneven=uneven)
    eigenvalues = scipy.linalg.eigvalsh(system.K.to_dense(), system.M.to_dense())
    rounding = 64.0 * np.finfo(float).eps * eigenvalues[-1]
    if not uneven:
        line = 4.0 * np.sin(np.arange(1, 21) * np.pi / 42) ** 2
        eigenvalues = np.sort(np.add.outer(line, line).ravel())
        rounding = 4.0 * np.finfo(float).eps * eigenvalues[-1]
    counter, mass = spectrum.EigenvalueCounter.of(system), system.M.factorize()
    for shift, radius in ((0.5, 0.3), (4.03, 0.4), (7.0, 0.2), (7.9, 1.5)):
        low, high = counter.count(shift - radius), counter.count(shift + radius)
        solve = system.K.plus(-shift, system.M).factorize()
        computed = spectrum.modes_between(system, low, high, shift, solve, mass)
        inside = (eigenvalues > low.at) & (eigenvalues < high.at)
        assert computed.eigenvalues.size == inside.sum() > 5
        assert (
            np.abs(computed.eigenvalues - eigenvalues[inside]) <= computed.error + rounding
        ).all()
        identity = computed.modes.T @ (system.M @ computed.modes)
        np.testing.assert_allclose(identity, np.eye(inside.sum()), atol=1e-11)


@pytest.mark.parametrize("lean", [True, False])
def test_millions_of_harmonics_are_no_reason_for_partial_modes(*, lean: bool) -> None:
    """A beam whose frequencies differ by 1e5 to 1e6 has 1e5 harmonics below its highest one."""
    system = beams.cantilever(150, damped=False)
    if not lean:
        M, K = (SymmetricMatrix.dense(A) for A in finite_elements.matrices(150))
        system = System(M, K, system.constraints)
    few = problem(system, np.linspace(1.02, 3.0, 50) * beams.OMEGA, ["impulse", "exists"])
    plan = impact_modes.plan(few)
    spectral, impulse = plan.step(Stage.SPECTRUM), plan.step(Stage.IMPULSE)
    assert spectral is not None
    assert impulse is not None
    assert spectral.method != receptance.METHOD
    assert impulse.method == "scalar"
    certified = impact_modes.solve(few, plan).certified
    assert certified is not None
    assert certified.all()


def test_the_plan_takes_partial_modes_where_frequencies_are_many() -> None:
    system = membrane(40)
    bound = spectrum.largest_frequency(system)
    many = problem(system, np.linspace(0.3, 0.301, 300) * bound, ["impulse", "exists", "shape"])
    step = impact_modes.plan(many).step(Stage.SPECTRUM)
    assert step is not None
    assert step.method == receptance.METHOD
    assert "inertia" in step.reason
    few = impact_modes.plan(many.slice(0, 4))
    assert few.step(Stage.SPECTRUM) is None
    by_intervals = impact_modes.solve(many, impact_modes.plan(many))
    by_solves = impact_modes.solve(many.slice(0, 4), few)
    assert by_intervals.impulse is not None
    assert by_solves.impulse is not None
    assert by_intervals.exists is not None
    assert by_solves.exists is not None
    error = np.maximum(by_intervals.relative_error[:4], by_solves.relative_error)
    assert (np.abs(by_intervals.impulse[:4] / by_solves.impulse - 1.0)[:, 0] < 2 * error).all()
    np.testing.assert_array_equal(by_intervals.exists[:4], by_solves.exists)
    assert by_intervals.shape is not None
    assert by_solves.shape is not None
    np.testing.assert_allclose(by_intervals.shape[:4], by_solves.shape, rtol=1e-6, atol=1e-8)
    assert "omitted" in by_intervals.error_statement


def test_pieces_give_the_numbers_of_the_whole() -> None:
    system = membrane(40)
    bound = spectrum.largest_frequency(system)
    whole = problem(system, np.linspace(0.3, 0.301, 300) * bound, ["impulse", "energy"])
    plan = impact_modes.plan(whole)
    step = plan.step(Stage.SPECTRUM)
    assert step is not None
    assert step.method == receptance.METHOD
    expected = impact_modes.solve(whole, plan)
    pieces = [impact_modes.solve(whole.slice(a, a + 100), plan) for a in (0, 100, 200)]
    joined = impact_modes.join(whole, plan, pieces)
    np.testing.assert_array_equal(joined.impulse, expected.impulse)
    np.testing.assert_array_equal(joined.energy, expected.energy)


def test_a_looser_tolerance_keeps_fewer_modes() -> None:
    assert ExpansionSize.of(1e-3).factor < ExpansionSize.of(None).factor
    assert (
        ExpansionSize.of(1e-3).terms
        < ExpansionSize.of(1e-6).terms
        <= ExpansionSize.of(None).terms * 2
    )
    assert ExpansionSize.of(1e-15).terms <= ExpansionSize.of(None).terms


def test_rows_combine_degrees_of_freedom() -> None:
    rows = Coordinates.along(COUPLED)
    vectors = np.random.default_rng(1).standard_normal((144, 3))
    np.testing.assert_allclose(rows(vectors), [vectors[30], vectors[81] - vectors[82]])
    assert rows.size == 2
