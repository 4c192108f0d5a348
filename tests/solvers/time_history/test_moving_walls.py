"""Histories of structures with linear stops whose walls move."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.reference.stopped_runge_kutta import StoppedMotion
from tests.solvers.time_history.test_residual_flexibility import agrees, solved
from vibroimpact_solvers import ensemble, laws, time_history
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.flexibility import in_series
from vibroimpact_solvers.laws import Linear, Rigid
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.walls import Samples, Swing, Wall

Course = Callable[[float], tuple[float, float]]


def course_of(wall: Any) -> Course:
    """Return displacement and velocity of a wall by time, the latter from the right."""
    if isinstance(wall, Samples):
        t, y = np.array(wall.t), np.array(wall.y)

        def straight(s: float) -> tuple[float, float]:
            i = min(max(int(np.searchsorted(t, s, "right")) - 1, 0), t.size - 2)
            slope = (y[i + 1] - y[i]) / (t[i + 1] - t[i])
            return float(y[i] + slope * (s - t[i])), float(slope)

        return straight

    def swings(s: float) -> tuple[float, float]:
        phases = [(w, w.frequency * s + w.phase) for w in wall]
        return (
            sum(w.amplitude * math.cos(phase) for w, phase in phases),
            -sum(w.amplitude * w.frequency * math.sin(phase) for w, phase in phases),
        )

    return swings


def random_case(seed: int) -> tuple[System, Any, Any, Any, list[float]]:
    """Return a structure, its flexibility, an initial state, and times at which walls turn."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 5))
    count = int(rng.integers(1, min(n, 3) + 1))
    spread = rng.normal(size=(2, n, n))
    M, K = spread[0] @ spread[0].T + n * np.eye(n), spread[1] @ spread[1].T + np.eye(n)
    stops, breaks = [], list[float]()
    for a in range(count):
        if seed % 4 >= 2 and a == 0:
            breaks = [-0.5, 1.1, 2.0, 2.7, 5.0]
            wall: Wall = Samples(tuple(breaks), tuple((0.1 * rng.normal(size=5)).tolist()))
        else:
            numbers = rng.normal(size=(int(rng.integers(1, 3)), 2)).tolist()
            wall = tuple(Swing(0.1 * x, float(rng.uniform(0.3, 9.0)), y) for x, y in numbers)
        stop = Constraint(
            tuple(range(n)), tuple(rng.normal(size=n).tolist()),
            float(rng.uniform(-0.05, 0.3)) if rng.random() < 0.7 else None,
            float(rng.uniform(0.06, 0.3)), law=Linear(float(10.0 ** rng.uniform(0.0, 5.0))),
            wall=wall,
        )  # fmt: skip
        stops.append(stop)
    C = SymmetricMatrix.dense(0.02 * K) if seed % 3 else None
    system = System(SymmetricMatrix.dense(M), SymmetricMatrix.dense(K), tuple(stops), C=C)
    half = rng.normal(size=(count, count)) * 0.03 * (seed % 2)
    delta = half @ half.T
    return in_series(system, delta), delta, rng.normal(size=n) * 0.3, rng.normal(size=n), breaks


@pytest.mark.parametrize("seed", range(8))
def test_motions_are_those_of_a_runge_kutta_method(seed: int) -> None:
    """Harmonics and samples, up to three stops, in half of the cases with a flexibility."""
    system, delta, x, v, breaks = random_case(seed)
    times, load = np.linspace(0.0, 3.0, 13), time_history.Harmonic(0, 1.0, 1.3, 0.4)
    first = np.eye(system.n)[0]
    reference = StoppedMotion(
        system, lambda t: first * math.cos(1.3 * t + 0.4), delta,
        [course_of(c.wall) for c in system.constraints],
    )  # fmt: skip
    states = reference.follow(x, v, times, breaks)
    result = solved(system, x, v, times, load=(load,))
    agrees(result, reference, states)


@pytest.mark.parametrize("damping", [0.0, 3.0, 60.0])
def test_walls_that_move_are_loads_on_what_moves_with_them(damping: float) -> None:
    """``x = xi + u``: the same impacts of xi at walls at rest, with ``-m u'' - C u' - K u``.

    With a dashpot that loses its force beyond the wall, and is loaded again there.
    """
    m, K, C, A, w, phase = 2.0, 50.0, 0.4, 0.3, 7.0, 0.6
    law, u = Linear(900.0, damping), A * math.cos(phase)
    rate = -A * w * math.sin(phase)
    one = SymmetricMatrix.diagonal([m])

    def structure(wall: Wall) -> System:
        stop = Constraint((0,), (1.0,), 0.1, 0.2, law=law, wall=wall)
        springs, drag = SymmetricMatrix.diagonal([K]), SymmetricMatrix.diagonal([C])
        return System(one, springs, (stop,), C=drag)

    times = np.linspace(0.0, 12.0, 49)
    moving = solved(structure((Swing(A, w, phase),)), np.array([0.05]), np.array([1.0]), times)
    push = A * complex(m * w * w - K, -C * w)
    load = time_history.Harmonic(0, abs(push), w, phase + math.atan2(push.imag, push.real))
    other = solved(structure(()), np.array([0.05 - u]), np.array([1.0 - rate]), times, load=(load,))
    x = other.x[:, 0] + A * np.cos(w * times + phase)
    off = other.error_x[:, 0] + moving.error_x[:, 0] + 1e-13
    assert (np.abs(moving.x[:, 0] - x) <= off).all()
    assert moving.contact_start.size == other.contact_start.size > 10
    for name in ("start", "stop", "velocity", "impulse", "peak_force", "indentation"):
        one_, two = getattr(moving, f"contact_{name}"), getattr(other, f"contact_{name}")
        errors = getattr(moving, f"error_contact_{name}") + getattr(other, f"error_contact_{name}")
        assert (np.abs(one_ - two) <= errors + 1e-11 * np.abs(two)).all(), name
        assert errors.max() < 1e-8 * np.abs(two).max(), name
    losses = np.abs(moving.contact_energy_lost - other.contact_energy_lost)
    assert (losses <= 1e-9).all()
    assert (moving.contact_energy_lost > 0.0).any() == (damping > 0.0)


