"""Histories of structures whose stops have a residual flexibility in series."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import scipy.linalg

from tests.reference.stopped_runge_kutta import StoppedMotion, at_rest
from vibroimpact_solvers import ensemble, time_history
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.flexibility import in_series
from vibroimpact_solvers.laws import Linear, Rigid
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

ALL = frozenset({"x", "v", "energy", "force", "contacts"})


def random_case(seed: int) -> tuple[System, Any, Any, Any]:
    """Return a structure with one to three stops, its flexibility, and an initial state."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 5))
    count = int(rng.integers(1, min(n, 3) + 1))
    spread = rng.normal(size=(2, n, n))
    M, K = spread[0] @ spread[0].T + n * np.eye(n), spread[1] @ spread[1].T + np.eye(n)
    stops = [
        Constraint(
            tuple(range(n)), tuple(rng.normal(size=n).tolist()),
            float(rng.uniform(-0.05, 0.3)) if rng.random() < 0.7 else None,
            float(rng.uniform(0.06, 0.3)), law=Linear(float(10.0 ** rng.uniform(0.0, 5.0))),
        )
        for _ in range(count)
    ]  # fmt: skip
    half = rng.normal(size=(count, int(rng.integers(1, count + 1))))
    delta = half @ half.T * 10.0 ** rng.uniform(-4.0, -1.0)
    C = SymmetricMatrix.dense(0.02 * K) if seed % 3 else None
    system = System(SymmetricMatrix.dense(M), SymmetricMatrix.dense(K), tuple(stops), C=C)
    return in_series(system, delta), delta, rng.normal(size=n) * 0.3, rng.normal(size=n)


def solved(system: System, x: Any, v: Any, times: Any, **more: Any) -> Any:
    problem = time_history.Problem(
        system, time_history.State(x, v), float(times[-1]), t=times, **({"outputs": ALL} | more)
    )
    return time_history.solve(problem, time_history.plan(problem))


def agrees(result: Any, reference: StoppedMotion, states: Any) -> float:
    """Check motion and contacts by the reference; return the error of that.

    By its tolerance and the growth of deviations.
    """
    own, n = 1e-11 * max(1.0, float(result.error_condition)), states.shape[1] // 2
    assert (np.abs(result.x - states[:, :n]) <= result.error_x + own).all()
    assert (np.abs(result.v - states[:, n:]) <= result.error_v + 1e2 * own).all()
    assert result.contact_start.size == len(reference.contacts)
    at = np.array([time for time, *_ in reference.contacts])
    order = np.argsort(result.contact_start, kind="stable")
    assert (np.abs(result.contact_start[order] - at) <= 1e-9 + 1e2 * own).all()
    return own


@pytest.mark.parametrize("seed", range(8))
def test_motions_are_those_of_a_runge_kutta_method(seed: int) -> None:
    """Of up to three stops that displace one another, begun within them, before and behind."""
    system, delta, x, v = random_case(seed)
    times, load = np.linspace(0.0, 3.0, 13), time_history.Harmonic(0, 1.0, 1.3, 0.4)
    first = np.eye(system.n)[0]
    reference = StoppedMotion(
        system, lambda t: first * math.cos(1.3 * t + 0.4), delta, [at_rest] * len(delta)
    )
    states = reference.follow(x, v, times)
    result = solved(system, x, v, times, load=(load,))
    own = agrees(result, reference, states)
    for k, t in enumerate(times):
        forces, _ = reference.forces(reference.consistent(t, states[k]), t, states[k])
        for a in range(len(delta)):
            true = forces.get((a, 1), 0.0) + forces.get((a, -1), 0.0)
            law: Any = system.constraints[a].law
            assert abs(result.force[k, a] - true) <= result.error_force[k, a] + law.stiffness * own


@pytest.mark.parametrize("seed", [0, 3, 6, 9])
def test_the_energy_of_the_flexibility_is_counted(seed: int) -> None:
    """Without damping and load it stays what it is, though contacts begin and end."""
    system, _, x, v = random_case(seed)
    result = solved(system, x, v, np.linspace(0.0, 6.0, 200))
    assert result.contact_start.size > 0
    assert (result.force.max(axis=1) > 0.0).any()
    drift = np.abs(result.energy - result.energy[0])
    assert (drift <= result.error_energy + result.error_energy[0]).all()
    assert drift.max() <= 1e-11 * result.energy[0]


def test_one_stop_is_a_softer_one() -> None:
    """1/k = 1/k_s + delta: the motion and the force of one spring, the indentation of two."""
    K, k, delta = np.array([[3.0, -1.0], [-1.0, 2.0]]), 400.0, 1.0 / 300.0
    M = SymmetricMatrix.diagonal([1.0, 2.0])
    x, v, times = np.array([0.0, 0.2]), np.array([1.0, -0.5]), np.linspace(0.0, 8.0, 33)
    results = []
    for stiffness, series in ((k, delta), (1.0 / (1.0 / k + delta), 0.0)):
        stop = Constraint((0,), (1.0,), 0.1, 0.05, law=Linear(stiffness))
        system = System(M, SymmetricMatrix.dense(K), (stop,))
        results.append(solved(in_series(system, [[series]]), x, v, times))
    one, other = results
    assert one.contact_start.size > 2
    assert (np.abs(one.x - other.x) <= one.error_x + other.error_x).all()
    assert (np.abs(one.force - other.force) <= one.error_force + other.error_force).all()
    np.testing.assert_allclose(one.energy, other.energy, rtol=1e-12)
    np.testing.assert_allclose(one.contact_indentation * k, one.contact_peak_force, rtol=1e-12)


