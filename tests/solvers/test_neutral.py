"""Motions are neutral whose largest multiplier is 1 within its error."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest

from vibroimpact_solvers import branches, impact_modes, periodic_motions
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.periodic_motions import Force, Impact
from vibroimpact_solvers.presets import chain
from vibroimpact_solvers.results.branches import Type
from vibroimpact_solvers.stability import neutral


def test_neither_a_number_nor_a_bounded_error_tells_nothing() -> None:
    modulus = np.array([1.0, 1.0 + 1e-15, 1.0 - 1e-15, 1.0 + 1e-12, 0.9, np.nan, 1.0, 1.0])
    error = np.array([0.0, 2e-15, 2e-15, 1e-13, 1e-3, np.inf, np.inf, np.nan])
    told = [True, True, True, False, False, False, False, False]
    assert neutral(modulus, error).tolist() == told


def _driven(damping: float, Omega: np.ndarray[tuple[int], np.dtype[np.float64]]) -> System:
    one = SymmetricMatrix.diagonal([1.0])
    C = SymmetricMatrix.diagonal([damping]) if damping else None
    return System(one, one, (Constraint((0,), (1.0,), None, 10.0),), C)


@pytest.mark.parametrize("damping", [0.0, 1e-9, 0.1])
def test_motions_without_impacts(damping: float) -> None:
    """Multipliers are exp((-c/2 +- i) 2 pi/Omega): of modulus 1 without damping alone."""
    Omega = np.linspace(0.31, 0.77, 40)
    problem = periodic_motions.Problem(
        _driven(damping, Omega), Omega, load=(Force((0,), (1.0,), 0.1),), sequence=(Impact(0, 1),),
        outputs=frozenset({"stability"}),
    )  # fmt: skip
    result = periodic_motions.solve(problem, periodic_motions.plan(problem))
    still = result.solution_impacts == 0
    assert still.sum() == Omega.size
    assert result.solution_neutral is not None
    assert result.solution_stability is not None
    assert (result.solution_neutral[still] == (damping == 0.0)).all()
    expected = np.exp(-np.pi * damping / Omega)
    np.testing.assert_allclose(result.solution_stability[still], expected, rtol=1e-13)


def test_impact_modes() -> None:
    """The radii of the chain: 6.92 near grazing, 1 far above the spectrum."""
    Omega = np.array([2.1, 4.0])
    system = chain(13, [Constraint.at(5, gap=1.0)])
    problem = impact_modes.Problem(system, Omega * 2 / np.pi, outputs=frozenset({"stability"}))
    result = impact_modes.solve(problem, impact_modes.plan(problem))
    assert result.neutral is not None
    assert result.neutral.tolist() == [False, True]


def _branches(system: System, start: float, stop: float, **more: Any) -> branches.Result:
    def at(Omega: float) -> periodic_motions.Problem:
        return periodic_motions.Problem(
            system, np.array([Omega]), load=(Force((0,), (1.0,), 1.0),), sequence=(Impact(0, 1),),
            outputs=frozenset({"stability"}),
        )  # fmt: skip

    problem = branches.Problem(at, start, stop, system, frequency=True, **more)
    return branches.solve(problem, branches.plan(problem))


def _damped() -> System:
    """One mass that strikes a wall at rest; its first flip is at 2.65888."""
    one = SymmetricMatrix.diagonal([1.0])
    wall = Constraint((0,), (1.0,), None, 0.0, 0.8)
    return System(one, one, (wall,), SymmetricMatrix.diagonal([0.1]))


@pytest.mark.needs("compiled kernels")
def test_special_points_lie_between_the_motions_that_they_name() -> None:
    result = _branches(_damped(), 2.4, 3.4, switch=2)
    assert result.point_type.size >= 4
    for k, row in enumerate(result.point_solution):
        ends = slice(row, row + 2)
        assert (result.solution_branch[ends] == result.point_branch[k]).all()
        low, high = result.solution_parameter[ends]
        between = low + result.point_along[k] * (high - low)
        assert 0.0 <= result.point_along[k] <= 1.0
        assert abs(between - result.point_parameter[k]) < 0.02 * abs(high - low)
        assert 0.0 < result.error_point_along[k] < 1e-6
        # Both errors are those of one bracket.
        moved = result.error_point_along[k] * abs(high - low)
        assert 0.5 * moved < result.error_point_parameter[k] < 2.0 * moved


def test_the_place_of_a_first_touch_is_that_of_the_formula() -> None:
    """The amplitude 1/(Omega^2 - 1) is that of the wall, 2, at sqrt(3/2)."""
    one = SymmetricMatrix.diagonal([1.0])
    result = _branches(System(one, one, (Constraint((0,), (1.0,), None, 2.0),)), 1.1, 1.4)
    (k,) = np.flatnonzero(result.solution_impacts[result.point_solution] == 0)
    row = result.point_solution[k]
    with mpmath.workdps(30):
        low, high = (mpmath.mpf(float(each)) for each in result.solution_parameter[row : row + 2])
        exact = (mpmath.sqrt(mpmath.mpf(3) / 2) - low) / (high - low)
        off = abs(mpmath.mpf(float(result.point_along[k])) - exact)
    assert off <= result.error_point_along[k] < 1e-9


def test_where_a_branch_stops_its_last_motion_is_the_special_point() -> None:
    result = _branches(_damped(), 2.4, 3.4, stop_at=frozenset({"flip"}))
    flips = np.flatnonzero(result.point_type == Type.FLIP)
    assert flips.size
    for k in flips:
        row = result.point_solution[k]
        at = row + 1 if result.point_along[k] > 0.5 else row
        assert result.point_along[k] == pytest.approx(at - row, abs=result.error_point_along[k])
        assert result.solution_parameter[at] == result.point_parameter[k]
        ends = [row - 1, row + 2]
        others = [each for each in ends if 0 <= each < result.solution_branch.size]
        assert any(result.solution_branch[each] != result.point_branch[k] for each in others)
