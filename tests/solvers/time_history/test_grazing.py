"""Impacts that rounding decides: grazings, starts at walls, and the order of coupled impacts."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest

from tests.truth import histories
from vibroimpact_solvers import time_history as th
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

EPS = 2.0**-52


def solve(system: System, x: object, v: object, t: Floats, **fields: object) -> th.Result:
    state = th.State(np.array(x, dtype=np.float64), np.array(v, dtype=np.float64))
    outputs = frozenset(th.OUTPUTS)
    problem = th.Problem(
        system,
        state,
        float(t[-1]),
        t=t,
        outputs=outputs,
        **fields,  # type: ignore[arg-type]
    )
    return th.solve(problem, th.plan(problem))


def oscillator(
    *stops: Constraint, force: float = 0.0, M: float = 1.0, K: float = 1.0, C: float = 0.0
) -> System:
    matrices = [SymmetricMatrix.diagonal([a]) for a in (M, K)]
    damping = SymmetricMatrix.diagonal([C]) if C else None
    return System(*matrices, stops, C=damping, force=np.array([force]))


def test_a_grazing_is_not_passed_over_on_the_way_to_the_other_wall() -> None:
    """One expansion reaches from near the upper wall, where it turns, to the lower wall."""
    place, speed = 0.7608197869684813, 3.683970846746504e-09
    document = {
        "M": [[1.9279881888603048]], "K": [[0.3246779369543683]],
        "constraints": [{"dofs": [0], "weights": [1.0], "lower": place, "upper": place,
                         "restitution": 1.0}],
        "force": [-0.15897536516134872], "x": [place], "v": [speed], "t": [11.6], "t_end": 51.3,
    }  # fmt: skip
    histories.checked(document)


@pytest.mark.parametrize("ulps", [-3, -1, 0, 1, 2, 40, 4000])
def test_the_impulse_of_a_grazing_is_the_root_of_rounding(ulps: int) -> None:
    """x = v sin t touches the wall 1 or strikes it, with the speed (v^2 - 1)^(1/2)."""
    v = 1.0 + (ulps if ulps > 0 else 0.5 * ulps) * EPS
    t = np.linspace(0.0, 10.0, 101)
    result = solve(oscillator(Constraint.at(0, 1.0)), [0.0], [v], t)
    assert result.x is not None
    assert result.v is not None
    with mp.workdps(40):
        speed = mp.mpf(v)
        # Between walls, the time from one to the other; the motion is its own mirror image.
        half = mp.asin(1 / speed) if speed > 1 else mp.pi / 2
        x, w = [], []
        for time in t:
            turns = mp.floor((mp.mpf(time) + half) / (2 * half))
            s = mp.mpf(time) - 2 * half * turns
            sign = (-1) ** int(turns)
            x.append(float(sign * speed * mp.sin(s)))
            w.append(float(sign * speed * mp.cos(s)))
    known = t < result.error_predictable_until
    assert known[t < 2.0].all()
    tolerance = result.error_tolerance if not known.all() else EPS * result.error_condition
    error = np.hypot(result.x[:, 0] - x, result.v[:, 0] - w)[known].max()
    assert error <= tolerance * v
    # Nothing within a million roundings of the wall is lost.
    assert ulps < 4000 or EPS * result.error_condition < 1e-7


def test_a_slow_start_from_a_wall_is_known_to_the_root_of_rounding() -> None:
    """Pressed with the acceleration 1 it returns after 2 v, again and again."""
    system = oscillator(Constraint((0,), (1.0,), None, 1.0), force=2.0)
    speed = 2e-8
    t = np.linspace(0.0, 1e-6, 8)
    result = solve(system, [1.0], [-speed], t)
    assert result.v is not None
    true = -speed + (t % (2.0 * speed))
    error = np.abs(result.v[:, 0] - true).max() / math.sqrt(1.0)
    assert error <= EPS * result.error_condition * 2.0


@pytest.mark.parametrize("offset", [0, 1, 64, 4096, 2**30])
def test_coupled_limiters_struck_at_one_time_are_predictable_until_then(offset: int) -> None:
    """x0 <= 1 and .6 x0 + .8 x1 <= 1: a particle in a wedge, whose walls it strikes in an order."""
    stops = (
        Constraint((0,), (1.0,), None, 1.0),
        Constraint((0, 1), (0.6, 0.8), None, 1.0),
    )
    system = System(*(SymmetricMatrix.diagonal(a) for a in ([1.0, 1.0], [0.0, 0.0])), stops)
    v = np.array([1.0, 0.5 + offset * 2.0**-53])
    result = solve(system, [0.0, 0.0], v, np.array([0.5, 2.0]))
    assert result.x is not None
    until = result.error_predictable_until
    normals = np.array([[1.0, 0.0], [0.6, 0.8]])
    # In 60 digits: the next wall, and its mirror.
    with mp.workdps(60):
        x, w, time = mp.zeros(2, 1), mp.matrix(v), mp.mpf(0)
        while True:
            arrivals = []
            for n in normals:
                N = mp.matrix(n)
                towards = (N.T * w)[0]
                room = 1 - (N.T * x)[0]
                if towards > 0:
                    arrivals.append((room / towards, N))
            if not arrivals or time + min(a for a, _ in arrivals) > 2:
                break
            passing, N = min(arrivals, key=lambda a: a[0])
            x, time = x + passing * w, time + passing
            w = w - 2 * (N.T * w)[0] * N
        x = x + (2 - time) * w
    true = np.array([float(a) for a in x])
    error = np.abs(result.x[-1] - true).max()
    if offset >= 2**30:
        assert until == 2.0
    if until >= 2.0:
        assert error <= EPS * result.error_condition * np.linalg.norm(v)
    else:
        assert until == pytest.approx(1.0, abs=1e-12)
        assert offset < 2**20


@pytest.mark.parametrize("k", [1.0, 0.5])
def test_what_starts_pressed_to_its_wall_rests(k: float) -> None:
    """No impact of a velocity that is rounding, and no end of what is known."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        M, K = (a @ a.T + 2.0 * np.eye(2) for a in rng.normal(size=(2, 2, 2)))
        x = rng.uniform(0.1, 0.9, 2)
        stop = Constraint((0,), (1.0,), None, float(x[0]), k)
        force = K @ x + M @ np.array([rng.uniform(0.2, 2.0), 0.0])
        system = System(*(SymmetricMatrix.dense(a) for a in (M, K)), (stop,), force=force)
        result = solve(system, x, [0.0, 0.0], np.array([1e-3]))
        assert result.count_impacts == 0
        assert result.error_predictable_until == 1e-3
        np.testing.assert_allclose(result.contact_rest, [0.0], atol=1e-7)  # falls of 1e-16
        np.testing.assert_allclose(result.x[0, 0], x[0], rtol=1e-14)


def test_a_tolerance_that_no_later_impact_sees_the_end_of() -> None:
    """The phase of a long free motion: it is known as long as it is said to be."""
    system = oscillator(Constraint.at(0, 5.0), K=1.21)
    t = 10.0 ** np.arange(1, 19)
    result = solve(system, [0.0], [1.0], t)
    assert result.x is not None
    until = result.error_predictable_until
    assert 1e12 < until < 1e18
    with mp.workdps(60):
        w = mp.sqrt(mp.mpf(1.21))
        true = np.array([float(mp.sin(w * mp.mpf(s)) / w) for s in t])
    error = np.abs(result.x[:, 0] - true)
    assert (error[t <= until] <= 1e-6).all()
    assert result.count_impacts == 0
