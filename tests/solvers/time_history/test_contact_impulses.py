"""Impulses of walls on coordinates at rest, against closed forms and quadrature of the forces."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from vibroimpact_solvers import presets
from vibroimpact_solvers import time_history as th
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.plan import Stage

CONTACTS = frozenset({"contacts", "impacts"})


def solve(system: System, x: object, v: object, t_end: float, **fields: object) -> th.Result:
    state = th.State(np.asarray(x, dtype=float), np.asarray(v, dtype=float))
    given: dict[str, object] = {"outputs": CONTACTS, **fields}
    problem = th.Problem(system, state, t_end, **given)  # type: ignore[arg-type]
    return th.solve(problem, th.plan(problem))


@pytest.mark.parametrize("restitution", [0.0, 0.9])
def test_a_ball_at_rest_presses_with_its_weight(restitution: float) -> None:
    ball = presets.bouncing_ball([Constraint((0,), (1.0,), 0.0, None, restitution)])
    result = solve(ball, [1.0], [0.0], 12.0)
    assert result.contact_impulse is not None
    assert result.contact_rest is not None
    np.testing.assert_allclose(
        result.contact_impulse, 9.81 * (12.0 - result.contact_rest), rtol=1e-14
    )


def test_all_impulses_on_a_ball_carry_its_weight() -> None:
    """All impulses of the floor together are m g t_end + m v(0) at rest in the end."""
    ball = presets.bouncing_ball([Constraint((0,), (1.0,), 0.0, None, 0.5)])
    result = solve(ball, [1.0], [0.7], 6.0)
    assert result.contact_impulse is not None
    assert result.impact_impulse is not None
    total = result.impact_impulse.sum() + result.contact_impulse.sum()
    # What the chatter that is summed gives is in neither: it lasts less than 1e-8 of the time.
    np.testing.assert_allclose(total, 9.81 * 6.0 - 0.7, rtol=1e-8)


def test_a_driven_mass_on_its_wall_in_closed_form() -> None:
    """x'' + x = F cos(w t + phase) at rest at x = g: the force is F cos(w t + phase) - g."""
    gap, F, w, phase = 0.3, 0.8, 0.4, 0.2
    system = presets.oscillator([Constraint((0,), (1.0,), None, gap, 0.0)], 1.0)
    load = (th.Harmonic(0, F, w, phase),)
    result = solve(system, [gap], [0.0], 60.0, load=load)
    assert result.contact_impulse is not None
    assert result.contact_rest is not None
    assert result.contact_stop is not None
    assert result.contact_rest.size > 2
    rest, stop = result.contact_rest, result.contact_stop
    sines = np.sin(w * stop + phase) - np.sin(w * rest + phase)
    np.testing.assert_allclose(
        result.contact_impulse, F / w * sines - gap * (stop - rest), rtol=1e-12, atol=1e-14
    )
    assert (result.contact_impulse > 0.0).all()


def test_impulses_that_are_not_asked_for_change_nothing_else() -> None:
    """A driven mass that rests, strikes and rests: the same motion to the last bit."""
    system = presets.oscillator([Constraint((0,), (1.0,), None, 0.3, 0.6)], 1.0)
    given = {"load": (th.Harmonic(0, 0.8, 0.4, 0.2),), "estimate": False}
    asked = solve(system, [0.0], [1.0], 60.0, **given)
    other = solve(system, [0.0], [1.0], 60.0, contact_impulses=False, **given)
    assert asked.contact_impulse is not None
    assert other.contact_impulse is not None
    assert asked.contact_impulse.size > 2
    assert np.isfinite(asked.contact_impulse).all()
    assert np.isnan(other.contact_impulse).all()
    for name in ("contact_start", "contact_rest", "contact_stop", "impact_time", "impact_impulse"):
        np.testing.assert_array_equal(getattr(other, name), getattr(asked, name))


def test_a_wall_carries_what_an_accelerated_mass_presses_by_its_coupling() -> None:
    """x1 moves as a + b t + c t^2/2 while x0 rests at its wall, which carries f0 - 2 g - x1."""
    g, a, b, f0, f1, t_end = 0.1, 0.2, 0.3, 5.0, 0.5, 1.0
    system = System(
        dense(np.eye(2)),
        dense([[2.0, 1.0], [1.0, 0.0]]),
        (Constraint((0,), (1.0,), None, g, 0.0),),
        force=np.array([f0, f1]),
    )
    result = solve(system, [g, a], [0.0, b], t_end)
    assert result.contact_impulse is not None
    c = f1 - g
    expected = (f0 - 2.0 * g - a) * t_end - b * t_end**2 / 2.0 - c * t_end**3 / 6.0
    np.testing.assert_allclose(result.contact_impulse, [expected], rtol=1e-13)


def quadrature(
    system: System, result: th.Result, row: int, load: tuple[th.Harmonic, ...], **fields: object
) -> float:
    """Return the integral of the wall's force over a contact, from the motion alone.

    The wall's force along a single degree of freedom with diagonal M is K x + C v - f + M x'',
    and x'' = 0 there.
    """
    assert result.contact_rest is not None
    assert result.contact_stop is not None
    assert result.contact_constraint is not None
    assert result.contact_side is not None
    assert result.impact_time is not None
    start, stop = result.contact_rest[row], result.contact_stop[row]
    dof = system.constraints[result.contact_constraint[row]].dofs[0]
    # The force has a kink where something else happens.
    events = np.concatenate([[start, stop], result.impact_time, result.contact_stop])
    breaks = np.unique(events[(events >= start) & (events <= stop)])
    nodes, weights = np.polynomial.legendre.leggauss(40)
    spans = np.diff(breaks)[:, np.newaxis]
    t = (breaks[:-1, np.newaxis] + 0.5 * (nodes + 1.0) * spans).ravel()
    asked = {"outputs": frozenset({"x", "v"}), "load": load, **fields}
    history = solve(system, t=t, **asked)  # type: ignore[arg-type]
    assert history.x is not None
    assert history.v is not None
    force = history.x @ system.K.to_dense()[dof]
    if system.C is not None:
        force = force + history.v @ system.C.to_dense()[dof]
    if system.force is not None:
        force = force - system.force[dof]
    for term in load:
        if term.dof == dof:
            force = force - term.amplitude * np.cos(term.frequency * t + term.phase)
    force = -result.contact_side[row] * force.reshape(spans.size, -1)
    return float(((force @ weights) * 0.5 * spans[:, 0]).sum())


def dense(rows: object) -> SymmetricMatrix:
    return SymmetricMatrix.dense(np.array(rows, dtype=float))


STOPS = (Constraint((0,), (1.0,), None, 0.05, 0.0), Constraint((1,), (1.0,), 0.1, 0.5, 0.0))
K = dense([[2.0, -1.0], [-1.0, 2.0]])
SYSTEMS = {
    "undamped": System(dense(np.eye(2)), K, STOPS),
    "coupled": System(dense(np.eye(2)), K, STOPS, C=dense([[0.2, -0.1], [-0.1, 0.3]])),
    "overdamped": System(dense(np.eye(2)), K, STOPS, C=dense([[4.0, -1.0], [-1.0, 5.0]])),
    "critical": System(dense(np.eye(2)), dense(np.eye(2)), STOPS, C=dense(2.0 * np.eye(2))),
    "unstable": System(dense(np.eye(2)), dense([[2.0, -1.0], [-1.0, -0.1]]), STOPS),
    "free": System(
        dense(np.diag([1.0, 2.0])),
        dense([[1.0, -1.0], [-1.0, 1.0]]),
        (Constraint((0,), (1.0,), None, 0.05, 0.0),),
        force=np.array([0.3, 0.1]),
    ),
}
RATTLING = (Constraint((0,), (1.0,), None, 0.05, 0.0), Constraint((1,), (1.0,), 0.1, 0.1, 1.0))
SYSTEMS |= {
    f"{name}, the other one rattling": System(
        system.M, system.K, RATTLING, C=system.C, force=np.array([0.5, 0.0])
    )
    for name, system in SYSTEMS.items()
}


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("name", SYSTEMS)
def test_impulses_are_integrals_of_the_force(name: str) -> None:
    system = SYSTEMS[name]
    load = (th.Harmonic(0, 0.6, 0.5), th.Harmonic(1, -0.5, 0.35, 0.4))
    fields = {"x": [0.0, 0.0], "v": [0.2, 0.0], "t_end": 25.0}
    result = solve(system, load=load, **fields)  # type: ignore[arg-type]
    assert result.contact_impulse is not None
    assert result.contact_rest is not None
    assert result.contact_stop is not None
    known = result.contact_stop <= result.error_predictable_until
    known &= result.contact_stop - result.contact_rest < 12.0
    assert known.any()
    for row in np.flatnonzero(known):
        expected = quadrature(system, result, row, load, **fields)
        assert result.contact_impulse[row] == pytest.approx(expected, rel=1e-11, abs=1e-12)


@pytest.mark.parametrize("coupling", [0.3, -0.3, 0.0])
def test_impulses_carry_the_momentum_of_what_rattles_beside_a_contact(coupling: float) -> None:
    """By its mass one coordinate takes the other from its wall at one side, and presses it there.

    Without stiffness all impulses together are what the momenta gain beyond those of the forces.
    """
    force = np.array([3.0, 0.2])
    M = np.array([[1.0, coupling], [coupling, 1.0]])
    system = System(dense(M), dense(np.zeros((2, 2))), RATTLING, force=force)
    v, t_end = [0.0, 1.3], 10.0
    result = solve(system, [0.0, 0.0], v, t_end, t=np.array([t_end]), outputs=CONTACTS | {"v", "x"})
    assert result.v is not None
    assert result.impact_impulse is not None
    assert result.contact_impulse is not None
    given = np.zeros(2)
    for dof, side, impulse in (
        *zip(result.impact_constraint, result.impact_side, result.impact_impulse, strict=True),
        *zip(result.contact_constraint, result.contact_side, result.contact_impulse, strict=True),
    ):
        given[dof] -= side * impulse
    assert result.count_impacts > 20
    assert (result.contact_impulse.size > 1) == (coupling != 0.0)
    np.testing.assert_allclose(given, M @ (result.v[-1] - v) - force * t_end, rtol=1e-12)


@pytest.mark.parametrize("near", [0.0, 1e-9, 1e-5, 1e-2])
def test_impulses_while_the_rest_is_driven_at_its_frequency(near: float) -> None:
    """With one DOF held fixed the natural frequency is 2^(1/2), at or near which it is driven."""
    stops = (Constraint((0,), (1.0,), None, 0.05, 0.0),)
    system = System(dense(np.eye(2)), K, stops, force=np.array([3.0, 0.0]))
    load = (th.Harmonic(1, 0.05, math.sqrt(2.0) + near, 0.3),)
    fields = {"x": [0.0, 0.0], "v": [0.2, 0.0], "t_end": 12.0}
    result = solve(system, load=load, **fields)  # type: ignore[arg-type]
    assert result.contact_impulse is not None
    assert result.contact_impulse.size == 1
    expected = quadrature(system, result, 0, load, **fields)
    assert result.contact_impulse[0] == pytest.approx(expected, rel=1e-11)


def test_bodies_that_push_one_another() -> None:
    """Two free bodies in contact under a load on the first: the second takes its share.

    x1 - x2 <= 0 with k = 0 and f on the first: the contact force is f m2/(m1 + m2), and the
    bodies together run along a parabola.
    """
    masses, f = np.array([1.0, 3.0]), 0.8
    stop = Constraint((0, 1), (1.0, -1.0), None, 0.0, 0.0)
    system = System(
        SymmetricMatrix.diagonal(masses),
        SymmetricMatrix.diagonal(np.zeros(2)),
        (stop,),
        force=np.array([f, 0.0]),
    )
    result = solve(system, [-0.4, 0.0], [0.0, 0.0], 7.0)
    assert result.contact_impulse is not None
    assert result.contact_rest is not None
    np.testing.assert_allclose(result.contact_rest, [math.sqrt(2.0 * 0.4 / f)], rtol=1e-14)
    share = f * masses[1] / masses.sum()
    np.testing.assert_allclose(
        result.contact_impulse, share * (7.0 - result.contact_rest), rtol=1e-13
    )


def waveform(tau: Floats, Omega: float, gap: float) -> Floats:
    """Return the displacement of an oscillator of unit frequency on its impact mode, eq. 10.5."""
    gamma = 0.5 * math.pi / Omega
    return np.asarray(gap * np.sin(gamma * tau) / math.sin(gamma))


def test_a_motion_started_on_an_impact_mode_is_the_mode() -> None:
    """x = gap sin(gamma tau(phi))/sin(gamma), phi = (2/pi) Omega t, tau the triangular sine."""
    Omega, gap = 1.3, 0.7
    system = presets.oscillator([Constraint.at(0, gap)], 1.0)
    t = np.linspace(0.0, 40.0, 501)
    problem = th.Problem(
        system, th.ImpactMode(Omega), 40.0, t=t, outputs=frozenset({"x", "v", "impacts"})
    )
    result = th.solve(problem, th.plan(problem))
    phi = 2.0 / math.pi * Omega * t
    folded = np.abs((phi - 1.0) % 4.0 - 2.0) - 1.0
    assert result.x is not None
    np.testing.assert_allclose(result.x[:, 0], waveform(folded, Omega, gap), atol=1e-12)
    assert result.impact_time is not None
    quarter = 0.5 * math.pi / Omega
    expected = quarter * (1.0 + 2.0 * np.arange(result.impact_time.size))
    np.testing.assert_allclose(result.impact_time, expected, rtol=1e-13)


class Counter:
    """How many states are turned into displacements or energies."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        from vibroimpact_solvers.time_history import rigid_motions

        self.samples = 0
        real = rigid_motions.follow

        def counted(structure: object, motion: tuple[Any, ...], *args: object) -> tuple[int, int]:
            stop = real(structure, motion, *args)
            self.samples += int(motion[2]["samples"].sum())
            return stop

        monkeypatch.setattr(rigid_motions, "follow", counted)


