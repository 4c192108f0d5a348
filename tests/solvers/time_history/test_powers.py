"""Stops with Hertz's law and a power law in time histories."""

from __future__ import annotations

import math
from typing import Any

import mpmath as mp
import numpy as np
import pytest

from tests.reference.powers import PowerMotion, Wall
from tests.solvers.time_history.test_stops import ALL, motion, one_mass
from vibroimpact_solvers import ensemble, existence_bands, time_history
from vibroimpact_solvers.errors import Cancelled, ModelError
from vibroimpact_solvers.laws import Hertz, Linear, Power, Rigid
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

COLUMNS = ("start", "stop", "velocity", "impulse", "peak_force", "indentation", "energy_lost")
NEAR = 3e-11  # to which the integrator knows a number, relative to its size


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("tolerance", [1e-6, 1e-12])
@pytest.mark.parametrize(
    ("law", "n"),
    [
        (Hertz(450.0), 1.5), (Power(450.0, 1.0), 1.0), (Power(9e3, 1.25), 1.25),
        (Power(30.0, 2.0), 2.0), (Power(450.0, 5.5), 5.5), (Power(450.0, 30.0), 30.0),
    ],
)  # fmt: skip
def test_a_free_mass_at_a_stop(law: Any, n: float, tolerance: float) -> None:
    """Energy gives the depth, a quadrature of it the duration (Johnson, Contact Mechanics, 11)."""
    m, k, v = 2.0, law.stiffness, 3.0
    result = motion(one_mass(law, upper=0.5), [0.2], [v], 3.0, tolerance=tolerance)
    deep = ((n + 1.0) * m * v * v / (2.0 * k)) ** (1.0 / (n + 1.0))
    # The speed is v (1 - s^(n + 1))^(1/2) at the part s of the depth; with 1 - s = u^2:
    part = mp.quad(lambda u: 2 * u / mp.sqrt(-mp.expm1((n + 1) * mp.log1p(-u * u))), [0, 1])
    duration = 2.0 * deep / v * float(part)
    if n == 1.5:
        assert duration == pytest.approx(2.94328 * deep / v, rel=1e-5)
    assert deep + duration < 3.0
    for name, true in (
        ("start", 0.1), ("stop", 0.1 + duration), ("velocity", v), ("impulse", 2.0 * m * v),
        ("peak_force", k * deep**n), ("indentation", deep), ("energy_lost", 0.0),
    ):  # fmt: skip
        value = getattr(result, f"contact_{name}")
        error = getattr(result, f"error_contact_{name}")
        assert value.shape == error.shape == (1,)
        assert abs(value[0] - true) <= error[0], name
        assert error[0] <= 300.0 * n * tolerance * max(abs(true), 1.0), name
    assert result.v is not None
    assert result.v[-1, 0] == pytest.approx(-v, rel=tolerance)
    assert result.error_energy_drift is not None
    assert result.error_energy_drift < tolerance


