"""Structures that strain a solver, and what their answers must satisfy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mpmath
import numpy as np

from tests.solvers.stress import extended
from vibroimpact_solvers import impact_modes
from vibroimpact_solvers.impact_modes import Problem, Reason, Result
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

GAP = 0.2
FAMILIES = {
    "odd": (Constraint.at(1, GAP),),
    "coupled": (Constraint.at(1, GAP), Constraint.at(3, 1.5 * GAP)),
    "asymmetric": (Constraint((1,), (1.0,), 0.1, 0.3),),
    "unilateral": (Constraint((1,), (1.0,), None, 0.3),),
    "mixed": (Constraint((1,), (1.0,), 0.1, 0.3), Constraint((3,), (1.0,), None, 0.2)),
    "relative": (Constraint((1, 2), (1.0, -1.0), GAP, GAP),),
}

VAGUE = 0.1
"""Above this stated relative error no digit is claimed, and nothing may be certain."""


def springs(
    masses: Sequence[float] | np.ndarray,
    stiffnesses: Sequence[float] | np.ndarray,
    constraints: Sequence[Constraint],
    force: np.ndarray | None = None,
) -> System:
    """Return masses in a row, joined by one spring more between fixed ends."""
    k = np.asarray(stiffnesses, dtype=float)
    K = SymmetricMatrix.bands({0: k[:-1] + k[1:], 1: -k[1:-1]})
    return System(SymmetricMatrix.diagonal(masses), K, tuple(constraints), force=force)


def full(
    M: np.ndarray,
    K: np.ndarray,
    constraints: Sequence[Constraint],
    force: np.ndarray | None = None,
) -> System:
    """Return a structure with full matrices."""
    M, K = (SymmetricMatrix.dense(0.5 * (A + A.T)) for A in (M, K))
    return System(M, K, tuple(constraints), force=force)


def solve(
    system: System, Omega: Any, outputs: Sequence[str] = ("impulse", "exists"), **more: Any
) -> Result:
    """Plan and solve at fundamental frequencies."""
    Omega = np.atleast_1d(np.asarray(Omega, dtype=float))
    problem = Problem(
        system, Omega * (2 / np.pi), Omega=Omega, outputs=frozenset(outputs) | {"reason"}, **more
    )
    return impact_modes.solve(problem, impact_modes.plan(problem))


def check(
    system: System,
    Omega: Any,
    natural: extended.Modes | None = None,
    digits: int = 60,
    proofs: bool = True,
    times: int = 81,
) -> Result:
    """Solve and compare every solution with extended precision.

    The impulses must be within their stated error, whatever it is; where no digit is stated,
    nothing may be called certain that ball arithmetic has not decided. What is certified must be
    true.
    """
    result = solve(system, Omega)
    assert result.impulse is not None
    assert np.isfinite(result.impulse).all()
    assert np.isfinite(result.relative_error).all()
    assert np.isfinite(result.condition).all()
    with mpmath.workdps(digits):
        natural = natural or extended.modes(system)
        for f, value in enumerate(result.Omega):
            in_balls = result.extended is not None and result.extended[f]
            if result.relative_error[f] > VAGUE and not in_balls:
                assert not result.certified[f], f"certain without a digit at {value!r}"
                continue
            exact = extended.solution(
                system, natural, extended.omega_of(value), range(len(system.constraints))
            )
            _check_impulses(result, f, exact)
            if proofs:
                _check_verdict(system, result, f, exact, times)
    return result


def _check_impulses(result: Result, f: int, exact: extended.Solution) -> None:
    pairs = list(zip(result.impulse[f], exact.plus, strict=True))
    if result.impulse_lower is not None:
        pairs += zip(result.impulse_lower[f], exact.minus, strict=True)
    largest = max(abs(p) for _, p in pairs)
    error = max(abs(mpmath.mpf(float(computed)) - p) for computed, p in pairs)
    stated = float(result.relative_error[f])
    message = f"at Omega = {result.Omega[f]!r}: error {float(error / largest):.2e}, {stated:.2e}"
    # What is stated is relative to the computed impulse and of first order.
    assert error <= stated / (1.0 - stated) * largest, message


def _check_verdict(
    system: System, result: Result, f: int, exact: extended.Solution, times: int
) -> None:
    """Check a certified verdict against the exact solution."""
    if not result.certified[f]:
        return
    reason = Reason(int(result.reason[f]))
    at = f"at Omega = {result.Omega[f]!r}"
    walls = [
        (a, side, p)
        for a, c in enumerate(system.constraints)
        for side, wall, p in ((1, c.upper, exact.plus[a]), (-1, c.lower, exact.minus[a]))
        if wall is not None
    ]
    if reason is Reason.NEGATIVE_IMPULSE:
        assert min(p for _, _, p in walls) <= 0, at
    elif reason is Reason.WRONG_VELOCITY:
        assert min(exact.velocity_into(a, side) for a, side, _ in walls) <= 0, at
    elif reason is Reason.PENETRATION:
        tau = mpmath.mpf(float(result.witness[f]))
        assert _excess(system, exact, tau) > 0, at
    elif reason is Reason.OK:
        assert min(p for _, _, p in walls) > 0, at
        for tau in np.linspace(-1.0, 1.0, times):
            assert _excess(system, exact, mpmath.mpf(float(tau))) < 1e-9, f"{at}, tau = {tau}"


def _excess(system: System, exact: extended.Solution, tau: Any) -> Any:
    """Return by how much limits are passed at one time, relative to their distance."""
    passed = []
    for a, c in enumerate(system.constraints):
        y = exact.coordinate(a, tau)
        room = max(abs(wall) for wall in (c.lower, c.upper) if wall is not None)
        if c.upper is not None:
            passed.append((y - c.upper) / room)
        if c.lower is not None:
            passed.append((-c.lower - y) / room)
    return max(passed)
