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
from vibroimpact_solvers.errors import ModelError, PlanError
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


@pytest.mark.parametrize(("start", "stop"), [(0.8, 1.0), (1.0, 0.8)])
def test_branches_to_the_last_value_that_is_allowed_are_listed_once(
    start: float, stop: float
) -> None:
    """No coefficient of restitution is above one: the branches end there, and begin there."""
    load = (driven.Force((0,), (1.0,), 1.0),)

    def at(k: float) -> driven.Problem:
        wall = Constraint((0,), (1.0,), None, 0.5, k)
        system = System(ONE, ONE, (wall,), C=SymmetricMatrix.diagonal([0.1]))
        return driven.Problem(system, np.array([1.2]), load, outputs=OUTPUTS)

    problem = branches.Problem(at, start, stop, at(0.8).system, step=0.05)
    result = branches.solve(problem, branches.plan(problem))
    impacts = {
        int(branch): int(result.solution_impacts[result.solution_branch == branch].max())
        for branch in np.unique(result.solution_branch)
    }
    assert sorted(impacts.values()) == [0, 1, 1]  # two roots of one polynomial, and the response
    for branch in impacts:
        ends = result.solution_parameter[result.solution_branch == branch][[0, -1]]
        assert ends.tolist() == [start, stop]


def test_a_branch_of_three_periods_is_listed_once() -> None:
    """Whichever of its impacts is the first: three seeds are late by a period of the drive each."""
    oscillator = Oscillator(0.05, 1.0, 0.0, 0.8)
    wall = Constraint((0,), (1.0,), None, oscillator.gap, oscillator.k)
    system = System(ONE, ONE, (wall,), C=SymmetricMatrix.diagonal([2.0 * oscillator.d]))
    load = (driven.Force((0,), (1.0,), oscillator.a),)

    def at(Omega: float) -> driven.Problem:
        return driven.Problem(
            system, np.array([Omega]), load, 3, (driven.Impact(0),) * 3, outputs=OUTPUTS
        )

    problem = branches.Problem(at, 2.59, 2.61, system, frequency=True, step=0.2)
    result = branches.solve(problem, branches.plan(problem))
    middle = driven.solve(at(2.6), driven.plan(at(2.6)))
    found = []  # what every branch that passes 2.6 exchanges there, about
    for branch in np.unique(result.solution_branch[result.solution_impacts > 0]):
        mine = np.flatnonzero(result.solution_branch == branch)
        side = result.solution_parameter[mine] < 2.6
        rows = mine[:-1][side[:-1] != side[1:]]
        found += [np.sort(result.impact_momentum[result.impact_solution == row]) for row in rows]
    apart = np.abs(np.array(found)[:, np.newaxis] - found).max(axis=2)
    assert (apart[~np.eye(len(found), dtype=bool)] > 0.1).all()
    expected = [
        np.sort(middle.impact_momentum[middle.impact_solution == row])
        for row in np.flatnonzero(middle.solution_impacts)
    ]
    for momenta in expected:
        assert np.abs(momenta - found).max(axis=1).min() < 0.02
    assert len(found) >= len(expected) == 6  # the search from random starts may miss some


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


def test_the_frequency_of_the_drive_may_have_any_unit() -> None:
    wall = Constraint((0,), (1.0,), None, 0.0, 0.8)
    system = System(ONE, ONE, (wall,), C=SymmetricMatrix.diagonal([0.1]))
    load, turn = (driven.Force((0,), (1.0,), 1.0),), 2.0 * np.pi

    def results(unit: float) -> branches.Result:
        def at(value: float) -> driven.Problem:
            return driven.Problem(system, np.array([unit * value]), load, outputs=OUTPUTS)

        problem = branches.Problem(at, 2.6 / unit, 2.9 / unit, system, frequency=True)
        return branches.solve(problem, branches.plan(problem))

    radians, hertz = results(1.0), results(turn)
    assert hertz.solution_Omega == pytest.approx(radians.solution_Omega, rel=1e-9)
    assert turn * hertz.solution_parameter == pytest.approx(radians.solution_parameter, rel=1e-9)
    assert hertz.point_type.tolist() == radians.point_type.tolist()


