"""Rigid-body modes under constant loads, such as a ball on a vibrating table.

The ball with one impact per period is known in closed form, in the frame of the table: the impulse
is ``m g T``, and ``cos(phi) = (g T / 2) (1 - k) / (1 + k) / (A Omega)``. All else is compared with
free motions from impact to impact in 30 digits.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mpmath as mp
import numpy as np
import pytest

from tests.reference.falling import Falling
from vibroimpact_solvers import attractors, branches
from vibroimpact_solvers import periodic_motions as driven
from vibroimpact_solvers.errors import PlanError
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.results.impact_modes import Reason

EVERY = frozenset(driven.OUTPUTS)
TAU = np.linspace(0.0, 1.0, 7)


@pytest.fixture(autouse=True)
def digits() -> Iterator[None]:
    with mp.workdps(30):
        yield


def solved(problem: driven.Problem) -> driven.Result:
    return driven.solve(problem, driven.plan(problem))


def system(M: Any, K: Any, C: Any, force: Any, w: Any, k: float) -> System:
    """Return a structure above a wall at zero."""
    dense = SymmetricMatrix.dense
    wall = Constraint(tuple(range(len(w))), tuple(w), 0.0, None, k)
    damping = dense(np.asarray(C)) if np.any(C) else None
    return System(dense(np.asarray(M)), dense(np.asarray(K)), (wall,), damping, np.asarray(force))


def ball(k: float = 0.6, g: float = 9.81, m: float = 1.0, c: float = 0.0) -> System:
    return system([[m]], [[0.0]], [[c]], [-m * g], [1.0], k)


def on_table(a: float, Omega: float, of: System, **options: Any) -> driven.Problem:
    """Return the problem of a ball over a table ``-a cos(Omega t)`` high, seen from the table."""
    m = float(of.M.to_dense()[0, 0])
    load = (driven.Force((0,), (1.0,), -m * a * Omega**2),)
    sequence = options.pop("sequence", (driven.Impact(0, -1),))
    return driven.Problem(of, np.array([Omega]), load, sequence=sequence, **options)


@pytest.mark.parametrize("m", [1.0, 0.3])
def test_a_ball_on_a_vibrating_table(m: float) -> None:
    A, Omega, k, g = 0.012, 30.0, 0.6, 9.81
    result = solved(on_table(A, Omega, ball(m=m), outputs=EVERY, tau=TAU))
    assert result.impact_momentum == pytest.approx([2.0546016 * m] * 2, rel=1e-7)
    assert result.impact_velocity == pytest.approx([-1.2841260] * 2, rel=1e-7)
    T = 2.0 * np.pi / Omega
    cosine = 0.5 * g * T * (1.0 - k) / (1.0 + k) / (A * Omega)
    # The table is fastest upwards a quarter of a period after its lowest place.
    assert np.sin(result.impact_phase) == pytest.approx([cosine] * 2, abs=1e-14)
    assert result.solution_impacts.tolist() == [1, 1]  # none without impacts
    assert result.solution_exists.all()
    assert result.solution_certified.all()
    assert result.multipliers_real is not None
    products = (result.multipliers_real + 1j * result.multipliers_imaginary).prod(axis=1)
    assert products == pytest.approx([k * k] * 2, abs=1e-12)
    work, lost = result.solution_work, result.solution_energy_lost
    assert work is not None
    assert lost is not None
    assert lost == pytest.approx([0.5 * m * (1.0 - k * k) * 1.2841260**2] * 2, rel=1e-6)
    assert (np.abs(work - lost) <= result.error_work + result.error_energy_lost).all()
    assert result.solution_x_min == pytest.approx(np.zeros((2, 1)), abs=1e-15)


@pytest.mark.parametrize(
    ("a", "stability"), [(1.05, "stable"), (1.3, "stable"), (1.52, "stable"), (1.535, "unstable")]
)
def test_one_of_two_motions_is_stable_between_fold_and_flip(a: float, stability: str) -> None:
    result = solved(on_table(a, 1.0, ball(0.5, 1.0), outputs=frozenset({"exists", "stability"})))
    assert result.solution_stability is not None
    assert sorted(result.solution_stability < 1.0) == [False, stability == "stable"]


def test_a_slow_table_does_not_throw_the_ball_high_enough() -> None:
    assert solved(on_table(1.04, 1.0, ball(0.5, 1.0))).solution_impacts.size == 0
    assert solved(on_table(1.05, 1.0, ball(0.5, 1.0))).solution_impacts.size == 2


def test_the_branch_of_the_ball_has_its_fold_and_its_flip() -> None:
    """At a = pi/3 and 1.52682: the one by its formula, the other by the trace of the map."""
    of = ball(0.5, 1.0)

    def at(a: float) -> driven.Problem:
        return on_table(a, 1.0, of, outputs=frozenset({"exists", "stability"}))

    problem = branches.Problem(at, 1.0, 1.6, of, step=0.1)
    result = branches.solve(problem, branches.plan(problem))
    kinds = {
        kind: result.point_parameter[(result.point_type == kind) & result.point_exists]
        for kind in (branches.Type.FOLD, branches.Type.FLIP)
    }
    assert kinds[branches.Type.FOLD] == pytest.approx([np.pi / 3.0], abs=1e-9)
    # The trace of the map is -(1 + k^2) there.
    k, g = 0.5, 1.0
    steep = 2.0 * (1.0 + k * k) * g / (1.0 + k) ** 2
    expected = np.hypot(np.pi / 3.0, steep)
    assert expected == pytest.approx(1.52682, abs=1e-5)
    assert kinds[branches.Type.FLIP] == pytest.approx([expected], abs=1e-9)
    assert np.unique(result.solution_branch).size == 1  # and none without impacts
    assert result.solution_impacts.tolist() == [1] * result.solution_impacts.size


def two_masses(c: float, ground: float) -> tuple[Any, ...]:
    """Return two masses above each other, joined by a spring and a damper; the lower one strikes.

    The ground takes velocity in proportion to the mass, so that modes stay uncoupled.
    """
    M, K = np.diag([1.0, 2.0]), 40.0 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return M, K, c * K + ground * M, np.array([-9.81, -2.0 * 9.81])


@pytest.mark.parametrize(("c", "ground"), [(0.0, 0.0), (0.01, 0.0), (0.01, 0.4), (0.0, 0.4)])
@pytest.mark.parametrize(("n", "impacts"), [(1, 1), (1, 2), (2, 2)])
def test_structures_that_fall(c: float, ground: float, n: int, impacts: int) -> None:
    M, K, C, force = two_masses(c, ground)
    Omega, k, drive = 25.0, 0.6, np.array([40.0, 10.0])
    of = system(M, K, C, force, [1.0, 0.0], k)
    load = (driven.Force((0, 1), tuple(drive), 1.0),)
    result = solved(
        driven.Problem(of, np.array([Omega]), load, n, (driven.Impact(0, -1),) * impacts,
                       outputs=EVERY, tau=TAU)
    )  # fmt: skip
    reference = Falling(M, K, C, force, drive, Omega, [1.0, 0.0], k)
    period = 2.0 * np.pi * n / Omega
    for row in range(result.solution_impacts.size):
        mine = result.impact_solution == row
        check(reference, result, row, result.impact_time[mine], period)
        momenta = result.impact_momentum[mine]
        assert momenta.sum() == pytest.approx(9.81 * M.trace() * period, rel=1e-12)
    if impacts == 1:
        assert result.solution_impacts.size == 2


def check(
    reference: Falling, result: driven.Result, row: int, told: np.ndarray, period: float
) -> None:
    """Compare one solution with its free motions."""
    mine = result.impact_solution == row
    times = told + period * np.concatenate([[0], np.cumsum(np.diff(told) < 0.0)])
    momenta = result.impact_momentum[mine]
    z = reference.periodic(times, momenta, period)
    assert abs(float(reference.place(z))) < 1e-10
    tau = np.mod(TAU * period - times[0], period)
    assert result.waveform is not None
    if len(times) == 1:
        for part, shape in zip(tau[1:-1], result.waveform[row, 1:-1], strict=True):
            there = reference.moved(z, times[0], part)
            x = [float(there[j]) for j in range(reference.n)]
            assert shape == pytest.approx(x, abs=1e-10)
    if (momenta < 0.0).any():
        assert result.solution_reason is not None
        assert result.solution_reason[row] == Reason.NEGATIVE_IMPULSE
        return
    after, struck, least = reference.followed(z, times, period)
    assert [float(t) for t in struck[:-1]] == pytest.approx(list(times[1:]), abs=1e-9)
    assert float(max(abs(each) for each in after - z)) < 1e-8
    assert result.solution_exists is not None
    if result.solution_exists[row]:
        assert least > 0.0
    elif least > 0.0:
        assert not result.solution_certified[row]
    expected = reference.multipliers(z, times, period)
    given = result.multipliers_real[row] + 1j * result.multipliers_imaginary[row]
    errors = result.error_multipliers_real[row]
    scale = np.abs(expected).max()
    for value, error in zip(given, errors, strict=True):
        assert np.abs(expected - value).min() <= error + 1e-7 * scale
        assert error < 1e-6 * scale
    work, lost = result.solution_work[row], result.solution_energy_lost[row]
    assert abs(work - lost) <= result.error_work[row] + result.error_energy_lost[row] + 1e-13


def test_impacts_of_two_coordinates_share_the_weight() -> None:
    """A beam on two stops: two rigid-body modes, both balanced, and one alone is refused."""
    M, K = np.diag([1.0, 1.0, 1.0]), 300.0 * np.outer([1.0, -2.0, 1.0], [1.0, -2.0, 1.0])
    force = -9.81 * np.ones(3)
    dense = SymmetricMatrix.dense
    stops = tuple(Constraint((dof,), (1.0,), 0.0, None, 0.5) for dof in (0, 2))
    of = System(dense(M), dense(K), stops, dense(0.002 * K), force)
    load = (driven.Force((0, 1, 2), (25.0, 25.0, 25.0), 1.0),)
    both = (driven.Impact(0, -1), driven.Impact(1, -1))
    result = solved(
        driven.Problem(of, np.array([25.0]), load, sequence=both, outputs=EVERY, tau=TAU)
    )
    period = 2.0 * np.pi / 25.0
    for row in range(result.solution_impacts.size):
        momenta = result.impact_momentum[result.impact_solution == row]
        assert momenta == pytest.approx([1.5 * 9.81 * period] * 2, rel=1e-9)
        apart = abs(result.solution_work[row] - result.solution_energy_lost[row])
        assert apart <= result.error_work[row] + result.error_energy_lost[row] + 1e-12
    with pytest.raises(PlanError, match="no impact of the sequence pushes back") as caught:
        solved(driven.Problem(of, np.array([25.0]), load, sequence=both[:1]))
    assert caught.value.pointer == ("system", "force")


def test_damping_that_couples_a_falling_body_is_refused_by_its_name() -> None:
    M, K, _, force = two_masses(0.0, 0.0)
    of = system(M, K, np.diag([0.3, 0.0]), force, [1.0, 0.0], 0.6)
    load = (driven.Force((0,), (1.0,), 20.0),)
    with pytest.raises(PlanError, match="damping couples") as caught:
        solved(driven.Problem(of, np.array([25.0]), load, sequence=(driven.Impact(0, -1),)))
    assert caught.value.pointer == ("system", "C")


def test_a_stop_that_pulls_gives_phantoms() -> None:
    """Above the ball, it can only push it down, as the weight does."""
    of = ball()
    above = System(of.M, of.K, (Constraint((0,), (1.0,), None, 0.0, 0.6),), None, of.force)
    result = solved(on_table(0.012, 30.0, above, sequence=(driven.Impact(0, 1),)))
    assert result.solution_reason is not None
    assert (result.solution_reason == Reason.NEGATIVE_IMPULSE).all()


def test_without_loss_and_drive_the_ball_bounces_at_any_period() -> None:
    of = ball(1.0, 9.81)
    problem = driven.Problem(
        of, np.array([4.0, 9.0]), (), sequence=(driven.Impact(0, -1),), outputs=EVERY, tau=TAU
    )
    result = solved(problem)
    T = 2.0 * np.pi / np.array([4.0, 9.0])
    assert result.impact_momentum == pytest.approx(9.81 * T, rel=1e-14)
    assert result.solution_x_max[:, 0] == pytest.approx(9.81 * T**2 / 8.0, rel=1e-12)
    assert result.solution_exists.all()
    assert (
        solved(
            driven.Problem(ball(0.9), np.array([4.0]), (), sequence=(driven.Impact(0, -1),))
        ).solution_impacts.tolist()
        == []
    )


@pytest.mark.parametrize("c", [0.0, 0.2])
def test_motions_of_the_ball_settle_on_the_stable_one(c: float) -> None:
    A, Omega = 0.012, 30.0
    of = ball(c=c)
    load = on_table(A, Omega, of).load
    # Two near the stable motion; the last one bounces ever lower and rests for a while.
    x, v = np.array([[0.0707], [0.072], [0.05]]), np.array([[-0.26], [-0.25], [0.2]])
    problem = attractors.Problem(of, np.array([Omega]), x, v, load)
    result = attractors.solve(problem, attractors.plan(problem))
    (row,) = np.flatnonzero(result.attractor_impacts == 1)
    assert result.settled_attractor[:2].tolist() == [row, row]
    assert result.attractor_period[row] == 1
    assert result.attractor_nature[row] == attractors.Nature.PERIODIC
    assert result.attractor_verification is not None
    assert result.attractor_verification[row] == attractors.Verification.CONFIRMED
    exact = solved(on_table(A, Omega, of, outputs=frozenset({"exists", "stability"})))
    assert exact.solution_stability is not None
    stable = int(np.argmin(exact.solution_stability))
    assert result.impact_phase[result.impact_attractor == row] == pytest.approx(
        [exact.impact_phase[stable]], abs=1e-12
    )
    growth = np.log(exact.solution_stability[stable]) * Omega / (2.0 * np.pi)
    error = result.error_attractor_exponent[row]
    assert abs(result.attractor_exponent[row] - growth) <= error + 1e-6
