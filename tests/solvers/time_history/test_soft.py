"""Soft limiters and the integrators that are there to compare with."""

from __future__ import annotations

import math
from typing import Any

import mpmath as mp
import numpy as np
import pytest
import scipy.integrate
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.truth import soft
from tests.truth.verdicts import Case, Report
from vibroimpact_solvers import presets
from vibroimpact_solvers import time_history as th
from vibroimpact_solvers.errors import ConvergenceError, ModelError
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

ALL = frozenset(th.OUTPUTS)
HISTORY = frozenset({"x", "v", "energy"})


def solve(problem: th.Problem) -> th.Result:
    return th.solve(problem, th.plan(problem))


@pytest.mark.needs("compiled kernels")
def test_period_of_a_soft_oscillator_against_quadrature() -> None:
    """x'' + x + b (x/s)^17 = 0 from rest: the period is a quadrature of the energy integral."""
    law = th.Power(17.0, 0.8, 0.97)
    gap, turn = 0.5, 0.52
    size = 0.97 * gap
    mp.mp.dps = 30

    def energy(x: mp.mpf) -> mp.mpf:
        return x**2 / 2 + mp.mpf("0.8") * size * (x / size) ** 18 / 18

    top = energy(mp.mpf(turn))
    # x = turn sin(a) takes the singularity at the turn away.
    quarter = mp.quad(
        lambda a: turn * mp.cos(a) / mp.sqrt(2 * (top - energy(turn * mp.sin(a)))),
        [0, mp.pi / 4, mp.pi / 2 - mp.mpf(10) ** -12],
    )
    period = float(4 * quarter)
    problem = th.Problem(
        presets.oscillator([Constraint.at(0, gap)], 1.0),
        th.State(np.array([turn]), np.zeros(1)),
        5.0 * period,
        t=period * np.array([0.0, 0.25, 0.5, 1.0, 5.0]),
        outputs=ALL,
        limiter=law,
        tolerance=1e-11,
    )
    result = solve(problem)
    assert result.x is not None
    np.testing.assert_allclose(result.x[:, 0], [turn, 0, -turn, turn, turn], rtol=0, atol=2e-10)
    assert result.error_energy_drift is not None
    assert result.error_energy_drift < 1e-11
    assert result.error_difference is not None
    assert result.error_difference < 32e-11
    assert result.count_impacts == 0
    np.testing.assert_allclose(result.error_penetration, turn / size, rtol=1e-12)


