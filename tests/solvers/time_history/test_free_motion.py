"""Histories against event-driven motion in extended precision and the chapter's references."""

from __future__ import annotations

from typing import Any

import mpmath as mp
import numpy as np
import pytest
import scipy.optimize

from tests.solvers.time_history.reference_motion import ReferenceMotion, Stop
from vibroimpact_solvers import presets
from vibroimpact_solvers import time_history as th
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

ALL = frozenset(th.OUTPUTS)


def solve(problem: th.Problem) -> th.Result:
    return th.solve(problem, th.plan(problem))


def reference_motion(system: System, loads: Any = ()) -> ReferenceMotion:
    stops = []
    for constraint in system.constraints:
        weights = np.zeros(system.n)
        weights[list(constraint.dofs)] = constraint.weights
        stops.append(
            Stop(weights.tolist(), constraint.lower, constraint.upper, constraint.restitution)
        )
    return ReferenceMotion(
        system.M.to_dense().tolist(),
        system.K.to_dense().tolist(),
        stops,
        None if system.C is None else system.C.to_dense().tolist(),
        None if system.force is None else system.force.tolist(),
        loads,
    )


def compare(
    system: System, x: Floats, v: Floats, t_end: float, step: float, load: Any = ()
) -> tuple[th.Result, float]:
    """Return the history and the largest error of the final state over what rounding can do."""
    problem = th.Problem(
        system, th.State(x, v), t_end, t=np.array([t_end]), outputs=ALL, load=tuple(load)
    )
    result = solve(problem)
    terms = [(np.eye(system.n)[t.dof] * t.amplitude, t.frequency, t.phase) for t in load]
    expected, final = reference_motion(system, terms).follow(x.tolist(), v.tolist(), t_end, step)
    assert result.impact_time is not None
    assert result.impact_constraint is not None
    assert result.impact_side is not None
    assert result.impact_velocity is not None
    assert result.x is not None
    assert result.v is not None
    assert len(expected) == result.count_impacts
    assert result.impact_constraint.tolist() == [i for _, i, _, _ in expected]
    assert result.impact_side.tolist() == [side for _, _, side, _ in expected]
    rounding = 2.0**-52 * result.error_condition
    size = max(1.0, float(np.abs(v).max()))
    times = _errors(result.impact_time, [e[0] for e in expected])
    speeds = _errors(result.impact_velocity, [e[3] for e in expected])
    state = np.concatenate([result.x[0], result.v[0]])
    errors = _errors(state, list(final))
    worst = max(np.abs(a).max(initial=0.0) for a in (times, speeds, errors))
    return result, worst / (size * rounding)


def _errors(found: Floats, expected: list[Any]) -> Floats:
    pairs = zip(found.tolist(), expected, strict=True)
    return np.array([float(mp.mpf(a) - b) for a, b in pairs])


def test_an_oscillator_between_lossy_walls() -> None:
    system = presets.oscillator([Constraint.at(0, 1.0, 0.95)], 1.0)
    result, worst = compare(system, np.array([0.0]), np.array([5.0]), 30.0, 0.05)
    assert result.count_impacts == 32
    assert worst < 4.0


@pytest.mark.parametrize("zeta", [0.01, 1.0, 2.5])
def test_damping_below_at_and_above_the_critical(zeta: float) -> None:
    gap = Constraint((0,), (1.0,), 0.02, 0.3, 0.8)
    system = presets.oscillator([gap], 1.3, zeta)
    result, worst = compare(system, np.array([0.1]), np.array([3.0]), 12.0, 0.01)
    assert result.count_impacts > 0
    assert worst < 40.0


@pytest.mark.needs("compiled kernels")
def test_a_chain_with_two_limiters() -> None:
    limiters = [Constraint.at(1, 0.2, 0.9), Constraint((3, 4), (1.0, -1.0), None, 0.15, 0.7)]
    system = presets.chain(6, limiters)
    rng = np.random.default_rng(3)
    x, v = rng.uniform(-0.1, 0.1, 6), rng.uniform(-0.8, 0.8, 6)
    result, worst = compare(system, x, v, 40.0, 0.05)
    assert result.count_impacts > 20
    assert worst < 20.0


def test_damping_that_couples_the_modes() -> None:
    system = presets.two_mass([Constraint.at(0, 1.0, 0.95)], 1.0, 0.05, 0.01)
    x, v = np.array([0.0, -0.003]), np.array([5.0, 0.0])
    result, worst = compare(system, x, v, 20.0, 0.05)
    assert result.count_impacts > 20
    assert worst < 20.0


