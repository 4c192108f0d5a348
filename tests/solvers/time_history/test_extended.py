"""Motions with more digits: against double precision, closed forms, and themselves with more."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

import flint
import mpmath as mp
import numpy as np
import pytest

from tests.solvers.time_history.reference_motion import ReferenceMotion as Reference
from tests.solvers.time_history.reference_motion import Stop
from vibroimpact_solvers import presets
from vibroimpact_solvers import time_history as th
from vibroimpact_solvers.errors import ConvergenceError, ModelError, PlanError
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.plan import Plan, Stage
from vibroimpact_solvers.time_history import extended, solving
from vibroimpact_solvers.time_history.extended import configuration, precision
from vibroimpact_solvers.time_history.extended.free_motion import leaving_step, safe_step
from vibroimpact_solvers.time_history.extended.motion import Motion, _impulses
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
        return motion(asked, digits)


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


def test_the_chaotic_case_converges_with_digits() -> None:
    """t = 200 is far beyond what doubles can tell; each run is right to what it states."""
    asked = chaotic(200.0)
    double = solving.solve(asked, th.plan(asked))
    assert double.error_predictable_until < 120.0
    runs = {digits: followed(asked, digits) for digits in (30, 40, 60)}
    size = 5.0  # of rates and coordinates
    assert len(runs[60].impacts) > 250
    for digits in (30, 40):
        stated = runs[digits].deviations.condition * runs[digits].unit
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
    few = chaotic(150.0, digits=17, tolerance=1e-13)
    predictable = th.solve(few, th.plan(few)).error_predictable_until
    assert solving.solve(few, plan_of_doubles(few)).error_predictable_until < predictable < 150.0


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


@pytest.mark.parametrize("digits", [25, 60, 150])
def test_a_ball_comes_to_rest_where_its_series_ends(digits: int) -> None:
    """t = (1 + k)/(1 - k) sqrt(2 h/g), with k and g as the doubles that were given."""
    ball = presets.bouncing_ball([Constraint((0,), (1.0,), 0.0, None, 0.5)])
    run = followed(problem(ball, [1.0], [0.0], 3.0), digits)
    (rest,) = run.intervals
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
        assert one.time == other.time
        assert {one.constraint, other.constraint} == {0, 1}


def test_impulses_of_coupled_constraints_satisfy_the_laws() -> None:
    with precision.working(30):
        G = [[flint.arb(1), flint.arb("0.8")], [flint.arb("0.8"), flint.arb(1)]]
        half = [flint.arb("0.5")] * 2
        P = _impulses(G, [flint.arb(1), flint.arb("0.1")], half)
        assert [float(value) for value in P] == pytest.approx([1.5, 0.0])
        P = _impulses(G, [flint.arb(1), flint.arb(1)], half)
        left = [1 - sum(g * p for g, p in zip(row, P, strict=True)) for row in G]
        assert [float(value) for value in left] == pytest.approx([-0.5, -0.5])


def test_modes_of_equal_frequency_are_found_to_all_digits() -> None:
    """Two equal pendulums beside a third one: a double eigenvalue, and M that is not diagonal."""
    M = np.diag([2.0, 2.0, 1.0]) + 0.25
    K = 3.0 * M
    K[2, 2] += 1.0
    with precision.working(80):
        exact = [precision.exact(values) for values in (M, K)]
        values, rows = precision.modes(*exact, 80)
        E = precision.matrix(rows)
        gram = (E.transpose() * exact[0] * E).tolist()
        stiff = (E.transpose() * exact[1] * E).tolist()
        for i, j in itertools.product(range(3), repeat=2):
            assert abs(gram[i][j] - (i == j)) < flint.arb(10) ** -85
            assert abs(stiff[i][j] - (values[i] if i == j else 0)) < flint.arb(10) ** -84
        assert abs(values[0] - 3) < flint.arb(10) ** -84
        assert abs(values[1] - 3) < flint.arb(10) ** -84


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


@pytest.mark.parametrize(
    ("room", "slope", "bend", "bound"),
    [(1.0, 1.0, 1.0, 1.0), (1e-45, 1.0, -3.0, 2.0), (1e-30, 0.0, 1.0, 5.0), (0.3, 2.0, -9.0, 4.0),
     (0.3, -2.0, 5.0, 4.0), (1e-12, 1e-7, -1.0, 1.0), (2.0, 1.0, 0.0, 0.0)],
)  # fmt: skip
def test_steps_end_at_the_first_root_of_the_bound(
    room: float, slope: float, bend: float, bound: float
) -> None:
    step = safe_step(room, slope, bend, bound, 10.0)

    def left(h: mp.mpf) -> mp.mpf:
        return room - h * (slope + h * (mp.mpf(bend) / 2 + h * mp.mpf(bound) / 6))

    with mp.workdps(60):
        inside = [mp.mpf(step) * k / 4000 for k in range(4000)]
        assert all(left(h) > 0 for h in inside)
        assert step == 10.0 or left(mp.mpf(step) * (1 + mp.mpf(10) ** -12)) < 0


def test_a_coordinate_that_leaves_stays_away_for_a_while() -> None:
    step = leaving_step(-0.5, 3.0, 7.0, 10.0)
    assert -0.5 + 1.5 * step + 7.0 / 6.0 * step**2 == pytest.approx(0.0, abs=1e-12)
    assert leaving_step(0.0, -3.0, 7.0, 10.0) == pytest.approx(9.0 / 7.0)
    assert leaving_step(-1.0, 0.0, 0.0, 10.0) == 10.0


def test_what_cannot_be_is_refused_with_a_reason() -> None:
    coupled = System(dense(np.eye(2)), K, STOPS, C=dense([[0.2, -0.1], [-0.1, 0.3]]))
    with pytest.raises(PlanError, match="couples"):
        extended.solve(problem(coupled, [0, 0], [1, 0], 5.0), 30, 1e-6)
    critical = System(dense(np.eye(1)), dense([[1.0]]), STOPS[:1], C=dense([[2.0]]))
    with pytest.raises(PlanError, match="critically"):
        extended.solve(problem(critical, [0], [1], 5.0), 30, 1e-6)
    oscillator = presets.oscillator([Constraint.at(0, 1.0)], 1.0)
    driven = problem(oscillator, [0], [1], 5.0, load=(th.Harmonic(0, 1.0, 1.0),))
    with pytest.raises(PlanError, match="resonance"):
        extended.solve(driven, 30, 1e-6)
    pair = (Constraint((0,), (1.0,), None, 0.05, 0.0), Constraint((0, 1), (1.0, -1.0), 0.2, 0.3))
    free = System(SYSTEMS["free"].M, SYSTEMS["free"].K, pair, force=SYSTEMS["free"].force)
    with pytest.raises(ConvergenceError, match="accumulate"):
        extended.solve(problem(free, [0, 0], [0.2, 0], 20.0, load=LOAD), 20, 1e-6)


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
        assert [i.time for i in one.impacts] == [i.time for i in found[digits].impacts]
    assert configuration.Body(asked.system, (), 20).digits == 20