class Case:
    """A random structure with one to three stops, or a motion of it by both methods."""

    def __init__(self, seed: int) -> None:
        g = np.random.default_rng(seed)
        n = int(g.integers(1, 11))
        A, B = g.normal(size=(2, n, n))
        M = np.eye(n) + 0.2 * (A @ A.T) / n if g.random() < 0.6 else np.diag(g.uniform(0.5, 2, n))
        K = g.uniform(0.5, 2) * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
        if g.random() < 0.15:
            K = np.zeros((n, n))
        C = (np.zeros((n, n)), 0.02 * K + 0.01 * M, 0.05 * (B @ B.T) / n)[int(g.integers(3))]
        self.matrices = M, C, K
        self.force = g.normal(size=n) * 0.1 if g.random() < 0.5 else np.zeros(n)
        self.loads = []
        if g.random() < 0.5:
            load = g.normal() * 0.5, g.uniform(0.3, 2), g.uniform(0, 6)
            self.loads.append((int(g.integers(n)), *map(float, load)))
        self.constraints, self.walls = [], []
        for dof in g.choice(n, min(n, int(g.integers(1, 4))), replace=False).tolist():
            self._add_stop(g, dof, n)
        if all(isinstance(c.law, Linear) for c in self.constraints):
            self.constraints[0] = Constraint((0,), (1.0,), None, 0.1, law=Hertz(300.0))
            row = np.eye(n)[0]
            self.walls = [Wall(row, 1, 0.1, 300.0, 1.5)]
            self.constraints = self.constraints[:1]
        self.x, self.v = g.normal(size=n) * 0.05, g.normal(size=n)
        self.times = np.linspace(0.0, float(g.uniform(5, 15)), 31)

    def _add_stop(self, g: np.random.Generator, dof: int, n: int) -> None:
        choice, k = g.random(), float(10 ** g.uniform(0, 5))
        exponent = float(g.choice([1.0, 1.25, 2, 2.5, 3, 4, 5.5]))
        law: Any = Hertz(k) if choice < 0.5 else Power(k, exponent) if choice < 0.85 else Linear(k)
        exponent = 1.5 if choice < 0.5 else exponent if choice < 0.85 else 1.0
        upper = float(g.uniform(-0.1, 0.5))
        lower = float(g.uniform(0.15, 0.6)) if g.random() < 0.4 else None
        dofs, weights = (dof,), (1.0 if g.random() < 0.8 else -0.7,)
        if n > 2 and g.random() < 0.3:
            dofs, weights = (dof, (dof + 1) % n), (*weights, -0.5)  # type: ignore[assignment]
        self.constraints.append(Constraint(dofs, weights, lower, upper, law=law))
        row = np.zeros(n)
        row[list(dofs)] = weights
        self.walls.append(Wall(row, 1, upper, k, exponent))
        if lower is not None:
            self.walls.append(Wall(row, -1, lower, k, exponent))

    def problem(self, tolerance: float) -> time_history.Problem:
        M, C, K = map(SymmetricMatrix.dense, self.matrices)
        damping = C if self.matrices[1].any() else None
        system = System(M, K, tuple(self.constraints), C=damping, force=self.force)
        return time_history.Problem(
            system, time_history.State(self.x, self.v), float(self.times[-1]), t=self.times,
            outputs=ALL, tolerance=tolerance,
            load=tuple(time_history.Harmonic(*load) for load in self.loads),
        )  # fmt: skip


def covered(value: Any, error: Any, true: Any, size: float) -> bool:
    """Whether errors are those of values, as far as the integrator knows."""
    off = np.abs(np.asarray(value) - true)
    return bool((off <= error + NEAR * (size + np.abs(true))).all())


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("seed", [*range(14), 46, 52])
def test_random_structures_against_an_integrator(seed: int) -> None:
    """Each output lies within its stated error, and contacts are the same ones in their order."""
    case = Case(seed)
    problem = case.problem(1e-6)
    result = time_history.solve(problem, time_history.plan(problem))
    true = PowerMotion(case.matrices, case.force, case.loads, case.walls).run(
        case.x, case.v, case.times
    )
    assert result.error_predictable_until == problem.t_end
    assert covered(result.x, result.error_x, true.x, 1.0)
    assert covered(result.v, result.error_v, true.v, 1.0)
    M, _, K = case.matrices
    energy = 0.5 * ((true.v @ M) * true.v).sum(axis=1) - true.x @ case.force
    energy += 0.5 * ((true.x @ K) * true.x).sum(axis=1)
    force, of = np.zeros((len(case.times), len(case.constraints))), list[int]()
    for a, constraint in enumerate(case.constraints):
        of += [a] * ((constraint.lower is not None) + (constraint.upper is not None))
    for a, wall in zip(of, case.walls, strict=True):
        deep = np.maximum(wall.side * true.x @ wall.row - wall.place, 0.0)
        force[:, a] += wall.stiffness * deep**wall.exponent
        energy += wall.stiffness * deep ** (wall.exponent + 1) / (wall.exponent + 1)
    stiffest = max(wall.stiffness for wall in case.walls)
    assert covered(result.energy, result.error_energy, energy, 10.0)
    assert covered(result.force, result.error_force, force, stiffest)
    struck = [case.walls[phase.wall] for phase in true.phases]
    assert result.contact_constraint is not None
    assert result.contact_side is not None
    assert result.contact_constraint.tolist() == [of[phase.wall] for phase in true.phases]
    assert result.contact_side.tolist() == [wall.side for wall in struck]
    deep = np.array([phase.indentation for phase in true.phases])
    expected = {
        "start": [phase.start for phase in true.phases],
        "stop": [phase.stop for phase in true.phases],
        "velocity": [w.side * p.velocity for p, w in zip(true.phases, struck, strict=True)],
        "impulse": [phase.impulse for phase in true.phases],
        "indentation": deep,
        "peak_force": [w.stiffness * d**w.exponent for d, w in zip(deep, struck, strict=True)],
        "energy_lost": np.zeros(len(struck)),
    }
    for name, values in expected.items():
        value, error = (getattr(result, f"{kind}contact_{name}") for kind in ("", "error_"))
        size = stiffest if name == "peak_force" else 10.0
        assert covered(value, error, np.array(values), size), name
        assert np.isfinite(error).all(), name