@pytest.mark.parametrize(
    ("outputs", "expected"),
    [({"impacts"}, 0), ({"impacts", "contacts"}, 0), ({"x"}, 21), ({"energy", "impacts"}, 21)],
)
def test_a_history_that_is_not_asked_is_not_built(
    outputs: set[str], expected: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    system = presets.chain(13, [Constraint.at(5, 0.2)])
    counter = Counter(monkeypatch)
    rng = np.random.default_rng(3)
    state = th.State(rng.uniform(-0.1, 0.1, 13), rng.standard_normal(13))
    t = np.linspace(0.0, 30.0, 21)
    problem = th.Problem(system, state, 30.0, t=t, outputs=frozenset(outputs))
    plan = th.plan(problem)
    result = th.solve(problem, plan)
    assert result.count_impacts > 20
    assert counter.samples == expected
    assert (plan.step(Stage.HISTORY) is None) is (expected == 0)
    told = {skip.what for skip in plan.skips}
    assert ("history" in told) is (expected == 0)
    assert {"x", "v", "energy"} - outputs <= told


def test_only_asked_degrees_of_freedom_are_evaluated() -> None:
    system = presets.chain(40, [Constraint.at(5, 0.2)])
    rng = np.random.default_rng(3)
    state = th.State(rng.uniform(-0.1, 0.1, 40), rng.standard_normal(40))
    some = th.Problem(
        system, state, 20.0, t=np.linspace(0.0, 20.0, 50), dofs=np.array([7, 3]),
        outputs=frozenset({"x", "v"}),
    )  # fmt: skip
    plan = th.plan(some)
    step = plan.step(Stage.HISTORY)
    assert step is not None
    assert step.reason == "2 of 40 degrees of freedom at 50 times"
    whole = th.Problem(
        system, state, 20.0, t=np.linspace(0.0, 20.0, 50), outputs=frozenset({"x", "v"})
    )
    a, b = th.solve(some, plan), th.solve(whole, th.plan(whole))
    assert a.x is not None
    assert b.x is not None
    assert a.v is not None
    assert b.v is not None
    # Products of two and of forty rows are summed in different orders, over forty modes.
    orders = 40.0 * np.finfo(float).eps
    np.testing.assert_allclose(a.x, b.x[:, [7, 3]], rtol=0.0, atol=orders * np.abs(b.x).max())
    np.testing.assert_allclose(a.v, b.v[:, [7, 3]], rtol=0.0, atol=orders * np.abs(b.v).max())