@pytest.mark.needs("compiled kernels")
def test_dashpots_that_overdamp_some_modes() -> None:
    C = np.array([[3.0, -2.5, 0.0], [-2.5, 4.0, -0.2], [0.0, -0.2, 0.25]])
    K = np.array([[3.0, -1.0, 0.0], [-1.0, 2.5, -1.0], [0.0, -1.0, 1.5]])
    M = np.array([[2.0, 0.3, 0.0], [0.3, 1.0, 0.0], [0.0, 0.0, 1.0]])
    system = System(
        *(SymmetricMatrix.dense(a) for a in (M, K)),
        (Constraint.at(2, 0.2, 0.9),),
        C=SymmetricMatrix.dense(C),
        force=np.array([0.1, 0.0, 0.05]),
    )
    result, worst = compare(system, np.zeros(3), np.array([0.0, 0.5, 2.0]), 15.0, 0.02)
    assert result.count_impacts > 3
    assert worst < 40.0


@pytest.mark.needs("compiled kernels")
def test_harmonic_loads() -> None:
    system = presets.chain(4, [Constraint.at(2, 0.3, 0.8)])
    load = [th.Harmonic(0, 0.4, 0.9, 0.3), th.Harmonic(3, 0.2, 2.2, -1.0)]
    result, worst = compare(system, np.zeros(4), np.zeros(4), 60.0, 0.05, load)
    assert result.count_impacts > 10
    assert worst < 40.0


def test_unstable_equilibrium_between_walls() -> None:
    system = System(
        SymmetricMatrix.diagonal([1.0, 1.0]),
        SymmetricMatrix.dense([[-1.0, 0.3], [0.3, 2.0]]),
        (Constraint.at(0, 0.5, 0.9),),
    )
    result, worst = compare(system, np.array([0.01, 0.1]), np.array([0.0, 0.3]), 15.0, 0.02)
    assert result.count_impacts > 3
    assert worst < 40.0


@pytest.mark.parametrize("beside", [1e-3, 1e-7, 1e-10, 0.0])
def test_damping_that_makes_two_modes_equal(beside: float) -> None:
    """At the exceptional point of a pair of oscillators the modal matrix is defective.

    M = 1, K = [[1, a], [a, 1 + d]], C = diag(2 g, 0): the complex modes coincide for g and d of
    which Newton's method finds all digits; eigenvectors would lose half of them.
    """
    found = scipy.optimize.root(_discriminant, [0.05, -0.0025], tol=1e-14)
    g, d = found.x
    system = System(
        SymmetricMatrix.diagonal([1.0, 1.0]),
        SymmetricMatrix.dense([[1.0, 0.05], [0.05, 1.0 + d]]),
        (Constraint.at(1, 0.2, 0.9),),
        C=SymmetricMatrix.dense(np.diag([2.0 * (g + beside), 0.0])),
    )
    result, worst = compare(system, np.zeros(2), np.array([0.1, 0.6]), 15.0, 0.05)
    assert result.count_impacts == 12
    assert worst < 1.0
    assert result.error_condition < 3e3


def _discriminant(p: Floats) -> list[float]:
    """Return the square of the difference of the two rates, real and imaginary part."""
    g, d = p
    K, C = np.array([[1.0, 0.05], [0.05, 1.0 + d]]), np.diag([2.0 * g, 0.0])
    rates = np.linalg.eigvals(np.block([[np.zeros((2, 2)), np.eye(2)], [-K, -C]]))
    first, second = rates[rates.imag > 0.0]
    return [((first - second) ** 2).real, ((first - second) ** 2).imag]


@pytest.mark.parametrize("gap", [10.0, 0.9], ids=["far", "within reach of all modes at once"])
def test_long_free_motions_cost_no_steps(gap: float) -> None:
    """A million units of time without an impact: 0.1.0 went through them window by window."""
    system = presets.chain(3, [Constraint.at(1, gap)])
    x, v, t_end = np.array([0.5, 0.2, -0.3]), np.array([0.1, 0.3, 0.2]), 1e6
    outputs = frozenset({"x", "impacts"})
    problem = th.Problem(system, th.State(x, v), t_end, t=np.array([t_end]), outputs=outputs)
    result = th.solve(problem, th.plan(problem))
    assert result.count_impacts == 0
    assert result.count_expansions < 100
    assert result.x is not None
    with mp.workdps(40):
        modes = [[mp.sin(mp.pi * i * j / 4) / mp.sqrt(2) for i in (1, 2, 3)] for j in (1, 2, 3)]
        true = [mp.mpf(0)] * 3
        for j, mode in enumerate(modes, start=1):
            w = 2 * mp.sin(mp.pi * j / 8)
            q, rate = (mp.fdot(mode, part.tolist()) for part in (x, v))
            now = q * mp.cos(w * t_end) + rate / w * mp.sin(w * t_end)
            true = [a + now * part for a, part in zip(true, mode, strict=True)]
        off = [abs(float(a - mp.mpf(float(b)))) for a, b in zip(true, result.x[0], strict=True)]
    assert max(off) <= result.error_condition * 2.0**-52
