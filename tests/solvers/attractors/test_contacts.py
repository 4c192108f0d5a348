"""Attractors of structures with stops that have a stiffness, against scipy's integrator.

Shaw and Holmes (J. Sound Vib. 90, 1983, 129-155) describe the flips and the chaos of one mass whose
spring is stiffer beyond a place. The numbers here are those of the reference, not of the paper.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.solvers.attractors.pressing import Pressing, Stop
from vibroimpact_solvers import attractors, time_history
from vibroimpact_solvers.attractors import Force, Nature, Verification
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.laws import Linear
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

ONE = SymmetricMatrix.diagonal([1.0])
LOAD = (Force((0,), (1.0,), 1.0),)
DRAG = 0.1


def system(law: Linear, drag: float = DRAG, wall: float = 0.0) -> System:
    stop = Constraint((0,), (1.0,), lower=None, upper=wall, law=law)
    return System(ONE, ONE, (stop,), C=SymmetricMatrix.diagonal([drag]) if drag else None)


def reference(omega: float, law: Linear) -> Pressing:
    one = np.eye(1)
    stop = Stop(one[0], 0.0, law.stiffness, law.damping or 0.0)
    return Pressing(one, DRAG * one, one, (stop,), ((one[0], 1, 0.0),), omega)


def solved(omega: float, law: Linear, count: int = 6, **options: Any) -> attractors.Result:
    rng = np.random.default_rng(1)
    of = options.pop("system", system(law))
    x, v = -2.0 * rng.random((count, of.n)), 2.0 * rng.standard_normal((count, of.n))
    load = options.pop("load", LOAD)
    problem = attractors.Problem(of, np.array([omega]), x, v, load, **options)
    return attractors.solve(problem, attractors.plan(problem))


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize(
    ("omega", "law", "period", "contacts"),
    [
        (2.0, Linear(100.0), 1, 1), (2.3, Linear(100.0), 4, 4), (2.4, Linear(100.0), 3, 3),
        (2.9, Linear(100.0), 2, 2), (3.1, Linear(100.0), 4, 3), (3.5, Linear(100.0), 2, 1),
        (2.5, Linear(100.0, 2.0), 3, 3), (2.8, Linear(100.0, 2.0), 4, 4),
        (3.1, Linear(100.0, 2.0), 4, 2),
    ],
)  # fmt: skip
def test_periods_are_those_of_integrated_motions(
    omega: float, law: Linear, period: int, contacts: int
) -> None:
    result = solved(omega, law)
    assert result.attractor_contacts is not None
    assert result.attractor_verification is not None
    rows = (result.attractor_period == period) & (result.attractor_contacts == contacts)
    row = int(np.flatnonzero(rows)[0])
    assert result.attractor_nature[row] == Nature.PERIODIC
    assert result.attractor_verification[row] == Verification.CONFIRMED
    one = reference(omega, law)
    x, v = result.attractor_x[row], result.attractor_v[row]
    nx, nv = one.after(x, v, period)
    assert np.hypot(nx - x, nv - v) < 1e-5
    assert len(one.contacts) == contacts
    for less in range(1, period):
        nx, nv = one.after(x, v, less)
        assert np.hypot(nx - x, nv - v) > 1e-3


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("omega", [2.0, 2.4, 2.6, 2.9, 3.1, 3.5])
@pytest.mark.parametrize("law", [Linear(100.0), Linear(100.0, 2.0)])
def test_exponents_are_those_of_the_multipliers(omega: float, law: Linear) -> None:
    result = solved(omega, law)
    assert result.attractor_verification is not None
    assert result.attractor_stability is not None
    assert result.error_stability is not None
    assert (result.attractor_verification == Verification.CONFIRMED).all()
    duration = result.attractor_period * 2.0 * math.pi / omega
    expected = np.log(result.attractor_stability) / duration
    doubt = result.error_stability / result.attractor_stability / duration
    apart = np.abs(result.attractor_exponent - expected)
    assert (apart <= result.error_attractor_exponent + doubt).all()
    if not law.damping:
        # Both multipliers are a pair, whose product is what the damping makes of areas.
        pairs = np.abs(expected + 0.5 * DRAG) < 1e-9
        assert pairs.any()


@pytest.mark.needs("compiled kernels")
def test_chaos_has_the_exponent_of_neighbouring_motions() -> None:
    omega, law = 2.8, Linear(100.0)
    one = system(law)  # a system keeps what was prepared for it, which takes longer than a period
    result = solved(omega, law, count=3, system=one, observe=1000)
    assert result.attractor_nature.tolist() == [Nature.CHAOTIC]
    value, error = float(result.attractor_exponent[0]), float(result.error_attractor_exponent[0])
    assert value > 3.0 * error
    # Neighbouring motions, brought close again after each period of the drive.
    T, close, total, periods = 2.0 * math.pi / omega, 1e-7, 0.0, 600
    x, v = result.attractor_x[0], result.attractor_v[0]
    dx, dv = close, 0.0
    for _ in range(periods):
        ends = []
        for each in (State(x, v), State(x + dx, v + dv)):
            motion = history(one, each, T, omega)
            ends.append((motion.x[-1], motion.v[-1]))
        (x, v), (nx, nv) = ends
        far = float(np.hypot(nx - x, (nv - v))[0])
        total += math.log(far / close)
        dx, dv = float((nx - x)[0]) * close / far, float((nv - v)[0]) * close / far
    expected = total / (periods * T)
    assert abs(value - expected) < error + 0.1 * expected


State = time_history.State


def history(of: System, state: time_history.State, end: float, omega: float) -> Any:
    problem = time_history.Problem(
        of, state, end, np.array([end]), outputs=frozenset({"x", "v"}),
        load=(time_history.Harmonic(0, 1.0, omega),), estimate=False,
    )  # fmt: skip
    return time_history.solve(problem, time_history.plan(problem))


def test_without_contact_it_is_the_response() -> None:
    result = solved(2.0, Linear(10.0), system=system(Linear(10.0), wall=1.0))
    assert result.attractor_contacts is not None
    assert result.attractor_contact_rate is not None
    assert result.attractor_stability is not None
    assert result.attractor_contacts.tolist() == [0]
    assert result.attractor_contact_rate.tolist() == [0.0]
    assert result.attractor_exponent[0] == pytest.approx(-0.5 * DRAG, rel=1e-12)
    assert result.attractor_stability[0] == pytest.approx(math.exp(-0.5 * DRAG * math.pi))
    response = 1.0 / complex(1.0 - 4.0, 2.0 * DRAG)
    assert result.attractor_x[0, 0] == pytest.approx(response.real, abs=result.error_x[0, 0])


def test_a_stop_that_is_loaded_throughout() -> None:
    """A wall far behind the place of rest: the structure with the spring, and one contact."""
    law, omega = Linear(3.0, 0.2), 2.5
    result = solved(omega, law, system=system(law, wall=-5.0))
    assert result.attractor_contacts is not None
    assert result.contact_duration is not None
    assert result.contact_peak_force is not None
    assert result.attractor_stability is not None
    assert result.attractor_contacts.tolist() == [1]
    assert result.contact_duration[0] == pytest.approx(2.0 * math.pi / omega)
    drag = DRAG + 0.2
    response = abs(1.0 / complex(4.0 - omega**2, omega * drag))
    # Preload k (x + 5) at the equilibrium x = -15/4, and the amplitude of k x + c v.
    force = 3.0 * 1.25 + response * math.hypot(3.0, 0.2 * omega)
    assert result.contact_peak_force[0] == pytest.approx(force, rel=1e-9)
    assert result.attractor_exponent[0] == pytest.approx(-0.5 * drag, abs=1e-3)
    assert result.attractor_stability[0] == pytest.approx(
        math.exp(-0.5 * drag * 2 * math.pi / omega)
    )


def several(n: int) -> tuple[System, Pressing, float, tuple[Force, ...]]:
    """Return a chain with two stops of different laws, and a load of two harmonics."""
    rng, omega = np.random.default_rng(n), 0.9
    M = np.diag(rng.uniform(0.5, 2.0, n))
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    C = 0.1 * K + 0.05 * np.eye(n)
    C[0, 0] += 0.1
    rows = np.eye(n)[0], np.eye(n)[n - 1] - 0.3 * np.eye(n)[0]
    stops = (Stop(rows[0], 0.4, 20.0, 0.8), Stop(rows[1], 0.5, 30.0, 0.0, -1))
    load = ((np.eye(n)[0], 1, 0.3), (0.5 * np.eye(n)[n - 1], 2, -1.0))
    constraints = (
        Constraint((0,), (1.0,), None, 0.4, law=Linear(20.0, 0.8)),
        Constraint((0, n - 1), (-0.3, 1.0), 0.5, None, law=Linear(30.0)),
    )
    of = System(
        SymmetricMatrix.dense(M), SymmetricMatrix.dense(K), constraints, C=SymmetricMatrix.dense(C)
    )
    forces = (
        Force((0,), (1.0,), 1.0, phase=0.3), Force((n - 1,), (1.0,), 0.5, harmonic=2, phase=-1.0)
    )  # fmt: skip
    return of, Pressing(M, C, K, stops, load, omega), omega, forces


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("n", [2, 3, 4, 5])
def test_contacts_of_structures_are_those_of_integrated_motions(n: int) -> None:
    """Begins, durations and the state of a confirmed motion, within what the integrator keeps."""
    of, one, omega, load = several(n)
    v = np.random.default_rng(3).standard_normal((3, n))
    problem = attractors.Problem(of, np.array([omega]), np.zeros((3, n)), v, load)
    result = attractors.solve(problem, attractors.plan(problem))
    assert result.attractor_verification is not None
    assert result.contact_attractor is not None
    assert result.contact_time is not None
    assert result.contact_duration is not None
    assert result.contact_constraint is not None
    confirmed = np.flatnonzero(result.attractor_verification == Verification.CONFIRMED)
    assert confirmed.size
    row = int(confirmed[0])
    period = int(result.attractor_period[row])
    x, v = result.attractor_x[row], result.attractor_v[row]
    nx, nv = one.after(x, v, period)
    assert np.abs(nx - x).max() + np.abs(nv - v).max() < 1e-6
    mine = np.flatnonzero(result.contact_attractor == row)
    assert mine.size > 1
    seen = sorted((a, b, e - b) for b, e, a in one.contacts if b > 0.0 and e < period * one.period)
    told = sorted(
        (int(result.contact_constraint[k]), float(result.contact_time[k]),
         float(result.contact_duration[k]))
        for k in mine
    )  # fmt: skip
    told = [each for each in told if each[1] + each[2] < period * one.period]
    assert [each[0] for each in seen] == [each[0] for each in told]
    assert np.array(seen) == pytest.approx(np.array(told), abs=1e-6)


def test_sections_at_contacts_are_their_begins() -> None:
    result = solved(2.9, Linear(100.0), section="impacts")
    assert result.section_phase is not None
    assert result.section_velocity is not None
    assert result.contact_phase is not None
    assert result.contact_velocity is not None
    assert result.section_attractor is not None
    mine, table = result.section_attractor == 0, result.contact_attractor == 0
    assert np.sort(result.section_phase[mine]) == pytest.approx(
        np.sort(result.contact_phase[table]), abs=1e-6
    )
    assert np.sort(result.section_velocity[mine]) == pytest.approx(
        np.sort(result.contact_velocity[table]), abs=1e-6
    )


@pytest.mark.parametrize(
    ("of", "pointer", "code"),
    [
        (system(Linear(10.0), drag=0.0), ("system", "C"), "undamped"),
        (
            System(SymmetricMatrix.diagonal([1.0, 1.0]), SymmetricMatrix.diagonal([1.0, 2.0]), (
                Constraint((0,), (1.0,), None, 1.0, law=Linear(10.0, 1.0)),
                Constraint((1,), (1.0,), 1.0, None),
            )),
            ("system", "constraints", 1), "not_possible",
        ),
    ],
)  # fmt: skip
def test_errors_name_the_field(of: System, pointer: tuple[str | int, ...], code: str) -> None:
    with pytest.raises(ModelError) as caught:
        solved(2.0, Linear(10.0), system=of)
    assert (caught.value.pointer, caught.value.code) == (pointer, code)


def test_losses_at_the_stop_are_enough() -> None:
    law = Linear(50.0, restitution=0.6)
    result = solved(2.0, law, system=system(law, drag=0.0))
    assert (result.attractor_nature == Nature.PERIODIC).all()


def test_a_body_that_falls_is_observed_but_not_confirmed() -> None:
    """A ball on a table of springs that a drive shakes: its load moves a free body."""
    law = Linear(400.0, 4.0)
    stop = Constraint((0,), (1.0,), lower=0.0, upper=None, law=law)
    ball = System(ONE, SymmetricMatrix.diagonal([0.0]), (stop,), force=np.array([-1.0]))
    x, v = np.full((2, 1), 0.1), np.zeros((2, 1))
    problem = attractors.Problem(ball, np.array([2.0]), x, v, (Force((0,), (1.0,), 1.5),))
    result = attractors.solve(problem, attractors.plan(problem))
    assert result.attractor_verification is not None
    assert result.attractor_contact_rate is not None
    assert (result.attractor_contact_rate > 0.0).all()
    assert (result.attractor_verification != Verification.CONFIRMED).all()
