"""What a tolerance means: the result says what keeps it."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
import scipy.optimize

from vibroimpact_solvers import impact_modes, presets, resonances, slow_flow
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

GAP = 0.2


SYSTEM = presets.chain(13, [Constraint.at(5, GAP)])


def inverse_impulse(Omega: float) -> float:
    problem = impact_modes.Problem(SYSTEM, np.array([Omega * (2.0 / np.pi)]))
    impulse = impact_modes.solve(problem, impact_modes.plan(problem)).impulse
    assert impulse is not None
    return float(1.0 / impulse[0, 0])


def solved(tolerance: float | None) -> impact_modes.Result:
    # The second is beside a frequency at which no impulse is large enough, by a billionth, where
    # nine digits are lost.
    singular = scipy.optimize.brentq(inverse_impulse, 1.12, 1.15)
    Omega = np.array([1.2, singular * (1.0 + 1e-9), 2.5])
    problem = impact_modes.Problem(
        SYSTEM, Omega * (2.0 / np.pi), outputs=frozenset({"impulse"}), tolerance=tolerance
    )
    return impact_modes.solve(problem, impact_modes.plan(problem))


@pytest.mark.needs("compiled kernels")
def test_solutions_say_whether_they_are_within() -> None:
    assert solved(None).within_tolerance is None
    np.testing.assert_array_equal(solved(1e-10).within_tolerance, [True, False, True])
    np.testing.assert_array_equal(solved(1e-3).within_tolerance, [True, True, True])
    np.testing.assert_array_equal(solved(1e-20).within_tolerance, [False, False, False])


def test_resonances_say_whether_they_are_within() -> None:
    stiff = SymmetricMatrix.dense([[2.0, -1.0, 0.0], [-1.0, 2e10, -1e10], [0.0, -1e10, 1e10 + 1.0]])
    system = System(SymmetricMatrix.diagonal(np.ones(3)), stiff, (Constraint.at(0, GAP),))
    problem = resonances.Problem(system, odd_max=1, tolerance=1e-10)
    result = resonances.solve(problem, resonances.plan(problem))
    assert result.Omega is not None
    remaining = mpmath.matrix(
        [[mpmath.mpf(2e10), mpmath.mpf(-1e10)], [mpmath.mpf(-1e10), 1e10 + 1.0]]
    )
    with mpmath.workdps(40):
        exact = [mpmath.sqrt(value) for value in mpmath.eigsy(remaining, eigvals_only=True)]
        for value, natural, error in zip(exact, result.natural, result.error_relative, strict=True):
            assert abs(natural / value - 1) <= error
    # The lower of the two is known to a few roundings of the higher one.
    assert result.error_relative[1] < result.error_relative[0]
    assert result.within_tolerance is not None
    np.testing.assert_array_equal(result.within_tolerance, result.error_relative <= 1e-10)
    silent = resonances.Problem(system)
    assert resonances.solve(silent, resonances.plan(silent)).within_tolerance is None
    with pytest.raises(ModelError) as caught:
        resonances.Problem(system, tolerance=2.0)
    assert caught.value.pointer == ("tolerance",)


def flow(variant: str, tolerance: float | None, outputs: set[str]) -> slow_flow.Result:
    system = presets.oscillator([Constraint.at(0, 1.0, 0.95)], 1.0)
    problem = slow_flow.Problem(
        system,
        "restitution",
        variant,
        slow_flow.Initial(gamma=0.3),
        np.linspace(0.0, 20.0, 101),
        frozenset(outputs),
        tolerance,
    )
    return slow_flow.solve(problem, slow_flow.plan(problem))


def test_slow_flows_say_whether_they_are_within() -> None:
    full = flow("corrected", None, {"x", "error"})
    assert full.within_tolerance is None
    assert full.difference_x is not None
    assert full.x is not None
    error = np.abs(full.difference_x).max() / np.abs(full.x - full.difference_x).max()
    for factor, within in ((0.9, False), (1.1, True)):
        result = flow("corrected", float(factor * error), {"state"})
        assert result.within_tolerance is not None
        assert bool(result.within_tolerance) is within
        # Only the verdict was requested.
        assert result.error_x is None
        assert result.difference_x is None
        assert "exact motion" in result.error_statement
    exact = flow("exact", 1e-9, {"x"})
    assert exact.within_tolerance is not None
    assert bool(exact.within_tolerance)
