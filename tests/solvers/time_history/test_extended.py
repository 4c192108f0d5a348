"""Motions with more digits: against double precision, closed forms, and themselves with more."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

import flint
import mpmath as mp
import numpy as np
import pytest

from tests.solvers.time_history.contact_motion import DIGITS, ContactMotion
from tests.solvers.time_history.reference_motion import ReferenceMotion as Reference
from tests.solvers.time_history.reference_motion import Stop
from vibroimpact_solvers import presets
from vibroimpact_solvers import time_history as th
from vibroimpact_solvers.errors import ConvergenceError, ModelError, PlanError
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.plan import Plan, Stage
from vibroimpact_solvers.time_history import extended, solving
from vibroimpact_solvers.time_history.extended import precision
from vibroimpact_solvers.time_history.extended.motion import Motion
from vibroimpact_solvers.time_history.extended.solving import motion

ALL = frozenset(th.OUTPUTS)


def dense(rows: object) -> SymmetricMatrix:
    return SymmetricMatrix.dense(np.array(rows, dtype=float))


def problem(
    system: System, x: Sequence[float], v: Sequence[float], t_end: float, **other: object
) -> th.Problem:
    given: dict[str, object] = {"outputs": ALL, "t": np.linspace(0.0, t_end, 21)} | other
    state = th.State(np.array(x, dtype=float), np.array(v, dtype=float))
    return th.Problem(system, state, t_end, **given)  # type: ignore[arg-type]


def followed(asked: th.Problem, digits: int) -> Motion:
    with precision.working(digits):
        return motion(asked)


def chaotic(t_end: float, **other: object) -> th.Problem:
    """The chain of twelve masses with two limiters, from a random state."""
    system = presets.chain(12, [Constraint.at(4, 0.2, 0.9), Constraint.at(8, 0.2, 0.9)])
    rng = np.random.default_rng(0)
    x, v = 0.05 * rng.standard_normal(12), rng.standard_normal(12)
    return problem(system, x.tolist(), v.tolist(), t_end, **other)


def distance(a: Motion, b: Motion) -> float:
    """Return the largest difference of impact times and of the final states."""
    assert [(i.constraint, i.side) for i in a.impacts] == [
        (i.constraint, i.side) for i in b.impacts
    ]
    with precision.working(300):
        times = [abs(i.time - j.time) for i, j in zip(a.impacts, b.impacts, strict=True)]
        states = [
            abs(x - y)
            for one, other in zip(a.state(), b.state(), strict=True)
            for x, y in zip(one, other, strict=True)
        ]
        return float(max(times + states).mid())


@pytest.mark.needs("compiled kernels")
def test_the_chaotic_case_converges_with_digits() -> None:
    """t = 200 is far beyond what doubles can tell; each run is right to what it states."""
    asked = chaotic(200.0)
    double = solving.solve(asked, th.plan(asked))
    assert double.error_predictable_until < 120.0
    runs = {digits: followed(asked, digits) for digits in (30, 40, 60)}
    size = 5.0  # of rates and coordinates
    assert len(runs[60].impacts) > 250
    for digits in (30, 40):
        stated = runs[digits].condition
        assert stated < 1e-9
        assert distance(runs[digits], runs[60]) < size * stated
    assert distance(runs[40], runs[60]) < 1e-9 * distance(runs[30], runs[60])
    # Doubles were right for as long as they said.
    assert double.impact_time is not None
    assert double.impact_condition is not None
    right = np.flatnonzero(double.impact_time < double.error_predictable_until)
    for i in right:
        error = abs(double.impact_time[i] - float(runs[60].impacts[i].time.mid()))
        assert error <= 4.0 * size * 2.0**-52 * double.impact_condition[i] + 1e-14
    assert right.size > 100


@pytest.mark.needs("compiled kernels")
def test_digits_are_used_where_doubles_do_not_hold() -> None:
    short = chaotic(20.0, digits=30)
    found = th.solve(short, th.plan(short))
    assert found.error_digits is None
    assert found.error_predictable_until == 20.0
    long = chaotic(150.0, digits=40)
    plan = th.plan(long)
    step = plan.step(Stage.FREE_MOTION)
    assert step is not None
    assert "again with 40 decimal digits" in step.reason
    found = th.solve(long, plan)
    assert found.error_digits == 40
    assert found.error_predictable_until == 150.0
    assert found.error_condition * 2.0**-52 < 1e-12
    assert "40 decimal digits" in found.error_statement
    few = chaotic(180.0, digits=17, tolerance=1e-13)
    predictable = th.solve(few, th.plan(few)).error_predictable_until
    assert solving.solve(few, plan_of_doubles(few)).error_predictable_until < predictable < 180.0


def plan_of_doubles(asked: th.Problem) -> Plan:
    return th.plan(replace(asked, digits=None))


STOPS = (Constraint((0,), (1.0,), None, 0.05, 0.0), Constraint((1,), (1.0,), 0.1, 0.5, 0.6))
LOAD = (th.Harmonic(0, 0.6, 0.5), th.Harmonic(1, -0.5, 0.35, 0.4))
K = dense([[2.0, -1.0], [-1.0, 2.0]])
SYSTEMS = {
    "undamped": System(dense(np.eye(2)), K, STOPS),
    "modal damping": System(dense(np.eye(2)), K, STOPS, C=dense([[0.2, -0.1], [-0.1, 0.2]])),
    "overdamped": System(dense(np.eye(2)), K, STOPS, C=dense([[5.0, -1.0], [-1.0, 5.0]])),
    "unstable": System(dense(np.eye(2)), dense([[2.0, -1.0], [-1.0, -0.1]]), STOPS),
    "masses": System(dense([[2.0, 0.3], [0.3, 1.0]]), K, STOPS, force=np.array([0.02, -0.01])),
    "free": System(
        dense(np.diag([1.0, 2.0])),
        dense([[1.0, -1.0], [-1.0, 1.0]]),
        (Constraint((0,), (1.0,), None, 0.05, 0.6), Constraint((0, 1), (1.0, -1.0), None, 0.9)),
        force=np.array([0.3, 0.1]),
    ),
}  # fmt: skip


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("name", SYSTEMS)
def test_doubles_agree_within_their_error(name: str) -> None:
    """Impacts, chatter, contacts, their forces and releases, with loads of all sorts."""
    system = SYSTEMS[name]
    asked = problem(system, [0, 0], [0.2, 0.0], 20.0, load=LOAD, digits=35, tolerance=1e-15)
    double = solving.solve(asked, plan_of_doubles(asked))
    exact = extended.solve(asked, 35, 1e-6)
    assert exact.error_digits == 35
    assert exact.count_impacts > 3
    assert exact.contact_rest is not None
    assert exact.contact_rest.size > 1
    bound = max(1e-12, 8.0 * 2.0**-52 * double.error_condition)
    # A chatter that doubles sum is shorter than 1e-8; what it sums is not listed.
    for column in ("rest", "stop", "constraint", "side", "impulse"):
        ours, theirs = (getattr(r, f"contact_{column}") for r in (exact, double))
        np.testing.assert_allclose(theirs, ours, rtol=0.0, atol=max(bound, 1e-9), err_msg=column)
    for field in ("x", "v", "energy"):
        ours, theirs = getattr(exact, field), getattr(double, field)
        np.testing.assert_allclose(theirs, ours, rtol=0.0, atol=4.0 * bound, err_msg=field)


def test_an_independent_motion_in_extended_precision_agrees_to_thirty_digits() -> None:
    """`reference_motion` scans and bisects in mpmath with first-order eigenvalues."""
    system = presets.chain(
        3, [Constraint.at(0, 0.15, 0.8), Constraint((1, 2), (1.0, -1.0), 0.2, 0.3)]
    )
    x, v = [0.05, -0.02, 0.01], [0.9, -0.4, 0.3]
    run = followed(problem(system, x, v, 6.0), 40)
    stops = [Stop([1, 0, 0], 0.15, 0.15, 0.8), Stop([0, 1, -1], 0.2, 0.3, 1.0)]
    reference = Reference(system.M.to_dense().tolist(), system.K.to_dense().tolist(), stops).follow(
        x, v, 6.0, 0.02
    )[0]
    assert len(reference) == len(run.impacts) > 8
    for (time, index, side, speed), mine in zip(reference, run.impacts, strict=True):
        assert (mine.constraint, mine.side) == (index, side)
        with precision.working(60), mp.workdps(60):
            assert abs(mp.mpf(mine.time.str(50, radius=False)) - time) < mp.mpf(10) ** -28
            assert abs(mp.mpf(mine.velocity.str(50, radius=False)) - speed) < mp.mpf(10) ** -28


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("digits", [25, 60, 150])
def test_a_ball_comes_to_rest_where_its_series_ends(digits: int) -> None:
    """t = (1 + k)/(1 - k) sqrt(2 h/g), with k and g as the doubles that were given."""
    ball = presets.bouncing_ball([Constraint((0,), (1.0,), 0.0, None, 0.5)])
    run = followed(problem(ball, [1.0], [0.0], 3.0), digits)
    (rest,) = run.contacts.intervals
    with precision.working(2 * digits):
        g = flint.arb(9.81)
        exact = 3 * (2 / g).sqrt()
        assert abs(rest.rest - exact) < flint.arb(10) ** (1 - digits)
        assert abs(rest.impulse - g * (3 - rest.rest)) < flint.arb(10) ** (1 - digits)
    assert run.state()[0][0] == 0


def test_energy_of_elastic_impacts_is_kept_to_all_digits() -> None:
    system = presets.chain(5, [Constraint.at(2, 0.2), Constraint.at(4, 0.3)])
    asked = problem(system, [0.0] * 5, [1.0, 0.4, -0.3, 0.7, 0.2], 40.0)
    result = extended.solve(asked, 50, 1e-6)
    assert result.count_impacts > 20
    assert result.error_energy_drift is not None
    assert result.error_energy_drift < 1e-50


def test_a_symmetric_pair_strikes_together_to_all_digits() -> None:
    system = presets.chain(7, [Constraint.at(1, 0.2, 0.8), Constraint.at(5, 0.2, 0.8)])
    v = [0.3, 0.9, -0.2, 0.5, -0.2, 0.9, 0.3]
    run = followed(problem(system, [0.0] * 7, v, 10.0), 40)
    assert len(run.impacts) >= 4
    for one, other in zip(run.impacts[0::2], run.impacts[1::2], strict=True):
        assert one.time.mid() == other.time.mid()
        assert {one.constraint, other.constraint} == {0, 1}


def test_impacts_far_below_the_rounding_of_doubles_are_found() -> None:
    """x^2 + v^2 = 1 + excess: the wall at 1 is passed by half of that, or missed by it."""
    v = 0.8
    places = [0.6 + k * 2.0**-53 for k in range(-40, 40)]
    excess = {Fraction(x) ** 2 + Fraction(v) ** 2 - 1: x for x in places}
    above, below = min(e for e in excess if e > 0), max(e for e in excess if e < 0)
    assert above < Fraction(2) ** -52
    system = presets.oscillator([Constraint.at(0, 1.0)], 1.0)
    hit = followed(problem(system, [excess[above]], [v], 2.0), 60)
    assert len(hit.impacts) == 1
    with precision.working(80):
        speed = (flint.arb(above.numerator) / flint.arb(above.denominator)).sqrt()
        assert abs(hit.impacts[0].velocity - speed) < flint.arb(10) ** -55
    missed = followed(problem(system, [excess[below]], [v], 2.0), 60)
    assert not missed.impacts
    assert missed.grazings == 0


def enclosed(asked: th.Problem, digits: int, dt: float = 0.01) -> int:
    """Compare the end of a motion with an independent motion; return the number of impacts."""
    assert isinstance(asked.initial, th.State)
    run = followed(asked, digits)
    with precision.working(DIGITS):
        x, v, impacts = ContactMotion(asked.system, asked.load).follow(
            asked.initial.x.tolist(), asked.initial.v.tolist(), asked.t_end, dt
        )
        mine = run.state()
        for ball, value in zip((*mine[0], *mine[1]), (*x, *v), strict=True):
            # Its own error is below 1e-38.
            assert precision.within(ball, flint.arb(1e-38)).contains(value.mid()), (ball, value)
    return len(impacts)


def test_the_other_wall_is_not_left_with_the_first() -> None:
    """An impact at one wall says nothing of the other: 0.1.0 went through it."""
    one = System(dense([[1.0]]), dense([[1.0]]), STOPS_AT_1, force=np.array([-3.0]))
    asked = problem(one, [0.0], [6.0], 1.0, digits=30, tolerance=1e-15)
    result = th.solve(asked, th.plan(asked))
    assert result.x is not None
    assert result.x[-1, 0] == pytest.approx(0.13525798301210204, abs=1e-15)
    assert result.error_condition * 2.0**-52 < 1e-28
    assert enclosed(asked, 30) == 3
    assert enclosed(problem(one, [0.0], [6.0], 10.0), 30) == 30


STOPS_AT_1 = (Constraint.at(0, 1.0),)
ONE = dense([[1.0]])
DAMPED = (Constraint.at(0, 0.3, 0.6),)
FORMER_REFUSALS = {
    "coupled damping": (
        System(dense(np.eye(2)), K, STOPS[1:], C=dense([[0.2, -0.1], [-0.1, 0.3]])), (), [1.0, 0.9],
    ),
    "critical damping": (System(ONE, ONE, DAMPED, C=dense([[2.0]])), (), [2.0]),
    "resonance": (System(ONE, ONE, DAMPED), (th.Harmonic(0, 1.0, 1.0),), [0.1]),
}  # fmt: skip


@pytest.mark.parametrize("name", FORMER_REFUSALS)
def test_no_modes_are_needed(name: str) -> None:
    system, load, v = FORMER_REFUSALS[name]
    assert enclosed(problem(system, [0.0] * system.n, v, 5.0, load=load), 30) >= 1


def random_motion(seed: int) -> th.Problem:
    """Return a motion of any kind: walls, restitution, damping, loads, coordinates."""
    rng = np.random.default_rng(seed)
    n = int(rng.choice([1, 1, 2, 2, 3, 4]))
    B, D, H = rng.standard_normal((3, n, n))
    M = np.diag(rng.uniform(0.5, 2.0, n)) if rng.random() < 0.6 else 0.3 * B @ B.T + np.eye(n)
    stiff = D @ D.T + 0.3 * np.eye(n) * (rng.random() < 0.8)
    C = None
    if (kind := rng.random()) < 0.35:
        C = dense(0.1 * H @ H.T if kind < 0.25 else 0.05 * M + 0.02 * stiff)
    stops = []
    for dof in rng.permutation(n)[: 1 if n == 1 else int(rng.choice([1, 1, 2]))].tolist():
        k = float(rng.choice([0.0, 1.0, 1.0, 0.8, 0.5, rng.random()]))
        gap = float(rng.choice([0.5, 0.2, 0.01, 0.05]) * rng.uniform(0.5, 1.5))
        single = n == 1 or bool(stops) or rng.random() < 0.7
        dofs, weights = ((dof,), (1.0,)) if single else ((dof, (dof + 1) % n), (1.0, -1.0))
        lower = None if rng.random() < 0.3 else gap * rng.uniform(0.5, 1.5)
        stops.append(Constraint(dofs, weights, lower, gap, k))
    force = 0.3 * rng.standard_normal(n) if rng.random() < 0.5 else None
    load = tuple(
        th.Harmonic(int(rng.integers(n)), float(rng.standard_normal()),
                    float(rng.uniform(0.3, 3.0)), float(rng.uniform(0.0, 6.0)))
        for _ in range(int(rng.choice([0, 0, 1, 2])))
    )  # fmt: skip
    system = System(dense(M), dense(0.5 * (stiff + stiff.T)), tuple(stops), C=C, force=force)
    v = rng.standard_normal(n).tolist()
    return problem(system, [0.0] * n, v, float(rng.uniform(2.0, 8.0)), load=load)


# Other seeds were compared by the hundreds; these have contacts, chatter and many impacts.
@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("seed", [1, 4, 6, 8, 11, 20, 28, 37, 38, 41])
@pytest.mark.parametrize("digits", [-2, 30])
def test_random_motions_are_enclosed(seed: int, digits: int) -> None:
    """Where eighteen digits do not tell what happens they say so, and never anything wrong."""
    with contextlib.suppress(*((PlanError,) if digits < 0 else ())):
        enclosed(random_motion(seed), digits, 0.02)


def test_what_cannot_be_is_refused_with_a_reason() -> None:
    tilted = (Constraint((0,), (1.0,), None, 1.0), Constraint((0, 1), (0.6, 0.8), None, 1.0))
    corner = System(dense(np.eye(2)), dense(np.zeros((2, 2))), tilted)
    with pytest.raises(PlanError, match="in which order constraints 0 and 1 strike"):
        extended.solve(problem(corner, [0, 0], [1, 0.5], 2.0), 30, 1e-6)
    # The digits tell an order that doubles do not.
    v = 0.5 + 64 * 2.0**-53
    result = extended.solve(problem(corner, [0, 0], [1, v], 2.0), 30, 1e-6)
    assert result.x is not None
    np.testing.assert_allclose(result.x[-1], [0.8, -0.6], atol=1e-13)
    pair = (Constraint((0,), (1.0,), None, 0.05, 0.0), Constraint((0, 1), (1.0, -1.0), 0.2, 0.3))
    free = System(SYSTEMS["free"].M, SYSTEMS["free"].K, pair, force=SYSTEMS["free"].force)
    with pytest.raises(ConvergenceError, match="accumulate"):
        extended.solve(problem(free, [0, 0], [0.2, 0], 20.0, load=LOAD), 20, 1e-6)


def test_a_touch_that_no_digits_decide_is_enclosed() -> None:
    """cos t touches its wall at 1 each turn; it may strike with the root of the rounding."""
    system = presets.oscillator([Constraint.at(0, 1.0)], 1.0)
    run = followed(problem(system, [1.0], [0.0], 4.0), 40)
    assert (run.grazings, len(run.impacts)) == (1, 0)
    with precision.working(60):
        (x,), _ = run.state()
        assert (x - flint.arb(4).cos()).contains(0)
        assert 1e-40 < float(x.rad()) < 1e-25


@pytest.mark.parametrize(
    ("other", "code"),
    [
        ({"digits": 16}, "out_of_range"),
        ({"digits": 1001}, "out_of_range"),
        ({"digits": 30, "limiter": th.Power(17.0, 1.0)}, "not_possible"),
        ({"digits": 30, "method": "RK45"}, "not_possible"),
        ({"digits": 30, "initial": th.ImpactMode(1.3)}, "not_possible"),
    ],
)
def test_wrong_digits_are_refused(other: dict[str, object], code: str) -> None:
    oscillator = presets.oscillator([Constraint.at(0, 1.0)], 1.0)
    given: dict[str, object] = {"initial": th.State(np.zeros(1), np.ones(1))} | other
    with pytest.raises(ModelError) as caught:
        th.Problem(oscillator, t_end=1.0, **given)  # type: ignore[arg-type]
    assert (caught.value.pointer, caught.value.code) == (("digits",), code)


@pytest.mark.needs("compiled kernels")
def test_two_threads_may_ask_for_different_digits() -> None:
    asked = chaotic(12.0)
    alone = {digits: followed(asked, digits) for digits in (25, 60)}
    found: dict[int, Motion] = {}

    def run(digits: int) -> None:
        found[digits] = followed(asked, digits)

    threads = [threading.Thread(target=run, args=(digits,)) for digits in alone]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for digits, one in alone.items():
        times = [[i.time.mid() for i in run.impacts] for run in (one, found[digits])]
        assert times[0] == times[1]