@pytest.mark.needs("compiled kernels")
def test_an_exponent_of_one_is_a_linear_stop() -> None:
    """The exact motion of a linear stop lies within the errors of the series."""
    n = 3
    K = SymmetricMatrix.dense(2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    M, v = SymmetricMatrix.diagonal(np.ones(n)), np.array([1.0, 0.0, -0.5])
    one, other = (
        motion(System(M, K, (Constraint((0,), (1.0,), 0.2, 0.3, law=law),)), np.zeros(n), v, 30.0)
        for law in (Power(200.0, 1.0), Linear(200.0))
    )
    for name in ("x", "v", "energy", "force", *(f"contact_{column}" for column in COLUMNS)):
        off = np.abs(getattr(one, name) - getattr(other, name))
        # A loss of zero is exact, and what is left of two numbers a rounding.
        assert (off <= getattr(one, f"error_{name}") + 1e-13).all(), name


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("k", [1e-6, 1.0, 1e6, 1e12, 1e18])
def test_no_contact_is_missed_however_short(k: float) -> None:
    """A mass between two walls meets each in turn; the time of a round follows from energy."""
    wall = Constraint((0,), (1.0,), 1.0, 1.0, law=Hertz(k))
    one = SymmetricMatrix.diagonal([1.0])
    system = System(one, SymmetricMatrix.diagonal([0.0]), (wall,))
    deep = (1.25 / k) ** 0.4
    half = 2.0 + 2.943275 * deep
    t_end = 40.5 * half
    result = motion(system, [0.0], [1.0], t_end, count=2)
    assert result.contact_side is not None
    assert result.contact_start is not None
    assert result.contact_side.tolist() == [1 - 2 * (i % 2) for i in range(41)]
    starts = 1.0 + half * np.arange(41)
    np.testing.assert_allclose(result.contact_start, starts, rtol=1e-5)


@pytest.mark.needs("compiled kernels")
def test_a_touch_is_no_deeper_than_its_error() -> None:
    """x = sin t turns at the wall 1 - h: the depth is h, but for the force of the stop."""
    for h in (1e-3, 1e-6, 1e-9, 1e-12):
        wall = Constraint((0,), (1.0,), None, 1.0 - h, law=Hertz(1.0))
        one = SymmetricMatrix.diagonal([1.0])
        system = System(one, one, (wall,))
        result = motion(system, [0.0], [1.0], 3.0, tolerance=1e-9)
        assert result.contact_indentation is not None
        assert result.error_contact_indentation is not None
        assert result.contact_indentation.size == 1
        bound = result.error_contact_indentation[0] + h**1.5
        assert abs(result.contact_indentation[0] - h) <= bound
        assert result.error_contact_start is not None
        if h < result.error_contact_indentation[0]:
            assert math.isinf(result.error_contact_start[0])


@pytest.mark.needs("compiled kernels")
def test_rest_on_a_stop() -> None:
    """A damped mass comes to rest where its stop bears its weight, in a phase without an end."""
    weight, k = 3.0, 200.0
    system = one_mass(Hertz(k), force=weight)
    C, load = SymmetricMatrix.diagonal([4.0]), np.array([weight])
    damped = System(system.M, system.K, system.constraints, C=C, force=load)
    result = motion(damped, [-0.4], [0.0], 60.0, count=4)
    assert result.force is not None
    assert result.x is not None
    assert result.contact_stop is not None
    assert result.force[-1, 0] == pytest.approx(weight, rel=1e-9)
    assert result.x[-1, 0] == pytest.approx((weight / k) ** (2.0 / 3.0), rel=1e-9)
    assert result.contact_stop[-1] == 60.0


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize(("x", "v"), [(0.0, 0.0), (0.0, 1.0), (0.3, 0.0), (0.3, -1.0), (0.0, -1.0)])
def test_starts_at_and_beyond_the_wall(x: float, v: float) -> None:
    """With the weight on the stop: contacts at the start begin at 0, and energy is kept."""
    result = motion(one_mass(Hertz(50.0), force=2.0), [x], [v], 3.0)
    assert result.contact_start is not None
    assert result.energy is not None
    assert result.error_energy is not None
    if x > 0.0 or v > 0.0:
        assert result.contact_start[0] == 0.0
    elif v == 0.0:
        assert 0.0 <= result.contact_start[0] < 1e-6
    else:
        assert result.contact_start[0] == pytest.approx(2.0, rel=1e-6)  # 2 v m / f
    assert (np.abs(result.energy - result.energy[0]) <= result.error_energy).all()
    assert result.error_energy.max() < 1e-4


@pytest.mark.needs("compiled kernels")
def test_sampled_loads() -> None:
    """A load of straight lines is the constant one that it is, and the harmonic one nearly so."""
    K, t = 3.0, np.linspace(0.0, 12.0, 7)
    held = motion(one_mass(Hertz(80.0), 0.2, K, force=1.5), [0.0], [1.0], 12.0)
    line = time_history.Sampled(np.ones(1), t, np.full(7, 1.5))
    sampled = motion(one_mass(Hertz(80.0), 0.2, K), [0.0], [1.0], 12.0, load=(line,))
    fine = np.linspace(0.0, 12.0, 1201)
    wave = time_history.Sampled(np.ones(1), fine, np.cos(1.1 * fine))
    driven = time_history.Harmonic(0, 1.0, 1.1, 0.0)
    one, other = (
        motion(one_mass(Hertz(80.0), 0.2, K), [0.0], [1.0], 12.0, load=(load,))
        for load in (wave, driven)
    )
    np.testing.assert_allclose(sampled.x, held.x, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(sampled.contact_start, held.contact_start, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(one.x, other.x, rtol=0.0, atol=3e-4)


@pytest.mark.needs("compiled kernels")
def test_an_ensemble_is_its_motions_alone() -> None:
    system, v = one_mass(Hertz(50.0), 0.1, K=4.0), np.linspace(0.05, 3.0, 40)[:, np.newaxis]
    shared: dict[str, Any] = {"t_end": 6.0, "t": np.linspace(0.0, 6.0, 4), "outputs": ALL}
    problem = ensemble.Problem(system, np.zeros_like(v), v, **shared)
    together = ensemble.solve(problem, ensemble.plan(problem))
    assert together.x is not None
    assert together.contact_count is not None
    assert together.contact_impulse is not None
    assert together.contact_offset is not None
    for row in (0, 7, 39):
        alone = motion(system, [0.0], v[row], 6.0, count=4)
        np.testing.assert_array_equal(together.x[row], alone.x)
        first, count = together.contact_offset[row], together.contact_count[row]
        np.testing.assert_array_equal(
            together.contact_impulse[first : first + count], alone.contact_impulse
        )


@pytest.mark.needs("compiled kernels")
def test_outputs_do_not_depend_on_one_another() -> None:
    """States are those of the same steps, whatever else is asked for; so are contacts."""
    system = one_mass(Hertz(50.0), 0.1, K=4.0)
    every = motion(system, [0.0], [1.0], 9.0)
    for name in ("x", "v", "energy", "force"):
        alone = motion(system, [0.0], [1.0], 9.0, outputs=frozenset({name}))
        np.testing.assert_allclose(getattr(alone, name), getattr(every, name), rtol=0, atol=1e-7)
        assert alone.contact_start is None
    contacts = motion(system, [0.0], [1.0], 9.0, outputs=frozenset({"contacts"}))
    for column in COLUMNS:
        name = f"contact_{column}"
        np.testing.assert_array_equal(getattr(contacts, name), getattr(every, name))
    silent = motion(system, [0.0], [1.0], 9.0, estimate=False)
    assert silent.error_contact_start is None
    np.testing.assert_allclose(silent.contact_start, every.contact_start, rtol=1e-6)


@pytest.mark.needs("compiled kernels")
def test_contacts_beyond_the_first_table() -> None:
    wall = Constraint((0,), (1.0,), 0.01, 0.01, law=Hertz(1e6))
    one = SymmetricMatrix.diagonal([1.0])
    system = System(one, SymmetricMatrix.diagonal([0.0]), (wall,))
    result = motion(system, [0.0], [1.0], 8.0, count=2)
    assert result.contact_side is not None
    assert result.contact_side.size > 200
    assert (result.contact_side[1:] == -result.contact_side[:-1]).all()


@pytest.mark.parametrize(
    "make",
    [
        lambda: Hertz(-1.0), lambda: Hertz(math.nan), lambda: Hertz(1e300),
        lambda: Power(1.0, 0.5), lambda: Power(1.0, math.nan), lambda: Power(1.0, 1e3),
        lambda: Power(math.inf, 2.0),
    ],
)  # fmt: skip
def test_numbers_out_of_range(make: Any) -> None:
    with pytest.raises(ModelError):
        make()


def test_what_is_not_offered() -> None:
    system = one_mass(Hertz(1.0), 0.1, K=1.0)
    with pytest.raises(ModelError, match="offered by time-history and ensemble"):
        existence_bands.Problem(system, 0.5, 1.5)
    one, (stop,) = SymmetricMatrix.diagonal(np.ones(2)), system.constraints
    other = Constraint((1,), (1.0,), 0.5, None, law=Linear(1.0, damping=0.1))
    with pytest.raises(ModelError, match="without damping only") as refused:
        motion(System(one, one, (stop, other)), [0.0, 0.0], [1.0, 0.0], 1.0)
    assert refused.value.pointer == ("system", "constraints", 1, "law")
    hard = Constraint((1,), (1.0,), 0.5, None, law=Rigid(0.5))
    with pytest.raises(ModelError, match="rigid stops beside"):
        motion(System(one, one, (stop, hard)), [0.0, 0.0], [1.0, 0.0], 1.0)


@pytest.mark.needs("compiled kernels")
def test_a_motion_can_be_stopped() -> None:
    def tick(done: int, total: int) -> None:
        if done:
            raise Cancelled

    wall = Constraint((0,), (1.0,), 0.1, 0.1, law=Hertz(1e3))
    one = SymmetricMatrix.diagonal([1.0])
    system = System(one, one, (wall,))
    state = time_history.State(np.zeros(1), np.ones(1))
    problem = time_history.Problem(system, state, 1e5, outputs=frozenset({"contacts"}))
    with pytest.raises(Cancelled):
        time_history.solve(problem, time_history.plan(problem), tick)