@pytest.mark.needs("compiled kernels")
def test_soft_limiters_of_a_damped_driven_chain_against_an_integrator() -> None:
    system = presets.chain(5, [Constraint.at(1, 0.2), Constraint((3,), (1.0,), 0.3, None)])
    v = np.array([0.4, 0.9, -0.3, 0.5, 0.1])
    common = {
        "system": system,
        "initial": th.State(np.zeros(5), v),
        "t_end": 30.0,
        "t": np.linspace(0.0, 30.0, 16),
        "outputs": HISTORY,
        "load": (th.Harmonic(0, 0.3, 0.8, 0.1),),
        "limiter": th.Power(7.0, 2.0, 1.0),
    }
    ours = solve(th.Problem(**common, tolerance=1e-11))  # type: ignore[arg-type]
    theirs = solve(th.Problem(**common, tolerance=1e-12, method="DOP853"))  # type: ignore[arg-type]
    assert ours.x is not None
    assert theirs.x is not None
    assert ours.v is not None
    np.testing.assert_allclose(ours.x, theirs.x, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(ours.v, theirs.v, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(ours.energy, theirs.energy, rtol=0.0, atol=1e-8)
    assert ours.error_energy_drift is None


def test_the_integrator_and_the_exact_motion_agree_where_nothing_is_missed() -> None:
    system = presets.two_mass([Constraint.at(0, 0.5, 0.9)], 1.0, 0.4, 0.02)
    common = {
        "system": system,
        "initial": th.State(np.array([0.1, 0.0]), np.array([1.5, -0.4])),
        "t_end": 12.0,
        "t": np.linspace(0.0, 12.0, 13),
        "outputs": ALL,
    }
    ours = solve(th.Problem(**common))  # type: ignore[arg-type]
    theirs = solve(th.Problem(**common, method="DOP853", tolerance=1e-12))  # type: ignore[arg-type]
    assert ours.count_impacts == theirs.count_impacts > 3
    np.testing.assert_allclose(ours.x, theirs.x, rtol=0.0, atol=1e-8)  # type: ignore[arg-type]
    np.testing.assert_allclose(ours.impact_time, theirs.impact_time, rtol=1e-9)  # type: ignore[arg-type]
    np.testing.assert_allclose(ours.impact_impulse, theirs.impact_impulse, rtol=1e-8)  # type: ignore[arg-type]
    assert "miss" in theirs.error_statement


@pytest.mark.parametrize(
    ("limiter", "gap", "field"),
    [
        (th.Power(0.5, 1.0), 0.2, ("limiter", "exponent")),
        (th.Power(17.0, 0.0), 0.2, ("limiter", "stiffness")),
        (th.Power(17.0, 1.0, math.nan), 0.2, ("limiter", "scale")),
        (th.Power(17.0, 1.0), -0.2, ("system", "constraints", 0, "gap")),
    ],
)
def test_faults_of_soft_limiters(
    limiter: th.Power, gap: float, field: tuple[str | int, ...]
) -> None:
    system = presets.oscillator([Constraint((0,), (1.0,), 0.5, gap)], 1.0)
    with pytest.raises(ModelError) as caught:
        th.Problem(system, th.State(np.zeros(1), np.ones(1)), 1.0, limiter=limiter)
    assert caught.value.pointer == field


def test_plans_say_what_is_left_out() -> None:
    system = presets.chain(3, [Constraint.at(0, 0.1), Constraint.at(2, 5.0)])
    problem = th.Problem(system, th.State(np.zeros(3), np.array([0.3, 0.0, 0.0])), 5.0)
    plan = th.plan(problem)
    what = {skip.what for skip in plan.skips}
    assert {"constraint 1", "x", "v", "energy", "contacts"} <= what
    assert "constraint 0" not in what
    result = solve(problem)
    assert result.x is None
    assert result.contact_start is None
    assert result.impact_constraint is not None
    assert set(result.impact_constraint.tolist()) == {0}


@pytest.mark.parametrize("x", [1e12, 1e50])
def test_limiters_that_are_too_stiff_to_be_followed_are_refused(x: float) -> None:
    system = presets.oscillator([Constraint((0,), (1.0,), 1.0, 1.0)], 1.0)
    law = th.Power(17.0, 1.0)
    state = th.State(np.array([x]), np.zeros(1))
    problem = th.Problem(system, state, 10.0, limiter=law)
    with pytest.raises(ConvergenceError, match="stiff"):
        th.solve(problem, th.plan(problem))


def random_case(seed: int, exponent: float) -> dict[str, Any]:
    """Return a random structure, damped and driven in many ways, with limiters of all kinds."""
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 6))
    A, B, D = random.standard_normal((3, n, n))
    M = SymmetricMatrix.dense(B @ B.T / n + np.eye(n))
    K = SymmetricMatrix.dense(A @ A.T + 0.3 * np.eye(n))
    C = [None, SymmetricMatrix.dense(0.05 * np.eye(n)), SymmetricMatrix.dense(0.1 * D @ D.T)]
    limits = []
    for dof in random.permutation(n)[:2].tolist():
        a, b = random.uniform(0.1, 0.5, 2).tolist()
        low, high = [(a, a), (a, b), (None, b), (a, None)][int(random.integers(4))]
        limits.append(Constraint((dof,), (1.0,), low, high))
    load = th.Harmonic(0, float(random.uniform(0.0, 1.0)), float(random.uniform(0.3, 3.0)), 0.3)
    return {
        "system": System(M, K, tuple(limits), C=C[int(random.integers(3))]),
        "initial": th.State(0.02 * random.standard_normal(n), random.standard_normal(n)),
        "load": (load,) if random.integers(2) else (),
        "limiter": th.Power(exponent, float(random.uniform(0.5, 5.0)), 0.9),
        "t_end": 6.0,
        "t": np.linspace(0.0, 6.0, 13),
        "outputs": HISTORY,
    }


def states(result: th.Result) -> np.ndarray:
    assert result.x is not None
    assert result.v is not None
    return np.hstack([result.x, result.v])


EXPONENTS = st.sampled_from([1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 7.0, 8.0, 17.0, 17.3, 64.0, 65.0, 80.0])