def test_what_is_not_the_frequency_of_the_drive_is_refused() -> None:
    system = System(ONE, ONE, (Constraint.at(0, 1.0),), C=SymmetricMatrix.diagonal([0.1]))
    load = (driven.Force((0,), (1.0,), 1.0),)
    with pytest.raises(ModelError, match="not the frequency of the drive"):
        branches.Problem(
            lambda _: driven.Problem(system, np.array([2.0]), load), 1.0, 2.0, system,
            frequency=True,
        )  # fmt: skip


@pytest.mark.parametrize("smallest", [0.0, 0.0005, 0.1])
def test_impulses_that_are_like_the_load_end_no_branch(smallest: float) -> None:
    """At gap 0 motions are like their load, however small it is where branches begin."""
    wall = Constraint((0,), (1.0,), None, 0.0, 0.8)
    system = System(ONE, ONE, (wall,), C=SymmetricMatrix.diagonal([0.1]))

    def at(amplitude: float) -> driven.Problem:
        load = (driven.Force((0,), (1.0,), amplitude),)
        return driven.Problem(system, np.array([2.7]), load, outputs=OUTPUTS)

    problem = branches.Problem(at, smallest, 10.0, system, step=0.1)
    result = branches.solve(problem, branches.plan(problem))
    assert set(result.solution_branch) == {0, 1, 2}  # of two motions, and without impacts
    for branch in range(2):
        rows = np.flatnonzero(result.solution_branch == branch)
        load, pushed = result.solution_parameter[rows], result.impact_momentum[rows]
        ends = sorted(load[[0, -1]])
        assert ends == pytest.approx([max(smallest, ends[0]), 10.0])
        assert ends[0] < 0.1 * 10.0  # less than a step; how much less, processors differ in
        assert np.abs(np.diff(load)).max() < 1.001 * 0.1 * (10.0 - smallest)
        assert pushed / load == pytest.approx(pushed[0] / load[0], rel=1e-9)


@pytest.mark.parametrize("symmetric", [False, True])
def test_branches_that_begin_without_load(symmetric: bool) -> None:
    """At amplitude 0 the motion may begin at any time, elsewhere it may not."""
    wall = Constraint((0,), (1.0,), 1.0 if symmetric else None, 1.0)
    system = System(ONE, ONE, (wall,))
    sequence = driven.SYMMETRIC if symmetric else (driven.Impact(0),)

    def at(amplitude: float) -> driven.Problem:
        load = (driven.Force((0,), (1.0,), amplitude),)
        return driven.Problem(system, np.array([1.3]), load, sequence=sequence, outputs=OUTPUTS)

    results = []
    for start, stop in ((0.0, 0.5), (0.5, 0.0)):
        problem = branches.Problem(at, start, stop, system, points=60)
        results.append(branches.solve(problem, branches.plan(problem)))
    for result in results:
        touches = result.point_parameter[result.point_type == branches.Type.GRAZING]
        assert touches == pytest.approx([])


def test_impacts_on_both_sides_of_a_free_body_cancel() -> None:
    wall = Constraint((0,), (1.0,), 0.5, 0.5, 0.8)
    free = System(ONE, SymmetricMatrix.diagonal([0.0]), (wall,))
    load, both = (driven.Force((0,), (1.0,), 1.0),), (driven.Impact(0), driven.Impact(0, -1))
    problem = branches.Problem(
        lambda Omega: driven.Problem(free, np.array([Omega]), load, sequence=both),
        0.5, 0.6, free, frequency=True, step=0.2,
    )  # fmt: skip
    result = branches.solve(problem, branches.plan(problem))
    momenta = result.impact_momentum.reshape(-1, 2)
    assert momenta.shape[0] > 4
    assert momenta[:, 0] == pytest.approx(momenta[:, 1], rel=1e-9)


