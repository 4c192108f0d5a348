"""Special points of one mass between stops, each against an independent value.

The oscillator is that of Shaw and Holmes, A periodically forced piecewise linear oscillator,
J. Sound Vib. 90 (1983) 129-155, in its limit of a rigid stop, where the motion between impacts
and its periodic orbits are known; the reference computes them by shooting in 40 digits.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.solvers.branches.shooting import Oscillator
from vibroimpact_solvers import branches
from vibroimpact_solvers import periodic_motions as driven
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

ONE = SymmetricMatrix.diagonal([1.0])
OUTPUTS = frozenset({"exists", "stability"})


def followed(
    of: Oscillator, start: float, stop: float, *, symmetric: bool = False, **options: object
) -> branches.Result:
    wall = Constraint((0,), (1.0,), of.gap if symmetric else None, of.gap, of.k)
    system = System(ONE, ONE, (wall,), C=SymmetricMatrix.diagonal([2.0 * of.d]))
    load = (driven.Force((0,), (1.0,), of.a),)
    sequence = driven.SYMMETRIC if symmetric else (driven.Impact(0),)

    def at(Omega: float) -> driven.Problem:
        return driven.Problem(system, np.array([Omega]), load, sequence=sequence, outputs=OUTPUTS)

    problem = branches.Problem(at, start, stop, system, frequency=True, **options)  # type: ignore[arg-type]
    return branches.solve(problem, branches.plan(problem))


def points(result: branches.Result, kind: branches.Type) -> np.ndarray:
    """Return the rows of special points of admissible motions."""
    return np.flatnonzero((result.point_type == kind) & result.point_exists)


def times(result: branches.Result, row: int) -> list[float]:
    """Return the impacts' times of the listed motion nearest to a special point.

    There is about one in each period of the drive.
    """
    mine = np.flatnonzero(result.solution_branch == result.point_branch[row])
    near = mine[np.argmin(np.abs(result.solution_parameter[mine] - result.point_parameter[row]))]
    phases = result.impact_phase[result.impact_solution == near]
    after = result.solution_Omega[near]
    apart = np.angle(np.exp(1j * (phases - phases[0])))
    return list((phases[0] + apart + 2.0 * np.pi * np.arange(phases.size)) / after)


def test_a_cascade_of_flips() -> None:
    """Four doublings, three against the reference; distances shrink as Feigenbaum's number."""
    oscillator = Oscillator(0.05, 1.0, 0.0, 0.8)
    result = followed(oscillator, 2.6, 2.75, switch=3, step=0.1)
    flips = [points(result, branches.Type.FLIP)[:1]]
    cascade: list[float] = []
    row = int(flips[0][0])
    for periods in (1, 2, 4):
        value = result.point_parameter[row]
        own = result.point_branch[row]
        assert result.solution_periods[result.solution_branch == own][0] == periods
        expected = oscillator.special(float(value), times(result, row), periods, 1, -1)
        assert abs(float(expected - value)) < result.point_error[row]
        assert result.point_error[row] < 1e-10
        cascade.append(float(value))
        child = result.point_leads_to[row]
        later = [r for r in points(result, branches.Type.FLIP) if result.point_branch[r] == child]
        row = int(later[0]) if later else -1
    assert row >= 0
    cascade.append(float(result.point_parameter[row]))
    ratios = -np.diff(cascade)[:-1] / -np.diff(cascade)[1:]
    assert ratios == pytest.approx([4.669, 4.669], abs=0.5)


def test_a_fold_and_the_grazing_motion_without_impacts() -> None:
    oscillator = Oscillator(0.05, 1.0, 1.2, 0.8)
    result = followed(oscillator, 1.1, 2.2)
    (row,) = points(result, branches.Type.FOLD)
    value = result.point_parameter[row]
    expected = oscillator.special(float(value), times(result, row), 1, 1, 1)
    assert abs(float(expected - value)) < result.point_error[row] < 1e-10
    touches = points(result, branches.Type.GRAZING)
    linear = result.solution_branch[result.solution_impacts == 0][0]
    (touch,) = [r for r in touches if result.point_branch[r] == linear]
    # |1 - W^2 + 2 i d W| = a / gap
    W2 = np.roots([1.0, 4.0 * 0.05**2 - 2.0, 1.0 - (1.0 / 1.2) ** 2]).max()
    assert abs(result.point_parameter[touch] - np.sqrt(W2)) < result.point_error[touch]


def test_the_loss_of_symmetry() -> None:
    oscillator = Oscillator(0.02, 1.0, 0.3, 0.75)
    result = followed(oscillator, 0.6, 3.0, symmetric=True, switch=1)
    row = points(result, branches.Type.SYMMETRY)[0]
    value = result.point_parameter[row]
    expected = oscillator.special(float(value), times(result, row)[:1], 0.5, -1, -1)
    assert abs(float(expected - value)) < result.point_error[row] < 1e-10
    child = result.solution_branch == result.point_leads_to[row]
    assert child.sum() > 3
    momenta = result.impact_momentum[np.isin(result.impact_solution, np.flatnonzero(child))]
    assert np.abs(momenta[0::2] - momenta[1::2]).max() > 1e-2