@pytest.mark.needs("compiled kernels")
@settings(deadline=None, max_examples=15, derandomize=True)  # the integrator fails now and then
@given(st.integers(0, 10**6), EXPONENTS)
def test_random_scenes_against_an_integrator(seed: int, exponent: float) -> None:
    """All laws, whole and not, even and uneven; steps of DOP853 short enough for their kinks."""
    case = random_case(seed, exponent)
    ours, theirs = solve(th.Problem(**case, tolerance=1e-11)), independent(case)
    apart = np.abs(states(ours) - theirs).max() / np.abs(theirs).max()
    assert ours.error_difference is not None
    assert apart <= 1e-8 + 2.0 * ours.error_difference


def independent(case: dict[str, Any]) -> np.ndarray:
    """Return states by scipy from matrices, in steps that see every limiter."""
    system, law, start = case["system"], case["limiter"], case["initial"]
    n, W, sizes = system.n, system.directions(range(len(system.constraints))), law.sizes(system)
    M, K = system.M.to_dense(), system.K.to_dense()
    C = np.zeros((n, n)) if system.C is None else system.C.to_dense()

    def rate(t: float, z: np.ndarray) -> np.ndarray:
        force = -(K @ z[:n]) - C @ z[n:]
        for one in case["load"]:
            force[one.dof] += one.amplitude * math.cos(one.frequency * t + one.phase)
        for row, lower, upper in zip(W, *sizes, strict=True):
            y = float(row @ z[:n])
            depth = y / upper if y > 0.0 else -y / lower
            force -= math.copysign(law.stiffness * depth**law.exponent, y) * row
        return np.concatenate([z[n:], np.linalg.solve(M, force)])

    found: Any = scipy.integrate.solve_ivp(
        rate, (0.0, case["t_end"]), np.concatenate([start.x, start.v]), "DOP853",
        t_eval=case["t"], rtol=3e-14, atol=1e-14, max_step=0.01,
    )  # fmt: skip
    return np.asarray(found.y.T)


@pytest.mark.needs("compiled kernels")
def test_stated_errors_hold() -> None:
    """Stated differences are more than the errors, and within the tolerance.

    Roundings alone make more of some motions: then the finest steps say the same. Of a motion that
    is chaotic two runs may come near one another by chance, once in thousands.
    """
    rng, short = np.random.default_rng(0), 0
    for _ in range(400):
        exponent = rng.choice([1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 7.0, 8.0, 17.0, 17.3, 64.0, 80.0])
        tolerance = rng.choice([1e-1, 1e-3, 1e-6, 1e-9])
        case = random_case(int(rng.integers(10**6)), float(exponent))
        found = solve(th.Problem(**case, tolerance=float(tolerance)))
        best = solve(th.Problem(**case, tolerance=1e-15))
        error = np.abs(states(found) - states(best)).max() / np.abs(states(best)).max()
        assert found.error_difference is not None
        assert best.error_difference is not None
        short += error > 4.0 * (found.error_difference + best.error_difference)
        assert found.error_difference <= max(tolerance, 4.0 * best.error_difference)
        if found.error_difference <= tolerance:
            assert found.error_predictable_until == 6.0
        assert found.error_condition == pytest.approx(found.error_difference * 2.0**52)
    assert short <= 1


@pytest.mark.needs("compiled kernels")
def test_stated_errors_hold_where_roundings_make_them() -> None:
    """Limiters of exponent one on both sides are springs: the exponential of a matrix.

    The two runs of 0.1.0 differed by one sample of roundings, and left out those that both have.
    """
    rng = np.random.default_rng(0)
    for _ in range(60):
        n = int(rng.integers(1, 4))
        B = rng.standard_normal((n, n))
        M, K = np.diag(rng.uniform(0.5, 2.0, n)), B @ B.T + 0.3 * np.eye(n)
        gap, stiffness = float(rng.uniform(0.2, 1.0)), float(rng.uniform(0.5, 20.0))
        x, v, t_end = *rng.standard_normal((2, n)), float(rng.uniform(1.0, 20.0))
        result = solve(
            th.Problem(
                System(
                    SymmetricMatrix.dense(M), SymmetricMatrix.dense(K), (Constraint.at(0, gap),)
                ),
                th.State(x, v),
                t_end,
                t=np.array([t_end]),
                outputs=HISTORY,
                limiter=th.Power(1.0, stiffness, 1.0),
                tolerance=float(10.0 ** rng.uniform(-13.0, -11.0)),
            )
        )
        with mp.workdps(30):
            A, inverse = mp.zeros(2 * n), mp.matrix(M.tolist()) ** -1
            A[:n, n:] = mp.eye(n)
            stiff = mp.matrix(K.tolist())
            stiff[0, 0] += mp.mpf(stiffness) / mp.mpf(gap)
            A[n:, :n] = -inverse * stiff
            z = mp.expm(A * mp.mpf(t_end)) * mp.matrix([*x.tolist(), *v.tolist()])
            exact = np.array([float(value) for value in z])
        # Coordinates count by their frequency: the largest in the size of the state.
        fastest = math.sqrt(float(np.linalg.eigvals(doubles(inverse * stiff)).real.max()))
        weights = np.repeat([fastest, 1.0], n)
        size = float(np.abs(weights * exact).max())
        error = float((weights * np.abs(states(result)[0] - exact)).max())
        assert result.error_difference is not None
        assert error <= result.error_difference * size