def test_impacts_on_both_sides_of_a_body_that_damping_couples_are_refused() -> None:
    wall = Constraint((0,), (1.0,), 0.5, 0.5, 0.8)
    K = SymmetricMatrix.dense(np.array([[1.0, -1.0], [-1.0, 1.0]]))
    C = SymmetricMatrix.diagonal([0.1, 0.0])
    free = System(SymmetricMatrix.diagonal([1.0, 1.0]), K, (wall,), C=C)
    load, both = (driven.Force((0,), (1.0,), 1.0),), (driven.Impact(0), driven.Impact(0, -1))
    problem = branches.Problem(
        lambda Omega: driven.Problem(free, np.array([Omega]), load, sequence=both),
        0.5, 0.6, free, frequency=True,
    )  # fmt: skip
    with pytest.raises(ModelError, match="rigid-body") as caught:
        branches.solve(problem, branches.plan(problem))
    assert caught.value.pointer == ("base", "sequence")


@pytest.mark.parametrize(("coupled", "count"), [(True, 2), (False, 0)])
def test_a_resonance_among_the_points_of_the_linear_branch(coupled: bool, count: int) -> None:
    """The wall is touched on both sides of it, where the mode moves the limited coordinate."""
    system = System(
        SymmetricMatrix.diagonal(np.ones(2)), SymmetricMatrix.diagonal(np.array([9.0, 1.0])),
        (Constraint((1 if coupled else 0,), (1.0,), None, 2.0),),
    )  # fmt: skip
    load = (driven.Force((1,), (1.0,), 1.0),)

    def at(Omega: float) -> driven.Problem:
        outputs = frozenset({"exists"})
        return driven.Problem(system, np.array([Omega]), load, outputs=outputs)

    problem = branches.Problem(at, 0.5, 1.5, system, frequency=True, points=3)
    result = branches.solve(problem, branches.plan(problem))
    linear = result.solution_impacts == 0
    assert (result.solution_reason[linear & (result.solution_Omega == 1.0)] == 4).all()
    touches = result.point_parameter[result.point_type == branches.Type.GRAZING]
    expected = np.sqrt([0.5, 1.5])[:count]
    assert np.sort(touches) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("ends", [(1e-6, 10.0), (10.0, 1e-6)])
def test_a_branch_along_which_all_is_like_the_load(ends: tuple[float, float]) -> None:
    """With gap 0 motions are like their load, over seven orders of magnitude."""
    system = System(
        ONE, ONE, (Constraint((0,), (1.0,), None, 0.0, 0.8),), C=SymmetricMatrix.diagonal([0.1])
    )

    def at(size: float) -> driven.Problem:
        load = (driven.Force((0,), (1.0,), size),)
        outputs = frozenset({"exists"})
        return driven.Problem(system, np.array([0.8]), load, outputs=outputs)

    problem = branches.Problem(at, *ends, system)
    result = branches.solve(problem, branches.plan(problem))
    struck = np.flatnonzero(result.solution_impacts == 1)
    assert set(result.solution_branch[struck]) == {0, 1}
    assert struck.size < 250
    for branch in (0, 1):
        rows = struck[result.solution_branch[struck] == branch]
        sizes = result.solution_parameter[rows]
        assert sizes[[0, -1]] == pytest.approx(ends, rel=1e-6)
        momentum = np.abs(result.impact_momentum[np.isin(result.impact_solution, rows)])
        assert momentum / sizes == pytest.approx(momentum[-1] / sizes[-1], rel=1e-9)


def test_a_constant_load_that_impacts_do_not_balance_is_one_of_the_base() -> None:
    wall = Constraint((0,), (1.0,), None, 0.5, 0.8)
    K = SymmetricMatrix.dense(np.array([[1.0, -1.0], [-1.0, 1.0]]))
    C = SymmetricMatrix.diagonal([0.3, 0.1])
    masses = SymmetricMatrix.diagonal([1.0, 1.0])
    pushed = System(masses, K, (wall,), C=C, force=np.array([1.0, 0.5]))
    load = (driven.Force((0,), (1.0,), 1.0),)
    problem = branches.Problem(
        lambda Omega: driven.Problem(pushed, np.array([Omega]), load), 1.0, 1.2, pushed,
        frequency=True,
    )  # fmt: skip
    with pytest.raises(PlanError, match="constant load") as caught:
        branches.solve(problem, branches.plan(problem))
    assert caught.value.pointer == ("base", "system", "C")
