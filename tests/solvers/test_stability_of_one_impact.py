"""Multipliers as zeros of a sum over the modes: against many digits, the map, and polynomials."""

from __future__ import annotations

from unittest import mock

import mpmath
import numpy as np
import pytest
import scipy.linalg

from tests.solvers.beams import OMEGA, cantilever
from tests.solvers.structures import random_system
from tests.solvers.test_stability_errors import compared, exact_radius
from vibroimpact_solvers import impact_modes as modes
from vibroimpact_solvers import spectrum, stability
from vibroimpact_solvers.kernels import free_motion, secular
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.presets import chain
from vibroimpact_solvers.stability import one_impact, period_map


def orbits(system: System, Omega: np.ndarray) -> stability.Orbits:
    """Return the impact modes that exist, as their stability depends on them."""
    seen: list[stability.Orbits] = []
    growth = stability.growth

    def recorded(of: stability.Orbits) -> tuple[np.ndarray, np.ndarray]:
        seen.append(of)
        return growth(of)

    outputs = frozenset({"stability"})
    problem = modes.Problem(system, Omega * (2 / np.pi), (0,), outputs, Omega=Omega)
    with mock.patch.object(stability, "growth", recorded):
        modes.solve(problem, modes.plan(problem))
    (one,) = seen
    return one


@pytest.mark.parametrize("seed", range(8))
def test_radii_are_within_their_errors(seed: int) -> None:
    lower = None if seed % 2 else 1.0
    system = random_system(seed, 2 + seed % 5, [Constraint((0,), (1.0,), lower, 1.0)])
    highest = float(spectrum.spectrum(system).roots[-1])
    # One-sided modes of these structures exist just above the spectrum.
    Omega = 1.0 + np.geomspace(1e-6, 0.4, 40) if seed % 2 else np.linspace(0.4, 2.6, 60)
    pairs = compared(system, Omega * highest)
    assert len(pairs) >= 5
    for true, stated in pairs:
        assert true <= stated < 1e-9


def test_radii_of_a_beam_are_within_their_errors() -> None:
    system = cantilever(3, damped=False)
    pairs = compared(system, np.linspace(1.01, 1.3, 12) * OMEGA)
    assert len(pairs) >= 3
    for true, stated in pairs:
        assert true <= stated < 1e-8


@pytest.mark.parametrize("elements", [6, 20])
def test_sum_and_map_agree(elements: int) -> None:
    """Two ways that have the natural modes in common: their intervals overlap."""
    of = orbits(cantilever(elements, damped=False), np.linspace(1.001, 1.4, 60) * OMEGA)
    free = one_impact.FreeMotion.of(of)
    assert of.omega.size >= 10
    for f in range(of.omega.size):
        by_sum, by_map = free.radius(f), period_map.radius(of, f)
        assert by_sum.low <= by_map.high
        assert by_map.low <= by_sum.high
        assert by_sum.high - by_sum.low < 1e-7 * by_sum.value


def test_free_structures() -> None:
    """A rigid-body mode takes part with the duration of free motion."""
    M = SymmetricMatrix.diagonal([1.0, 2.0, 0.7])
    K = SymmetricMatrix.dense([[3.0, -3.0, 0.0], [-3.0, 5.0, -2.0], [0.0, -2.0, 2.0]])
    system = System(M, K, (Constraint.at(0, 1.0),))
    assert spectrum.spectrum(system).roots[0] == 0.0
    of = orbits(system, np.linspace(0.5, 12.0, 80))
    assert of.omega.size >= 10
    free = one_impact.FreeMotion.of(of)
    for f in range(of.omega.size):
        by_sum, by_map = free.radius(f), period_map.radius(of, f)
        assert by_sum.value == pytest.approx(by_map.value, rel=1e-6)
        assert by_sum.low <= by_map.high
        assert by_map.low <= by_sum.high


def test_modes_of_one_frequency_take_part_as_one() -> None:
    """Two equal oscillators beside the struck mass: their difference is never struck."""
    M = SymmetricMatrix.diagonal([1.0, 0.5, 0.5])
    K = SymmetricMatrix.dense([[6.0, -1.0, -1.0], [-1.0, 2.0, 0.0], [-1.0, 0.0, 2.0]])
    turned = scipy.linalg.block_diag(1.0, [[0.8, -0.6], [0.6, 0.8]])
    # In other coordinates no mode has a node at the struck mass to rounding.
    other = System(
        SymmetricMatrix.dense(turned.T @ M.to_dense() @ turned),
        SymmetricMatrix.dense(turned.T @ K.to_dense() @ turned),
        (Constraint.at(0, 1.0),),
    )
    Omega = np.linspace(2.7, 6.0, 40)
    pairs = compared(other, Omega)
    assert len(pairs) >= 10
    for true, stated in pairs:
        assert true <= stated < 1e-9


def test_no_map_is_made_of_one_impact() -> None:
    outputs, Omega = frozenset({"stability"}), np.linspace(1.005, 1.3, 20) * OMEGA
    system = cantilever(60, damped=False)
    problem = modes.Problem(system, Omega * (2 / np.pi), (0,), outputs, Omega=Omega)
    plan = modes.plan(problem)
    step = next(step for step in plan.steps if step.stage == "stability")
    assert step.method == "sum over the modes"
    with mock.patch.object(period_map, "radius", side_effect=AssertionError):
        result = modes.solve(problem, plan)
    known = np.isfinite(result.stability)
    assert known.any()
    assert (result.stability_error[known] < 1e-6 * result.stability[known]).all()