SLIDING = {
    "M": [[2.8]], "K": [[0.0]], "C": [[0.028]], "force": [-1.04], "x": [0.16], "v": [-1.29],
    "constraints": [{"dofs": [0], "weights": [1.0], "lower": 2.01, "upper": 1.0,
                     "restitution": 1.0}],
    "load": [[0, 1.59, 0.784, 2.08], [0, -0.966, 1.25, 2.69]],
    "limiter": {"exponent": 7, "stiffness": 4.65, "scale": 1.0},
    "t": [2.59, 5.05, 8.56], "t_end": 8.95,
}  # fmt: skip
# All but free: at rest its first mode would be 4,000 times as far away as it moves.
ALMOST_FREE = {
    "M": np.eye(4).tolist(),
    "K": [[0.822265625, -0.822265625, 0.0, 0.0], [-0.822265625, 2.509765625, -1.6884765625, 0.0],
          [0.0, -1.6884765625, 2.0703125, -0.3818359375],
          [0.0, 0.0, -0.3818359375, 0.3818359375]],
    "C": [[0.0, 0.0, 0.0, 0.0], [0.0, 0.41, -0.41, 0.0], [0.0, -0.41, 0.41, 0.0],
          [0.0, 0.0, 0.0, 1.43]],
    "constraints": [{"dofs": [0], "weights": [1.0], "lower": 5.4, "upper": 0.737,
                     "restitution": 1.0},
                    {"dofs": [2], "weights": [1.0], "lower": 2.7, "upper": 1.0,
                     "restitution": 1.0}],
    "x": [0.134, -0.027, 0.003, -0.047], "v": [0.214, -0.457, -0.113, -1.388],
    "force": [1.51, -1.14, 0.425, 1.17], "load": [[3, 0.224, 1.58, -1.63]],
    "limiter": {"exponent": 1, "stiffness": 1.59, "scale": 1.0},
    "t": [5.73], "t_end": 11.2, "tolerance": 3.35e-9,
}  # fmt: skip


def assert_within_stated_errors(document: dict[str, Any]) -> None:
    """Compare a motion with the reference."""
    report = Report()
    soft.check(Case("", document), report)
    assert not report.failures
    assert report.ratios["x"]


@pytest.mark.parametrize("document", [SLIDING, ALMOST_FREE], ids=["sliding", "almost free"])
def test_stated_errors_are_relative_to_the_motion(document: dict[str, Any]) -> None:
    """They counted relative to where loads carry a structure, and to the loads' own size."""
    assert_within_stated_errors(document)


# Straight through the middle: of all coefficients of a force only that of order 17 is not zero.
THROUGH_THE_MIDDLE = {
    "M": [[1.3, 0.0], [0.0, 1.3]], "K": [[0.0, 0.0], [0.0, 0.0]],
    "constraints": [{"dofs": [0], "weights": [1.0], "lower": 1.0, "upper": 1.0, "restitution": 0.0},
                    {"dofs": [1], "weights": [1.0], "lower": None, "upper": 1.0,
                     "restitution": 1.0}],
    "x": [0.0, 0.0], "v": [-1.99, -0.56],
    "limiter": {"exponent": 17, "stiffness": 1.94, "scale": 1.0},
    "t": [0.3, 0.6, 5.6, 12.3], "t_end": 12.5, "tolerance": 1.3e-12,
}  # fmt: skip


@pytest.mark.needs("compiled kernels")
def test_steps_that_overflow_a_force_are_shortened() -> None:
    """Infinite at the end of a step, less its infinite rounding, it counted as one that agrees."""
    assert_within_stated_errors(THROUGH_THE_MIDDLE)


