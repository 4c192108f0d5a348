"""Stops with stiffness and damping in time histories."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vibroimpact_solvers import (
    ensemble,
    existence_bands,
    impact_modes,
    laws,
    resonances,
    time_history,
)
from vibroimpact_solvers.errors import Cancelled, ModelError, PlanError
from vibroimpact_solvers.laws import Linear, Rigid
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.time_history.stops import motion as motions_of_stops
from vibroimpact_solvers.time_history.stops import scene_table

ALL = frozenset({"x", "v", "energy", "force", "contacts"})


def one_mass(law: Any, upper: float = 0.0, K: float = 0.0, force: float = 0.0) -> System:
    wall = Constraint((0,), (1.0,), None, upper, law=law)
    M, stiffness = SymmetricMatrix.diagonal([2.0]), SymmetricMatrix.diagonal([K])
    return System(M, stiffness, (wall,), force=np.array([force]))


def motion(
    system: System, x: Any, v: Any, t_end: float, count: int = 21, **more: Any
) -> time_history.Result:
    state = time_history.State(np.array(x, dtype=float), np.array(v, dtype=float))
    times = np.linspace(0.0, t_end, count)
    more = {"outputs": ALL} | more
    problem = time_history.Problem(system, state, t_end, t=times, **more)
    return time_history.solve(problem, time_history.plan(problem))


def test_a_free_mass_at_a_spring() -> None:
    """By hand: half a period, and the momentum comes back."""
    m, k, v0 = 2.0, 450.0, 3.0
    result = motion(one_mass(Linear(k), upper=0.5), [0.2], [v0], 1.0)
    w = math.sqrt(k / m)
    assert result.contact_start is not None
    assert result.contact_stop is not None
    assert abs(result.contact_start - 0.1).max() <= result.error_contact_start.max() < 1e-14
    assert abs(result.contact_stop - 0.1 - math.pi / w).max() <= result.error_contact_stop.max()
    for name, true in (
        ("impulse", 2.0 * m * v0),
        ("peak_force", v0 * math.sqrt(k * m)),
        ("indentation", v0 / w),
        ("energy_lost", 0.0),
    ):
        value = getattr(result, f"contact_{name}")
        error = getattr(result, f"error_contact_{name}")
        assert value.shape == (1,)
        assert abs(value[0] - true) <= error[0] <= 1e-12 * m * v0 * w, name
    assert result.error_energy_drift is not None
    assert result.error_energy_drift < 1e-14


def test_an_elastic_stop_without_clearance() -> None:
    """By hand: half a period of one spring, half a period of both, and so on."""
    m, K, k, v0 = 2.0, 50.0, 350.0, 0.7
    result = motion(one_mass(Linear(k), K=K), [0.0], [-v0], 40.0)
    alone, both = math.pi / math.sqrt(K / m), math.pi / math.sqrt((K + k) / m)
    count = int((40.0 - alone) / (alone + both)) + 1
    starts = alone + (alone + both) * np.arange(count)
    assert result.contact_start is not None
    assert result.contact_stop is not None
    assert result.contact_peak_force is not None
    assert result.contact_start.size == count
    assert (np.abs(result.contact_start - starts) <= result.error_contact_start).all()
    assert (np.abs(result.contact_stop - starts - both) <= result.error_contact_stop)[:-1].all()
    peak = k * v0 / math.sqrt((K + k) / m)
    assert result.contact_peak_force == pytest.approx(np.full(count, peak), rel=1e-12)
    assert np.max(result.error_contact_start) < 1e-11


@pytest.mark.parametrize("ratio", [0.01, 0.3, 0.9, 1.0 - 1e-8, 1.0, 1.3, 8.0])
def test_restitution_of_a_free_mass(ratio: float) -> None:
    """The closed form against an integration until the force is zero."""
    m, k = 1.7, 30.0
    c = 2.0 * ratio * math.sqrt(k * m)

    def lost(_t: float, z: Any) -> float:
        return float(k * z[0] + c * z[1])

    lost.terminal, lost.direction = True, -1.0  # type: ignore[attr-defined]
    run = solve_ivp(
        lambda _t, z: [z[1], -(k * z[0] + c * z[1]) / m],
        (0.0, 100.0), [0.0, 1.0], "DOP853", events=lost, rtol=1e-12, atol=1e-14, max_step=0.05,
    )  # fmt: skip
    restitution = -float(run.y[1, -1])
    assert laws.restitution_of(ratio) == pytest.approx(restitution, rel=1e-8)
    assert laws.damping_ratio(laws.restitution_of(ratio)) == pytest.approx(ratio, rel=1e-6)


@pytest.mark.parametrize("restitution", [1.0, 0.8, 0.3, 0.02])
def test_a_stop_by_its_restitution(restitution: float) -> None:
    """A free mass leaves with that part of its speed, whatever it weighs."""
    result = motion(one_mass(Linear(70.0, restitution=restitution), 0.1), [0.0], [1.0], 5.0)
    assert result.v is not None
    assert result.energy is not None
    assert result.contact_energy_lost is not None
    assert result.v[-1, 0] == pytest.approx(-restitution, rel=1e-12)
    assert result.contact_energy_lost[0] == pytest.approx(1.0 - restitution**2, abs=1e-13)


def test_rigid_limit() -> None:
    """A stiffer stop without damping tends to an elastic impact, the duration as 1/k^(1/2)."""
    n = 4
    K = SymmetricMatrix.dense(2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    M, v = SymmetricMatrix.diagonal(np.ones(n)), np.array([0.3, -0.2, 1.0, 0.4])
    rigid = Constraint((2,), (1.0,), None, 0.3)
    times = {"count": 5, "outputs": frozenset({"x", "v"})}
    exact = motion(System(M, K, (rigid,)), np.zeros(n), v, 1.5, **times)
    apart = []
    for stiffness in (1e4, 1e6, 1e8, 1e10):
        stop = Constraint((2,), (1.0,), None, 0.3, law=Linear(stiffness))
        result = motion(System(M, K, (stop,)), np.zeros(n), v, 1.5, **times)
        assert result.x is not None
        assert exact.x is not None
        apart.append(float(np.abs(result.x - exact.x).max()))
        assert np.max(result.error_x) < 1e-8
    rates = np.log10(np.array(apart[:-1]) / np.array(apart[1:]))
    assert rates == pytest.approx(np.ones(3), abs=0.05)


def test_rest_under_preload() -> None:
    """A damped mass comes to rest on its stop, pressed by its own weight, in one last phase."""
    weight, k = 3.0, 200.0
    result = motion(one_mass(Linear(k, 8.0), force=weight), [-0.4], [0.0], 30.0, count=4)
    assert result.force is not None
    assert result.contact_stop is not None
    assert result.x is not None
    assert result.force[-1, 0] == pytest.approx(weight, rel=1e-13)
    assert result.x[-1, 0] == pytest.approx(weight / k, rel=1e-13)
    assert result.contact_stop[-1] == 30.0
    assert result.contact_stop.size < 10


@pytest.mark.parametrize("k", [0.0, 1e-6, 1.0, 1e12])
def test_energy_is_lost_in_contacts_alone(k: float) -> None:
    """What the table says is lost is what the energy lacks, over negative gaps too."""
    stops = (
        Constraint((0,), (1.0,), -0.05, 0.2, law=Linear(k, 0.3 * math.sqrt(k))),
        Constraint((1, 2), (1.0, -1.0), 0.1, None, law=Linear(2.0 * k, 0.0)),
    )
    K = np.array([[3.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]])
    system = System(
        SymmetricMatrix.dense(np.diag([1.0, 2.0, 0.7])), SymmetricMatrix.dense(K), stops
    )
    result = motion(system, [0.0, 0.1, 0.0], [-0.5, -1.0, 0.8], 9.0)
    energy, lost = result.energy, result.contact_energy_lost
    assert energy is not None
    assert lost is not None
    errors = float(np.max(result.error_energy) + np.sum(result.error_contact_energy_lost))
    known = result.error_predictable_until == 9.0
    if known:
        assert abs(energy[0] - energy[-1] - lost.sum()) <= errors
    assert (np.diff(energy) <= 1e-9).all()
    assert known or k == 1e12
    if k == 0.0:
        assert lost.size == 0


def test_a_dashpot_alone() -> None:
    """Without a spring a stop slows a mass, which then stays where it is pressed."""
    m, c = 2.0, 1.5
    result = motion(one_mass(Linear(0.0, c)), [-1.0], [1.0], 8.0)
    assert result.contact_start is not None
    assert result.v is not None
    true = np.where(result.t < 1.0, 1.0, np.exp(-c / m * (np.asarray(result.t) - 1.0)))
    assert result.v[:, 0] == pytest.approx(true, abs=1e-13)
    assert result.contact_start == pytest.approx([1.0])


def test_a_stop_between_free_bodies_holds_neither() -> None:
    """Their centre moves as the loads push it, through contacts and rest."""
    M, force = np.diag([1.3, 1.3, 1.3]), np.array([-0.6, 0.3, 1.1])
    K = np.array([[1.0, -1.0, 0.0], [-1.0, 1.1, -0.1], [0.0, -0.1, 0.1]])
    stop = Constraint((0, 1), (1.0, -1.0), 0.2, 0.3, law=Linear(386.5, 0.0))
    system = System(*(SymmetricMatrix.dense(A) for A in (M, K)), (stop,), force=force)
    result = motion(system, np.zeros(3), [1.0, -1.0, 0.5], 6.0)
    assert result.contact_start is not None
    assert result.contact_start.size > 2
    t, centre = np.asarray(result.t), np.asarray(result.x).mean(axis=1)
    true = 0.5 / 3.0 * t + 0.5 * force.sum() / 3.9 * t**2
    assert np.abs(centre - true).max() <= np.max(result.error_x) < 1e-11


def test_loads_between_stops_against_an_integrator() -> None:
    """Harmonic and sampled loads, two sides, damping that couples modes."""
    M, K = np.diag([1.0, 0.6]), np.array([[4.0, -1.5], [-1.5, 3.0]])
    C = np.array([[0.1, -0.02], [-0.02, 0.05]])
    k, c, gap = 300.0, 4.0, 0.15
    stop = Constraint.at(1, gap)
    stop = Constraint(stop.dofs, stop.weights, gap, gap, law=Linear(k, c))
    system = System(*(SymmetricMatrix.dense(A) for A in (M, K)), (stop,),
                    C=SymmetricMatrix.dense(C))  # fmt: skip
    t, values = np.array([0.0, 2.0, 5.0, 12.0]), np.array([0.0, 0.5, -0.4, 0.3])
    load = (
        time_history.Harmonic(0, 0.9, 1.7, 0.4),
        time_history.Sampled(np.array([0.0, 1.0]), t, values),
    )
    result = motion(system, [0.0, 0.0], [0.0, 0.5], 12.0, load=load)

    def rate(at: float, z: Any) -> Any:
        x, v = z[:2], z[2:]
        beyond, side = abs(x[1]) - gap, math.copysign(1.0, x[1])
        push = max(0.0, k * beyond + c * side * v[1]) if beyond > 0.0 else 0.0
        f = np.array([0.9 * math.cos(1.7 * at + 0.4), np.interp(at, t, values) - side * push])
        return np.concatenate([v, np.linalg.solve(M, f - K @ x - C @ v)])

    run = solve_ivp(rate, (0.0, 12.0), [0.0, 0.0, 0.0, 0.5], "DOP853", t_eval=result.t,
                    rtol=1e-11, atol=1e-12, max_step=2e-3)  # fmt: skip
    assert result.contact_start is not None
    assert result.contact_start.size > 5
    assert np.abs(result.x - run.y[:2].T).max() < 1e-8
    assert np.max(result.error_x) < 1e-11


def test_the_second_motion_is_the_first() -> None:
    """What was prepared for one motion changes no bit of the next."""
    system = one_mass(Linear(100.0, 1.0), 0.1, K=1.0)
    first, second = (motion(system, [0.0], [1.0], 7.0) for _ in range(2))
    for name in ("x", "v", "energy", "force", "contact_start", "error_x"):
        assert np.array_equal(getattr(first, name), getattr(second, name))


def test_an_ensemble_is_its_motions_alone() -> None:
    """In threads, to the last bit, with tables one after the other."""
    K = SymmetricMatrix.dense(np.array([[2.0, -1.0], [-1.0, 2.0]]))
    stop = Constraint((0,), (1.0,), 0.1, 0.2, law=Linear(300.0, 2.0))
    system = System(SymmetricMatrix.diagonal(np.ones(2)), K, (stop,))
    x, v = np.zeros((40, 2)), np.random.default_rng(5).normal(size=(40, 2))
    times = np.linspace(0.0, 6.0, 5)
    problem = ensemble.Problem(system, x, v, 6.0, times, outputs=ALL)
    many = ensemble.solve(problem, ensemble.plan(problem))
    assert many.contact_offset is not None
    for place in range(40):
        alone = motion(system, x[place], v[place], 6.0, 5)
        first = many.contact_offset[place]
        rows = slice(first, first + many.contact_count[place])
        for name in ("x", "v", "energy", "force", "error_x", "error_force"):
            assert np.array_equal(getattr(many, name)[place], getattr(alone, name)), name
        for name in ("start", "stop", "impulse", "peak_force", "indentation", "energy_lost"):
            found = getattr(many, f"contact_{name}")[rows]
            assert np.array_equal(found, getattr(alone, f"contact_{name}")), name


def chain_between_stops() -> tuple[System, Any]:
    """Return three damped masses, two of them between stops, and velocities."""
    K = 2.0 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1)
    stops = (
        Constraint((0,), (1.0,), 0.1, 0.15, law=Linear(90.0, 0.8)),
        Constraint((2,), (1.0,), None, 0.1, law=Linear(40.0)),
    )
    matrices = (SymmetricMatrix.dense(A) for A in (np.eye(3), K))
    return System(*matrices, stops, C=SymmetricMatrix.dense(0.02 * K)), [1.0, -0.4, 0.7]


FIELDS = (
    "x", "v", "energy", "force", "error_x", "error_force", "contact_start", "contact_stop",
    "contact_impulse", "contact_peak_force", "contact_energy_lost", "error_contact_impulse",
)  # fmt: skip


@pytest.mark.parametrize(
    ("place", "name", "value"),
    [
        (motions_of_stops, "WORK", 3_000),  # so that the loop pauses wherever it can
        (motions_of_stops, "_PHASES", 0),  # and the table of contacts grows again and again
        (scene_table, "ROOM", 1),  # a table is left at each new scene
        (scene_table, "_NUMBERS", 1),  # and its arrays are replaced
    ],
)
def test_pieces_change_no_bit(
    monkeypatch: pytest.MonkeyPatch, place: Any, name: str, value: int
) -> None:
    """Wherever the compiled loop returns, the motion is the same."""
    system, v = chain_between_stops()
    load = (time_history.Harmonic(1, 0.6, 1.3),)
    whole = motion(system, np.zeros(3), v, 20.0, 200, load=load)
    monkeypatch.setattr(place, name, value)
    system, _ = chain_between_stops()  # another one, of which nothing is prepared
    pieces = motion(system, np.zeros(3), v, 20.0, 200, load=load)
    assert whole.contact_start is not None
    assert whole.contact_start.size > 10
    for field in FIELDS:
        assert np.array_equal(getattr(whole, field), getattr(pieces, field)), field


def test_histories_in_parts() -> None:
    """So many samples that they are fetched in several parts are those of fewer."""
    system, v = chain_between_stops()
    many = motion(system, np.zeros(3), v, 20.0, 20_001)
    few = motion(system, np.zeros(3), v, 20.0, 201)
    for name in ("x", "v", "energy", "force"):
        apart = np.abs(getattr(many, name)[::100] - getattr(few, name))
        assert (apart <= getattr(few, f"error_{name}")).all(), name


def test_contacts_beyond_the_first_table() -> None:
    """A mass between springs touches some hundred times; each as the closed form says."""
    m, k, gap, v = 2.0, 300.0, 0.05, 1.5
    wall = Constraint((0,), (1.0,), gap, gap, law=Linear(k))
    system = System(SymmetricMatrix.diagonal([m]), SymmetricMatrix.diagonal([0.0]), (wall,))
    result = motion(system, [0.0], [v], 100.0, 3)
    contact = math.pi * math.sqrt(m / k)
    assert result.contact_start is not None
    count = result.contact_start.size
    assert count > 200
    starts = gap / v + (2.0 * gap / v + contact) * np.arange(count)
    assert (np.abs(result.contact_start - starts) <= result.error_contact_start).all()
    assert result.contact_side is not None
    assert (result.contact_side == np.where(np.arange(count) % 2, -1, 1)).all()


def test_a_stop_far_too_stiff_for_modes_is_named() -> None:
    """The damping of the structure is not what is wrong."""
    n = 10
    K = SymmetricMatrix.bands({0: np.full(n, 2.0), 1: np.full(n - 1, -1.0)})
    C = SymmetricMatrix.dense(0.04 * K.to_dense())
    for stiffness, fails in ((1e3, False), (1e30, True)):
        wall = Constraint((8,), (1.0,), None, 0.01, law=Linear(stiffness))
        system = System(SymmetricMatrix.diagonal(np.ones(n)), K, (wall,), C=C)
        if not fails:
            motion(system, np.zeros(n), np.ones(n), 5.0, 3)
            continue
        with pytest.raises(PlanError, match="the stop of constraint 0 loaded") as refused:
            motion(system, np.zeros(n), np.ones(n), 5.0, 3)
        assert refused.value.pointer == ("system", "constraints", 0, "law")


STOPPED = one_mass(Linear(10.0), 0.1, K=1.0)


@pytest.mark.parametrize(
    ("kind", "make"),
    [
        ("impact-modes", lambda: impact_modes.Problem(STOPPED, np.ones(1))),
        ("existence-bands", lambda: existence_bands.Problem(STOPPED, 1.0, 2.0)),
        ("resonances", lambda: resonances.Problem(STOPPED, 0, 3)),
    ],
)  # fmt: skip
def test_kinds_refuse_laws_that_they_do_not_offer(kind: str, make: Any) -> None:
    with pytest.raises(ModelError) as refused:
        make()
    assert refused.value.code == "law_not_offered"
    assert refused.value.pointer == ("system", "constraints", 0, "law")
    assert refused.value.message == (
        f"{kind} is computed with rigid stops; constraint 0 has a linear one, which is offered by "
        "time-history, ensemble, periodic-motions, branches and attractors"
    )


@pytest.mark.parametrize(
    ("given", "pointer"),
    [
        ({"limiter": time_history.Power(3.0, 1.0)}, ("limiter",)),
        ({"method": "RK45"}, ("method",)),
        ({"digits": 30}, ("digits",)),
    ],
)
def test_what_stops_with_a_stiffness_exclude(given: Any, pointer: Any) -> None:
    with pytest.raises(ModelError) as refused:
        motion(STOPPED, [0.0], [1.0], 1.0, **given)
    assert refused.value.pointer == pointer


def test_a_motion_can_be_stopped() -> None:
    """The meter is looked at at every switching, and within long contacts."""
    calls = list[int]()

    def tick(done: int, _total: int) -> None:
        calls.append(done)
        if len(calls) == 30:
            raise Cancelled

    system = one_mass(Linear(1e4), 0.1, K=1.0)
    state = time_history.State(np.zeros(1), np.ones(1))
    problem = time_history.Problem(system, state, 1e5, outputs=frozenset({"contacts"}))
    with pytest.raises(Cancelled):
        time_history.solve(problem, time_history.plan(problem), tick)
    assert calls == sorted(calls)
    assert calls[-1] < 1000


def test_large_structures_are_refused() -> None:
    n = time_history.MOST_STOPPED + 1
    eye = SymmetricMatrix.diagonal(np.ones(n))
    stop = Constraint((0,), (1.0,), 1.0, 1.0, law=Linear(1.0))
    with pytest.raises(ModelError, match="reduce the model") as refused:
        motion(System(eye, eye, (stop,)), np.zeros(n), np.ones(n), 1.0)
    assert refused.value.pointer == ("system", "constraints", 0, "law")


def test_other_refusals() -> None:
    with pytest.raises(ModelError, match="impact modes are motions between rigid stops"):
        time_history.Problem(STOPPED, time_history.ImpactMode(2.0), 1.0)
    walls = (
        Constraint.at(0, 1.0),
        Constraint((1,), (1.0,), 1.0, 1.0, law=Linear(1.0)),
    )
    eye = SymmetricMatrix.diagonal(np.ones(2))
    with pytest.raises(ModelError, match="rigid stops beside") as refused:
        motion(System(eye, eye, walls), np.zeros(2), np.ones(2), 1.0)
    assert refused.value.pointer == ("system", "constraints", 0)
    rigid = System(eye, eye, walls[:1])
    with pytest.raises(ModelError, match="the stops are rigid"):
        motion(rigid, np.zeros(2), np.ones(2), 1.0, outputs=frozenset({"force"}))


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: Linear(-1.0), "stiffness"),
        (lambda: Linear(math.nan), "stiffness"),
        (lambda: Linear(1.0, -1.0), "damping"),
        (lambda: Linear(1.0, math.inf), "damping"),
        (lambda: Linear(1.0, 1.0, 0.5), "restitution"),
        (lambda: Linear(1.0, restitution=0.0), "restitution"),
        (lambda: Linear(1.0, restitution=1.5), "restitution"),
        (lambda: Rigid(1.5), "restitution"),
        (lambda: Constraint((0,), (1.0,), 1.0, 1.0, 0.5, Linear(1.0)), "restitution"),
    ],
)
def test_bad_laws(make: Any, field: str) -> None:
    with pytest.raises(ModelError) as refused:
        make()
    assert refused.value.pointer == (field,)