def test_few_modes_and_the_flexibility_of_all_others_are_nearly_all_modes() -> None:
    """Exact at rest: a body that leans on two stops of a chain of which two modes are kept."""
    n, kept = 12, 2
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    squares, shapes = scipy.linalg.eigh(K)
    W = np.eye(n)[[4, 7]]
    force = np.zeros(n)
    rows = W @ shapes
    delta = W @ np.linalg.inv(K) @ W.T - (rows[:, :kept] / squares[:kept]) @ rows[:, :kept].T
    load = shapes[:, :kept] @ np.array([1.0, 0.3])  # a load that the kept modes carry
    force = shapes.T @ load
    walls = [0.3, 0.4]

    def model(count: int, series: Any) -> System:
        stops = [
            Constraint(
                tuple(range(count)), tuple(row[:count].tolist()), None, wall, law=Linear(5.0)
            )
            for row, wall in zip(rows, walls, strict=True)
        ]
        system = System(
            SymmetricMatrix.diagonal(np.ones(count)), SymmetricMatrix.diagonal(squares[:count]),
            tuple(stops), C=SymmetricMatrix.diagonal(0.5 * np.sqrt(squares[:count])),
            force=force[:count],
        )  # fmt: skip
        return in_series(system, series)

    times = np.linspace(0.0, 400.0, 3)
    whole = solved(model(n, np.zeros((2, 2))), np.zeros(n), np.zeros(n), times)
    few = solved(model(kept, delta), np.zeros(kept), np.zeros(kept), times)
    without = solved(model(kept, np.zeros((2, 2))), np.zeros(kept), np.zeros(kept), times)
    assert (whole.force[-1] > 0.1).all()
    assert np.abs(few.force[-1] - whole.force[-1]).max() < 1e-10
    assert np.abs(without.force[-1] - whole.force[-1]).max() > 0.1


def test_ensembles_have_them() -> None:
    system, _, x, v = random_case(4)
    times = np.linspace(0.0, 3.0, 7)
    outputs = frozenset({"x"})
    many = ensemble.Problem(
        system, np.stack([x, 0.5 * x]), np.stack([v, v]), 3.0, times, outputs=outputs
    )
    result = ensemble.solve(many, ensemble.plan(many))
    for k, start in enumerate((x, 0.5 * x)):
        alone = solved(system, start, v, times, outputs=outputs)
        np.testing.assert_array_equal(result.x[k], alone.x)


@pytest.mark.parametrize(
    ("law", "given", "pointer", "words"),
    [
        (Linear(3.0), [[1.0, 0.5], [0.4, 1.0]], "residual_flexibility", "symmetric"),
        (Linear(3.0), [[1.0, 2.0], [2.0, 1.0]], "residual_flexibility", "semidefinite"),
        (Linear(3.0), [[1.0]], "residual_flexibility", "each of the 2"),
        (Linear(3.0), [[math.inf, 0.0], [0.0, 0.0]], "residual_flexibility", "infinite"),
        (Linear(3.0, 0.1), np.eye(2), "constraints", "without damping"),
        (Linear(3.0, restitution=0.5), np.eye(2), "constraints", "without damping"),
        (Rigid(0.5), np.eye(2), "constraints", "1/delta"),
    ],
)
def test_what_is_not_possible_is_refused(law: Any, given: Any, pointer: str, words: str) -> None:
    stops = tuple(Constraint((i,), (1.0,), None, 1.0, law=law) for i in range(2))
    one = SymmetricMatrix.diagonal([1.0, 1.0])
    with pytest.raises(ModelError, match=words) as refused:
        in_series(System(one, one, stops), given)
    assert refused.value.pointer[0] == pointer


def test_a_damped_stop_may_stand_beside() -> None:
    """Where its own row is zero nothing is in series with it."""
    stops = tuple(
        Constraint((i,), (1.0,), 0.1, 0.1, law=law)
        for i, law in enumerate((Linear(90.0), Linear(50.0, 2.0)))
    )
    K = SymmetricMatrix.dense([[2.0, -1.0], [-1.0, 3.0]])
    delta = np.diag([0.02, 0.0])
    system = in_series(System(SymmetricMatrix.diagonal([1.0, 1.0]), K, stops), delta)
    x, v, times = np.zeros(2), np.array([1.0, 0.7]), np.linspace(0.0, 4.0, 9)
    result = solved(system, x, v, times)
    assert (result.contact_energy_lost[result.contact_constraint == 1] > 0.0).all()
    assert result.contact_start.size > 3
    softer = Linear(1.0 / (1.0 / 90.0 + 0.02))
    same = System(system.M, K, (Constraint((0,), (1.0,), 0.1, 0.1, law=softer), stops[1]))
    other = solved(same, x, v, times)
    assert (np.abs(result.x - other.x) <= result.error_x + other.error_x).all()