def test_the_map_is_planned_where_two_constraints_are_struck() -> None:
    system = chain(12, [Constraint.at(4, 0.2), Constraint.at(7, 0.2)])
    problem = modes.Problem(system, np.array([2.2]), outputs=frozenset({"stability"}))
    step = next(step for step in modes.plan(problem).steps if step.stage == "stability")
    assert step.method == "half-period map"


def test_structures_with_a_growing_mode_have_their_map() -> None:
    K = SymmetricMatrix.dense([[-1.0, 0.5], [0.5, 2.0]])
    system = System(SymmetricMatrix.diagonal([1.0, 1.0]), K, (Constraint.at(0, 1.0),))
    Omega = np.linspace(0.5, 6.0, 60)
    of = orbits(system, Omega)
    assert not one_impact.applies(of)
    for f in range(0, of.omega.size, 10):
        exact = exact_radius(
            system, float(Omega[np.argmin(np.abs(Omega * 2 / np.pi - of.omega[f]))])
        )
        assert period_map.radius(of, f).value == pytest.approx(exact, rel=1e-9)


def modes_of(phases: np.ndarray, weights: np.ndarray, *, mirrored: bool) -> free_motion.Modes:
    """Return modes with some phases of half a period and weights, exact ones."""
    free = free_motion.FreeMotion(phases, np.zeros(phases.size), np.zeros(phases.size))
    turned = free_motion.Phases(*np.empty((len(free_motion.Phases._fields), phases.size)))
    free_motion.turn(free, 2.0 if mirrored else 4.0, 0.0, mirrored, turned)
    order = np.argsort(turned.pole)
    bends = weights * turned.bend
    parts = [part[order] for part in (weights, np.zeros(phases.size), *turned)]
    return free_motion.Modes._make([*parts, -1.0 if mirrored else 1.0, float(bends.sum()), 0.0])


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("mirrored", [True, False])
def test_zeros_are_in_their_discs(seed: int, mirrored: bool) -> None:
    """Against the zeros of the determinant itself, multiplied out with many digits."""
    random = np.random.default_rng(seed)
    n = 3 + seed
    phases, weights = np.sort(random.uniform(0.2, 40.0, n)), random.uniform(0.05, 1.0, n)
    weights /= weights.sum()
    of = modes_of(phases, weights, mirrored=mirrored)
    equation = secular.Equation(*np.empty((4, n)))
    secular.residues(of, equation)
    home, alone = np.empty((2, n - 1), dtype=np.int64)
    zeros = secular.Zeros(home, *np.empty((4, n - 1)), alone)
    assert secular.find(of, equation, zeros, np.zeros(1, secular.PROGRESS), 10**6)
    found = equation.pole[home] + zeros.x + 1j * zeros.y + of.known
    exact = _multiplied_out(phases, weights, mirrored)
    for value, circle, one in zip(found, zeros.radius, alone, strict=True):
        inside = np.abs(exact - value) <= circle
        assert inside.any()
        if one:
            assert inside.sum() == 1
    covered = (np.abs(exact[:, np.newaxis] - found) <= zeros.radius).any(axis=1)
    assert covered.sum() >= n - 1
    assert np.median(zeros.radius) < 1e-10


def _multiplied_out(phases: np.ndarray, weights: np.ndarray, mirrored: bool) -> np.ndarray:
    """Return all ``(nu + 1/nu)/2`` of the saltation matrix times free motion, by their matrix."""
    with mpmath.workdps(40):
        n = phases.size
        phi = [mpmath.mpf(float(p)) for p in phases]
        w = [mpmath.sqrt(mpmath.mpf(float(a))) for a in weights]
        mu = sum(a**2 for a in w)
        half = [-p * mpmath.tan(p / 2) if mirrored else p * mpmath.cot(p / 2) for p in phi]
        g = sum(a**2 * h for a, h in zip(w, half, strict=True)) / mu
        S, Phi = mpmath.eye(2 * n), mpmath.zeros(2 * n)
        for i in range(n):
            Phi[i, i] = Phi[n + i, n + i] = mpmath.cos(phi[i])
            Phi[i, n + i], Phi[n + i, i] = mpmath.sin(phi[i]) / phi[i], -phi[i] * mpmath.sin(phi[i])
            for j in range(n):
                S[i, j] -= 2 * w[i] * w[j] / mu
                S[n + i, n + j] -= 2 * w[i] * w[j] / mu
                S[n + i, j] += 2 * g * w[i] * w[j] / mu
        P = S * Phi
        values, _ = mpmath.eig((P + P**-1) / 2)
        numbers = sorted(map(complex, values), key=lambda z: (round(z.real, 9), round(z.imag, 9)))
    return np.array(numbers[::2])  # each is one of a pair nu, 1/nu


def test_zeros_of_many_modes_are_found_in_pieces_of_milliseconds() -> None:
    """What one call does is bounded; the pieces are one search."""
    random = np.random.default_rng(0)
    n = 400
    phases, weights = np.sort(random.uniform(0.2, 4e3, n)), random.uniform(0.05, 1.0, n)
    of = modes_of(phases, weights / weights.sum(), mirrored=True)
    found = []
    for piece in (secular.PIECE, 10**9):
        equation = secular.Equation(*np.empty((4, n)))
        secular.residues(of, equation)
        home, alone = np.empty((2, n - 1), dtype=np.int64)
        zeros = secular.Zeros(home, *np.empty((4, n - 1)), alone)
        progress, calls = np.zeros(1, secular.PROGRESS), 1
        while not secular.find(of, equation, zeros, progress, piece):
            calls += 1
        found.append((calls, zeros))
    (calls, zeros), (once, whole) = found
    assert once == 1
    assert calls >= 3
    for one, other in zip(zeros, whole, strict=True):
        np.testing.assert_array_equal(one, other)
