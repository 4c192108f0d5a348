"""Errors of impacts by the errors of states, against paths in extended precision."""

from __future__ import annotations

import math
from typing import Any

import mpmath
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.kernels.output_errors import (
    CONVERTED,
    impact_errors,
    passage,
    state_errors,
)
from vibroimpact_solvers.kernels.rigid_state import IMPACT

SIZES = st.floats(1e-12, 1e6)
REACH = np.array([[0.5], [2.0], [3.0], [0.25], [1e-16], [1.5]])
"""Of one constraint, as `impact_errors` takes it."""
TOLERANCE = 1e-6


@settings(deadline=None)  # the first call compiles
@given(off=SIZES, speed=SIZES, bend=st.just(0.0) | SIZES)
def test_a_passage_is_late_by_the_way_back_on_a_parabola(
    off: float, speed: float, bend: float
) -> None:
    with mpmath.workdps(60):
        o, v, b = (mpmath.mpf(number) for number in (off, speed, bend))
        left = v * v - 2 * b * o
        late = passage(off, speed, bend)
        if abs(left) <= 1e-10 * v * v:
            return  # rounding decides whether it passes
        if left < 0:
            assert late == math.inf
            return
        # The first time at which v t - b t^2 / 2 = o.
        first = o / v if b == 0 else (v - mpmath.sqrt(left)) / b
        assert abs(late - first) <= 1e-9 * first


def test_what_stands_still_may_not_pass() -> None:
    assert passage(0.0, 0.0, 1.0) == math.inf
    assert passage(math.nan, 1.0, 1.0) == math.inf


def impacts(times: Floats, velocities: Floats, before: Floats) -> Any:
    rows = np.zeros(times.size, IMPACT)
    rows["time"], rows["velocity"], rows["before"] = times, velocities, before
    rows["impulse"], rows["acceleration"] = 1.2 * np.abs(velocities), 0.4
    return rows


def errors(rows: Any, counts: list[int], *motions: list[float]) -> Floats:
    out = np.empty((3, rows.size))
    impact_errors(
        rows, np.array(counts), tuple(map(np.array, motions)), TOLERANCE, REACH, 2.0, tuple(out)
    )
    return out


def test_errors_of_an_impact_hold_for_all_paths_within_the_error_of_its_state() -> None:
    rows = impacts(np.array([1.0]), np.array([0.7]), np.array([1e6]))
    time, velocity, impulse = errors(rows, [1], [1.0], [np.inf], [1e-12])[:, 0]
    known = EPS * (1e6 + CONVERTED)
    # What the place and the speed are off, and the acceleration of the coordinate.
    off, slow = known * 0.5 + 1e-16 + 2e-12, known * 2.0
    for angle, a in np.random.default_rng(5).uniform(-1.0, 1.0, (200, 2)):
        # An error of the state is long but once, in its displacements or in its velocities.
        o, dv = math.cos(math.pi * angle), math.sin(math.pi * angle)
        with mpmath.workdps(40):
            speed, acceleration = mpmath.mpf(0.7) + slow * dv, mpmath.mpf(0.4) * a
            late = off * o / speed  # and better: y = o off is passed with the acceleration
            for _ in range(5):
                late = (off * o - acceleration * late**2 / 2) / speed
            assert abs(late) <= time
            assert abs(slow * dv + acceleration * late) <= velocity
    assert time <= 2.0 * (off / 0.7 + EPS)
    assert velocity <= 2.0 * (slow + 0.4 * off / 0.7)
    # By mass and restitution, or by what the impulse is of the velocity, whichever is more.
    assert impulse == 1.5 * velocity


def test_impacts_of_many_motions_have_the_errors_that_they_have_alone() -> None:
    rng = np.random.default_rng(6)
    counts, largest, until = [3, 0, 4], [1.0, 2.0, 5.0], [np.inf, 1.0, 2.0]
    gaps = [1e-12, 0.0, 1e-9]
    rows = impacts(rng.uniform(0.0, 4.0, 7), rng.normal(size=7), 10.0 ** rng.uniform(0, 9, 7))
    together, first = errors(rows, counts, largest, until, gaps), 0
    for m, count in enumerate(counts):
        some = slice(first, first + count)
        alone = errors(rows[some], [count], [largest[m]], [until[m]], [gaps[m]])
        np.testing.assert_array_equal(together[:, some], alone)
        first += count
    assert np.isinf(together[:, rows["time"] >= np.repeat(until, counts)]).all()


def test_of_an_impact_that_may_be_missing_the_time_is_unknown() -> None:
    rows = impacts(np.array([1.0]), np.array([1e-9]), np.array([1e9]))
    time, velocity, _ = errors(rows, [1], [1.0], [np.inf], [0.0])[:, 0]
    assert time == np.inf
    assert 1e-9 < velocity < 1e-2


def test_states_are_known_to_the_tolerance_until_their_horizon() -> None:
    lengths, times = np.array([[10.0, 1e12, 1e12], [10.0, 1e12, np.nan]]), np.array([0.0, 1.0, 2.0])
    out, largest = np.empty((2, 3)), np.array([4.0, 1.0])
    state_errors(lengths, times, largest, np.array([2.0, np.inf]), TOLERANCE, out)
    rounding = CONVERTED * EPS * largest
    np.testing.assert_array_equal(
        out[0], [10.0 * EPS + rounding[0], TOLERANCE * 4.0 + rounding[0], np.inf]
    )
    np.testing.assert_array_equal(
        out[1], [10.0 * EPS + rounding[1], 1e12 * EPS + rounding[1], np.nan]
    )