def test_a_side_without_limiter_has_no_force_however_far_away() -> None:
    """The 80th power of a distance of a million gaps is no number of double precision."""
    system = System(
        SymmetricMatrix.dense(np.eye(1)),
        SymmetricMatrix.dense(np.zeros((1, 1))),
        (Constraint((0,), (1.0,), None, 1e-3),),
    )
    found = solve(
        th.Problem(
            system, th.State(np.zeros(1), np.ones(1)), 1000.0, t=np.array([1.0, 1000.0]),
            outputs=HISTORY, limiter=th.Power(80.0, 1.0), tolerance=1e-9,
        )
    )  # fmt: skip
    assert found.v is not None
    assert found.x is not None
    np.testing.assert_allclose(found.v[:, 0], -1.0, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(found.x[1, 0] - found.x[0, 0], -999.0, rtol=1e-8)


# One mass between limiters, and one that neither feels them nor the other mass.
APART = {
    "M": [[1.0, 0.0], [0.0, 1.0]], "K": [[1.0, 0.0], [0.0, 1.3]],
    "constraints": [{"dofs": [0], "weights": [1.0], "lower": 0.5, "upper": 0.5,
                     "restitution": 1.0}],
    "x": [0.1, 0.3], "v": [1.0, 0.6],
    "limiter": {"exponent": 7, "stiffness": 5.0, "scale": 1.0},
    "t": [2.0, 4.4, 9.1], "t_end": 10.0, "tolerance": 1e-7,
}  # fmt: skip


@pytest.mark.needs("compiled kernels")
def test_each_output_has_the_error_of_its_own_difference() -> None:
    """What one coordinate is off was stated of all of them."""
    assert_within_stated_errors(APART)
    found = solve(
        th.Problem(
            System(
                SymmetricMatrix.dense(np.array(APART["M"])),
                SymmetricMatrix.dense(np.array(APART["K"])),
                (Constraint.at(0, 0.5),),
            ),
            th.State(np.array(APART["x"]), np.array(APART["v"])),
            10.0,
            t=np.array(APART["t"]),
            outputs=HISTORY,
            limiter=th.Power(7.0, 5.0),
            tolerance=1e-7,
        )
    )
    for error in (found.error_x, found.error_v):
        assert error is not None
        assert (error[:, 1] < 0.2 * error[:, 0]).all()


# From the middle on: forces have the coefficients 7, 14, ..., states 8, 15, ..., and series of the
# orders 13 and 14, which the two runs take, are one function, and so are their steps.
SAME_SERIES = {
    "M": [[1.3, 0.0], [0.0, 1.3]], "K": [[0.0, 0.0], [0.0, 0.0]],
    "constraints": [{"dofs": [0], "weights": [1.0], "lower": 1.0, "upper": 1.0,
                     "restitution": 0.0}],
    "x": [0.0, 0.0], "v": [-0.0956, 0.49],
    "limiter": {"exponent": 7, "stiffness": 0.27, "scale": 1.0},
    "t": [1.66, 2.32, 2.38], "t_end": 2.71,
}  # fmt: skip


# Steps that end where forces miss too much: those of both runs differ, as they should.
SHORTENED = {
    "M": [[1.3]], "K": [[0.0]], "x": [0.0], "v": [-1.396548115836537],
    "constraints": [{"dofs": [0], "weights": [1.0], "lower": 1.0, "upper": 1.0,
                     "restitution": 1.0}],
    "limiter": {"exponent": 17, "stiffness": 0.1312443968270634, "scale": 1.0},
    "t": [1.1246336665156578], "t_end": 5.913548015034807,
}  # fmt: skip


@pytest.mark.parametrize("document", [SAME_SERIES, SHORTENED], ids=["same", "shortened"])
def test_runs_of_the_same_series_do_not_hide_the_error(document: dict[str, Any]) -> None:
    """Their difference was nothing but roundings, 400 times less than the error."""
    assert_within_stated_errors(document)


def doubles(matrix: mp.matrix) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array(matrix.tolist(), dtype=np.float64)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-8, 1e-13])
def test_a_limiter_of_exponent_one_is_a_spring(tolerance: float) -> None:
    """On both sides of two masses: the exponential of a matrix, with 30 digits."""
    system = presets.two_mass([Constraint.at(0, 0.5)], 1.0)
    state, t = np.array([0.1, 0.0, 1.0, 0.4]), np.linspace(0.0, 20.0, 9)
    K = system.K.to_dense() + np.diag([3.0 / (0.8 * 0.5), 0.0])
    A = mp.matrix(np.block([[np.zeros((2, 2)), np.eye(2)], [-K, np.zeros((2, 2))]]).tolist())
    with mp.workdps(30):
        exact = [mp.expm(mp.mpf(one) * A) * mp.matrix(state.tolist()) for one in t.tolist()]
    expected = np.array([[float(a) for a in one] for one in exact])
    found = solve(
        th.Problem(
            system,
            th.State(state[:2], state[2:]),
            20.0,
            t=t,
            outputs=HISTORY,
            limiter=th.Power(1.0, 3.0, 0.8),
            tolerance=tolerance,
        )
    )
    np.testing.assert_allclose(states(found), expected, rtol=0.0, atol=3.0 * tolerance)