def test_the_work_of_the_walls_is_in_the_energy() -> None:
    """By quadrature of force times the wall's velocity, of a structure that loses nothing."""
    stop = Constraint((0,), (1.0,), None, 0.0, law=Linear(30.0), wall=(Swing(0.2, 3.0, 0.4),))
    one = SymmetricMatrix.diagonal([1.0])
    times = np.linspace(0.0, 4.0, 40001)
    result = solved(System(one, one, (stop,)), np.array([-0.5]), np.array([0.0]), times)
    # The stop pushes the structure by -F where the wall is, which the wall holds by F there.
    power = -result.force[:, 0] * -0.2 * 3.0 * np.sin(3.0 * times + 0.4)
    work = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(times) * (power[1:] + power[:-1]))])
    change = result.energy - result.energy[0]
    assert np.abs(change).max() > 0.01
    assert np.abs(change - work).max() < 1e-6


def test_the_initial_state_sees_the_walls_where_they_are() -> None:
    """A mass at rest at 0, the wall of which is there or behind it at the beginning."""
    one = SymmetricMatrix.diagonal([1.0])
    for amplitude, loaded in ((0.3, False), (-0.3, True)):
        stop = Constraint((0,), (1.0,), None, 0.1, law=Linear(100.0), wall=(Swing(amplitude, 0.5),))
        result = solved(System(one, one, (stop,)), np.zeros(1), np.zeros(1), np.array([0.0, 0.1]))
        assert (result.force[0, 0] > 0.0) == loaded
        if loaded:
            assert abs(result.force[0, 0] - 20.0) <= result.error_force[0, 0] < 1e-12


@pytest.mark.parametrize(
    ("law", "wall", "words"),
    [
        (Rigid(0.5), (Swing(0.1, 1.0),), "linear stops only"),
        (Linear(3.0, 0.1), Samples((0.0, 9.0), (0.0, 1.0)), "without damping"),
        (Linear(3.0), Samples((0.0, 1.0), (0.0, 1.0)), "do not last"),
        (Linear(3.0), Samples((0.5, 9.0), (0.0, 1.0)), "do not last"),
        (Linear(3.0), (Swing(0.1, 1e30),), "too often"),
    ],
)
def test_what_is_not_possible_is_refused(law: Any, wall: Any, words: str) -> None:
    one = SymmetricMatrix.diagonal([1.0])
    system = System(one, one, (Constraint((0,), (1.0,), 0.1, 0.1, law=law, wall=wall),))
    with pytest.raises(ModelError, match=words) as refused:
        solved(system, np.zeros(1), np.ones(1), np.linspace(0.0, 5.0, 3))
    assert refused.value.pointer[:4] == ("system", "constraints", 0, "wall")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Swing(math.nan, 1.0), "amplitude"),
        (lambda: Swing(1.0, 0.0), "frequency"),
        (lambda: Samples((0.0, 1.0), (0.0,)), "1 displacements"),
        (lambda: Samples((0.0, 0.0), (0.0, 1.0)), "ascend"),
        (lambda: Samples((0.0, 1.0), (0.0, math.inf)), "infinite"),
    ],
)
def test_numbers_of_walls_are_checked(make: Callable[[], Any], words: str) -> None:
    with pytest.raises(ModelError, match=words):
        make()


@pytest.mark.parametrize("kind", ["branches", "attractors", "ensemble", "impact-modes"])
def test_other_kinds_refuse_them(kind: str) -> None:
    stop = Constraint((0,), (1.0,), 0.1, 0.1, law=Linear(3.0), wall=(Swing(0.1, 1.0),))
    with pytest.raises(ModelError, match="walls at rest"):
        laws.require(kind, [stop])
    one, zero = SymmetricMatrix.diagonal([1.0]), np.zeros((1, 1))
    with pytest.raises(ModelError, match="walls at rest"):
        ensemble.Problem(System(one, one, (stop,)), zero, zero, 1.0)