@pytest.mark.needs("compiled kernels")
def test_a_spring_on_one_side_has_two_half_periods() -> None:
    """x'' + x = 0 to the left and x'' + (1 + k) x = 0 to the right of zero, 200 changes of it."""
    stiffness = 8.0
    period = math.pi + math.pi / 3.0
    t = period * np.array([0.5 * math.pi / period, 1.0, 50.25, 100.0])
    t[2] = 50.0 * period + math.pi / 6.0
    system = presets.oscillator([Constraint((0,), (1.0,), None, 1.0)], 1.0)
    found = solve(
        th.Problem(
            system,
            th.State(np.zeros(1), np.array([-0.7])),
            100.0 * period,
            t=t,
            outputs=ALL,
            limiter=th.Power(1.0, stiffness),
            tolerance=1e-13,
        )
    )  # left for pi, then right for pi / 3
    assert found.x is not None
    np.testing.assert_allclose(found.x[[0, 1, 3], 0], [-0.7, 0.0, 0.0], atol=1e-12)
    assert found.v is not None
    np.testing.assert_allclose(found.v[[1, 3], 0], [-0.7, -0.7], atol=1e-12)
    assert found.error_penetration == pytest.approx(0.7 / 3.0, rel=1e-9)


@pytest.mark.needs("compiled kernels")
def test_the_energy_is_kept_for_long() -> None:
    """Two thousand contacts of two masses, at the least error of a step."""
    system = presets.two_mass([Constraint.at(0, 0.5)], 1.0)
    found = solve(
        th.Problem(
            system,
            th.State(np.zeros(2), np.array([1.0, 0.4])),
            2000.0,
            t=np.linspace(0.0, 2000.0, 501),
            outputs=HISTORY,
            limiter=th.Power(17.0, 1.0),
            tolerance=1e-14,
            estimate=False,
        )
    )
    assert found.error_energy_drift is not None
    assert found.error_energy_drift < 5e-13
    assert found.error_difference is None
    assert math.isnan(found.error_condition)


@pytest.mark.needs("compiled kernels")
def test_what_cannot_be_known_is_told() -> None:
    """A chaotic motion until double precision tells nothing: the statement says so, and when."""
    walls = [Constraint.at(4, 0.2), Constraint.at(8, 0.2)]
    v = np.random.default_rng(12).standard_normal(12)
    found = solve(
        th.Problem(
            presets.chain(12, walls),
            th.State(np.zeros(12), v),
            400.0,
            t=np.linspace(0.0, 400.0, 401),
            outputs=HISTORY,
            limiter=th.Power(17.0, 1.0),
        )
    )
    assert found.error_difference is not None
    assert found.error_difference > 0.1
    assert 30.0 < found.error_predictable_until < 399.0


@pytest.mark.parametrize("tolerance", [0.3, 1e-2])
def test_no_contact_is_missed_by_series_that_do_not_see_it(tolerance: float) -> None:
    """Midway between two contacts no coefficient of a short series shows the limiters."""
    system = presets.oscillator([Constraint.at(0, 1.0)], 0.01)
    found = solve(
        th.Problem(
            system,
            th.State(np.zeros(1), np.ones(1)),
            40.0,
            t=np.linspace(0.0, 40.0, 401),
            outputs=HISTORY,
            limiter=th.Power(33.0, 1.0),
            tolerance=tolerance,
            estimate=False,
        )
    )
    assert found.x is not None
    assert found.v is not None
    assert np.abs(found.x).max() < 1.3
    assert (np.abs(np.diff(np.sign(found.v[:, 0]))) > 0).sum() > 15


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("outputs", [{"x"}, {"v"}, {"impacts"}])
def test_prepared_motions_in_one_call_are_the_same(outputs: set[str]) -> None:
    system = presets.chain(6, [Constraint.at(1, 0.2), Constraint((3,), (1.0,), None, 0.3)])
    state = th.State(np.zeros(6), np.linspace(-0.5, 0.9, 6))
    common: dict[str, Any] = {
        "limiter": th.Power(9.0, 1.0), "tolerance": 1e-12, "dofs": np.array([4, 1]),
    }  # fmt: skip
    short = th.Problem(
        system, state, 20.0, t=np.array([0.0, 7.0, 20.0]), outputs=frozenset(outputs),
        estimate=False, **common,
    )  # fmt: skip
    motion = th.prepare(short, th.plan(short))
    told: list[tuple[int, int]] = []
    found = motion.solve(tick=lambda done, total: told.append((done, total)))
    assert told == [(1000, 1000)]
    whole = solve(th.Problem(system, state, 20.0, t=short.t, outputs=HISTORY, **common))
    for name in ("x", "v"):
        one = getattr(found, name)
        assert (one is None) == (name not in outputs)
        if one is not None:
            np.testing.assert_allclose(one, getattr(whole, name), rtol=0.0, atol=1e-10)
    assert found.error_penetration == pytest.approx(whole.error_penetration, rel=1e-9)
    assert found.error_difference is None
    with pytest.raises(ModelError):
        motion.solve(th.State(np.zeros(5), np.zeros(5)))
    with pytest.raises(ModelError):
        motion.solve(th.State(np.full(6, np.nan), np.zeros(6)))


@pytest.mark.needs("compiled kernels")
def test_long_motions_can_be_stopped() -> None:
    class StoppedError(Exception):
        pass

    def tick(done: int, total: int) -> None:
        assert 0 <= done <= total == 1000
        raise StoppedError

    system = presets.oscillator([Constraint.at(0, 0.2)], 1.0)
    problem = th.Problem(
        system, th.State(np.zeros(1), np.ones(1)), 1e7, limiter=th.Power(17.0, 1.0)
    )
    with pytest.raises(StoppedError):
        th.solve(problem, th.plan(problem), tick)


# Of twelve steps and of three: the longer ones of the other run err by a fortieth of what they may.
FEW_STEPS = {
    "M": [[1.3, 0.0], [0.0, 1.3]], "K": [[0.0, 0.0], [0.0, 0.0]],
    "constraints": [
        {"dofs": [0], "weights": [1.0], "lower": 8.317400015538169, "upper": 8.317400015538169,
         "restitution": 1.0},
        {"dofs": [1], "weights": [1.0], "lower": 6.603827054262645, "upper": 6.603827054262645,
         "restitution": 1.0},
    ],
    "x": [0.0, 0.0], "v": [-0.1817670222109115, 1.436725705795579],
    "limiter": {"exponent": 3, "stiffness": 0.4053492760909786, "scale": 0.651865942345699},
    "t": [10.499377012289845], "t_end": 10.559283389110789,
}  # fmt: skip
THREE_STEPS = {
    "M": [[0.879458222119686, 0.0], [0.0, 0.8847331324620975]],
    "K": [[1.7098453638083706, -1.7098453638083706], [-1.7098453638083706, 1.7098453638083706]],
    "C": [[0.2709845363808371, -0.17098453638083708], [-0.17098453638083708, 0.2709845363808371]],
    "constraints": [
        {"dofs": [0], "weights": [1.0], "lower": None, "upper": 8.22045042478344,
         "restitution": 1.0},
        {"dofs": [1, 0], "weights": [1.0, -1.0], "lower": None, "upper": 1.0, "restitution": 1.0},
    ],
    "force": [0.7852113574900392, 0.4073423016518279], "x": [0.0, 0.0],
    "v": [-0.6924787120358064, -0.16417264847380056],
    "limiter": {"exponent": 17, "stiffness": 0.8535420386905718, "scale": 1.0},
    "t": [1.030916673127939], "t_end": 1.0548392936630824,
}  # fmt: skip


@pytest.mark.parametrize("document", [FEW_STEPS, THREE_STEPS], ids=["twelve", "three"])
def test_few_steps_whose_longer_ones_happen_to_err_by_little(document: dict[str, Any]) -> None:
    assert_within_stated_errors(document)
