"""Motions without load and loss, with several impacts per period, against motions of 60 digits."""

from __future__ import annotations

import numpy as np
import pytest

from tests.reference.impact_modes import Limiter
from tests.reference.rigid import RigidMotion, Structure
from vibroimpact_solvers import branches, existence_bands, impact_modes
from vibroimpact_solvers import periodic_motions as driven
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.results.branches import TYPES

K = np.array([[2.0, -1.0], [-1.0, 2.0]])
UPPER = driven.Impact(0, 1)


def structure(lower: float | None = 1.0, other: Constraint | None = None) -> System:
    first = Constraint((0,), (1.0,), lower, 1.0)
    constraints = (first,) if other is None else (first, other)
    return System(SymmetricMatrix.diagonal(np.ones(2)), SymmetricMatrix.dense(K), constraints)


def solved(system: System, Omega: float, sequence: object, **more: object) -> driven.Result:
    given: dict[str, object] = {"outputs": frozenset({"exists", "energy", "stability"})} | more
    problem = driven.Problem(system, np.array([Omega]), sequence=sequence, **given)  # type: ignore[arg-type]
    return driven.solve(problem, driven.plan(problem))


def state(result: driven.Result, row: int, t: float) -> tuple[np.ndarray, np.ndarray]:
    """Return displacements and velocities at a time: the sum of the impulses' responses.

    Of one mode ``cos(w (s - T/2)) / (2 w sin(w T/2))``, s being the time since the impulse.
    """
    T = 2.0 * np.pi / float(result.solution_Omega[row])
    values, shapes = np.linalg.eigh(K)
    w, half = np.sqrt(values), np.sqrt(values) * T / 2.0
    x, v = np.zeros(2), np.zeros(2)
    for k in np.flatnonzero(result.impact_solution == row):
        s = np.mod(t - result.impact_phase[k] * T / (2.0 * np.pi), T)
        p = -result.impact_side[k] * result.impact_momentum[k]
        part = p * shapes[result.impact_constraint[k]] / (2.0 * np.sin(half))
        x += shapes @ (part * np.cos(w * s - half) / w)
        v -= shapes @ (part * np.sin(w * s - half))
    return x, v


def assert_repeats(system: System, result: driven.Result, row: int) -> None:
    """Compare a period with the motion of the reference from a state between two impacts."""
    T = 2.0 * np.pi / float(result.solution_Omega[row])
    mine = result.impact_solution == row
    times = np.sort(result.impact_phase[mine] * T / (2.0 * np.pi))
    begin = 0.5 * (times[0] + np.append(times, T)[1])
    x, v = state(result, row, begin)
    walls = [Limiter(np.eye(2)[c.dofs[0]], c.lower, c.upper) for c in system.constraints]
    motion = RigidMotion(Structure(np.eye(2), K), walls, [1.0] * len(walls), x, v)
    history = motion.run(T, [T * (1.0 - 1e-15)])
    assert len(history.impacts) == times.size
    # Errors of the state grow by the impacts as the multipliers tell.
    allowed = 1e-12 * max(1.0, float(result.solution_stability[row])) ** times.size
    order = np.argsort(np.mod(result.impact_phase[mine] * T / (2.0 * np.pi) - begin, T))
    for k, impact in zip(np.flatnonzero(mine)[order], history.impacts, strict=True):
        expected = np.mod(result.impact_phase[k] * T / (2.0 * np.pi) - begin, T)
        assert float(impact.time) == pytest.approx(expected, abs=1e3 * allowed)
        assert impact.constraint == result.impact_constraint[k]
        assert impact.side == result.impact_side[k]
        assert float(impact.impulse) == pytest.approx(result.impact_momentum[k], abs=1e3 * allowed)
    end = history.states[0]
    assert [float(end[i, 0]) for i in range(2)] == pytest.approx(x, abs=1e3 * allowed)
    assert [float(end[i, 0]) for i in range(2, 4)] == pytest.approx(v, abs=1e3 * allowed)
    energy = 0.5 * (x @ K @ x + v @ v)
    assert energy == pytest.approx(result.solution_energy[row], rel=1e-12)


def test_a_phantom_of_one_impact_goes_on_as_a_motion_of_three() -> None:
    """Its path passes the wall twice; with impacts there, it keeps the limit."""
    system = structure(lower=None)
    phantom = solved(system, 0.635, (UPPER,))
    assert phantom.solution_reason.tolist() == [3]  # penetration
    w = float(phantom.solution_witness[0])
    phases = 2.0 * np.pi * np.array([[0.0, w, 1.0 - w]])
    three = solved(system, 0.635, (UPPER,) * 3, phases=phases)
    assert three.solution_exists.tolist() == [True]
    assert (three.impact_momentum[1:] < 0.02 * three.impact_momentum[0]).all()
    assert_repeats(system, three, 0)


@pytest.mark.parametrize(
    ("impacts", "Omega"), [(3, 0.64), (2, 0.3), (2, 0.45), (2, 0.64), (2, 0.8)]
)
def test_each_motion_is_listed_once_wherever_it_begins(impacts: int, Omega: float) -> None:
    system = structure(lower=None)
    result = solved(system, Omega, (UPPER,) * impacts)
    spaces = np.diff(result.impact_phase.reshape(-1, impacts), axis=1, append=2.0 * np.pi)
    both = np.stack([result.impact_momentum.reshape(-1, impacts), spaces], axis=-1)
    turned = np.stack([np.roll(both, s, axis=1) for s in range(impacts)])
    assert len(both) > 2
    for one in range(len(both)):
        apart = np.abs(turned - both[one]).max(axis=(2, 3)).min(axis=0)
        assert np.flatnonzero(apart < 1e-6).tolist() == [one]
    for row in np.flatnonzero(result.solution_exists):
        assert_repeats(system, result, int(row))


@pytest.mark.parametrize("unit", [1.0, 10.0])
def test_motions_at_a_frequency_are_those_of_the_one_before(unit: float) -> None:
    """From random times alone, one of ten is missed at the second frequency."""
    system = System(
        SymmetricMatrix.diagonal(np.ones(2)), SymmetricMatrix.dense(unit**2 * K),
        (Constraint((0,), (1.0,), None, 1.0),),
    )  # fmt: skip
    Omega = unit * np.array([0.3, 0.3001])
    problem = driven.Problem(system, Omega, sequence=(UPPER,) * 3, outputs=frozenset({"exists"}))
    result = driven.solve(problem, driven.plan(problem))
    first, second = (result.solution_frequency_index == k for k in range(2))
    assert first.sum() >= 10
    phases = result.impact_phase.reshape(-1, 3)
    apart = np.abs(phases[first][:, np.newaxis] - phases[second]).max(axis=2)
    assert apart.min(axis=1).max() < 0.1


@pytest.mark.parametrize("impacts", [1, 2, 3])
def test_rest_at_a_wall_is_no_motion(impacts: int) -> None:
    def system(gap: float) -> System:
        return System(
            SymmetricMatrix.diagonal(np.ones(2)), SymmetricMatrix.dense(K),
            (Constraint((0,), (1.0,), None, gap),),
        )  # fmt: skip

    sequence = (UPPER,) * impacts
    assert solved(system(0.0), 0.64, sequence).solution_Omega.size == 0
    assert along(system(0.0), sequence, 0.62, 0.66).solution_Omega.size == 0

    def at(gap: float) -> driven.Problem:
        return driven.Problem(
            system(gap), np.array([0.64]), sequence=sequence, outputs=frozenset({"exists"})
        )

    problem = branches.Problem(at, 0.0, 1.0, system(1.0), points=25, step=0.2)
    result = branches.solve(problem, branches.plan(problem))
    first = result.solution_branch[result.impact_solution] == 0
    gaps = result.solution_parameter[result.impact_solution[first]]
    # Of a linear structure with one wall all motions are like their gap.
    largest = np.abs(result.impact_momentum[first]).max()
    sizes = np.abs(result.impact_momentum[first]).reshape(-1, impacts).max(axis=1)
    assert sizes == pytest.approx(largest * gaps.reshape(-1, impacts)[:, 0], rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(
    ("sequence", "Omega"),
    [
        ((UPPER, driven.Impact(0, -1)), 1.4),  # one that has lost its symmetry in time
        ((UPPER, driven.Impact(1, -1)), 1.1),  # two coordinates, unstable
        ((UPPER, driven.Impact(1, -1)), 1.6),
    ],
)
def test_motions_with_two_impacts(sequence: tuple[driven.Impact, ...], Omega: float) -> None:
    system = structure(other=Constraint((1,), (1.0,), 0.9, 0.9))
    if all(impact.constraint == 0 for impact in sequence):
        system = structure()
    result = solved(system, Omega, sequence)
    rows = np.flatnonzero(result.solution_exists & result.solution_certified)
    assert rows.size
    for row in rows:
        assert_repeats(system, result, int(row))


def along(system: System, sequence: object, start: float, stop: float) -> branches.Result:
    outputs = frozenset({"exists", "energy", "stability"})
    problem = branches.Problem(
        lambda Omega: driven.Problem(system, np.array([Omega]), sequence=sequence, outputs=outputs),  # type: ignore[arg-type]
        start, stop, system, frequency=True, step=0.1,
    )  # fmt: skip
    return branches.solve(problem, branches.plan(problem))


def points(result: branches.Result, kind: str) -> np.ndarray:
    of = result.point_type == TYPES.index(kind)
    return np.asarray(np.unique(result.point_parameter[of].round(9)))


def test_a_motion_at_a_resonance_does_not_move_the_ends_of_branches() -> None:
    """It is the one in the middle of those at which branches begin."""
    one = SymmetricMatrix.diagonal([1.0])
    system = System(one, one, (Constraint((0,), (1.0,), None, 1.0),))
    result = along(system, (UPPER,), 1.2, 2.8)
    rows = np.flatnonzero(result.solution_parameter != 2.0)
    first = np.abs(result.impact_momentum[result.solution_branch[result.impact_solution] == 0])
    assert 1e3 < first.max() < 1e5
    assert rows.size < 700


def test_a_branch_without_load_is_listed_once_however_impulses_grow() -> None:
    """They are like the gap, over five orders of magnitude."""

    def at(gap: float) -> driven.Problem:
        system = System(
            SymmetricMatrix.diagonal(np.ones(2)), SymmetricMatrix.dense(K),
            (Constraint((0,), (1.0,), None, gap),),
        )  # fmt: skip
        return driven.Problem(system, np.array([1.3]), outputs=frozenset({"exists"}))

    problem = branches.Problem(at, 1e-5, 1.0, structure(lower=None), step=0.1)
    result = branches.solve(problem, branches.plan(problem))
    assert set(result.solution_branch) == {0}
    assert result.solution_parameter[[0, -1]] == pytest.approx([1e-5, 1.0], rel=1e-9)


def radius(system: System, Omega: float) -> float:
    """Return the spectral radius of the impact mode, by another map and other kernels."""
    problem = impact_modes.Problem(
        system, np.array([Omega * 2.0 / np.pi]), Omega=np.array([Omega]),
        outputs=frozenset({"stability"}),
    )  # fmt: skip
    return float(impact_modes.solve(problem, impact_modes.plan(problem)).stability[0])


@pytest.fixture(scope="module")
def backbone() -> branches.Result:
    return along(structure(), driven.SYMMETRIC, 1.2, 1.26)


def test_the_backbone_is_the_family_of_impact_modes(backbone: branches.Result) -> None:
    Omega = backbone.solution_Omega
    family = impact_modes.Problem(
        structure(), Omega * 2.0 / np.pi, Omega=Omega, outputs=frozenset({"energy"})
    )
    expected = impact_modes.solve(family, impact_modes.plan(family))
    assert expected.energy is not None
    assert expected.energy_error is not None
    assert backbone.solution_energy is not None
    apart = np.abs(backbone.solution_energy - expected.energy)
    # Points of a branch are solved to 1e-12 of the terms of their equations.
    assert (apart <= 1e-9 * expected.energy).all()
    assert Omega.size > 5


def test_symmetry_is_lost_where_the_impact_mode_becomes_stable(backbone: branches.Result) -> None:
    system = structure()
    (lost,) = points(backbone, "symmetry")
    low, high = 1.2, 1.26
    assert radius(system, low) > 1.01
    assert radius(system, high) == 1.0
    while high - low > 1e-7:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if radius(system, middle) > 1.0 else (low, middle)
    # Multipliers leave 1 like a root, and within 1e-6 of here not beyond their errors.
    assert lost == pytest.approx(low, abs=5e-6)
    other = along(system, (UPPER, driven.Impact(0, -1)), 1.22, 1.26)
    assert points(other, "symmetry") == pytest.approx([lost], abs=1e-8)
    assert not points(other, "torus").size


@pytest.mark.parametrize("seed", [0, 1])
def test_stability_is_lost_where_two_pairs_of_multipliers_meet(seed: int) -> None:
    rng = np.random.default_rng(seed)
    k = rng.uniform(0.5, 3.0, 4)
    chain = np.diag(k[:3] + k[1:]) - np.diag(k[1:3], 1) - np.diag(k[1:3], -1)
    masses = SymmetricMatrix.diagonal(rng.uniform(0.5, 2.0, 3))
    wall = Constraint((0,), (1.0,), None, 1.0)
    system = System(masses, SymmetricMatrix.dense(chain), (wall,))
    low, high = ((1.65, 1.655), (1.1215, 1.1232))[seed]

    def outside(Omega: float) -> bool:
        return radius(system, Omega) > 1.001

    if not outside(high):
        low, high = high, low
    result = along(system, (UPPER,), min(low, high), max(low, high))
    assert outside(high)
    assert not outside(low)
    while abs(high - low) > 1e-9:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if outside(middle) else (middle, high)
    (torus,) = np.flatnonzero(result.point_type == TYPES.index("torus"))
    # The radius grows like a root: its square is a straight line that begins at the point.
    point, error, side = result.point_parameter[torus], result.point_error[torus], high - low
    step = 1e-8 * np.sign(side)
    near, far = (radius(system, point + d) - 1.0 for d in (step, 2.0 * step))
    begin = point + step * (far**2 - 2.0 * near**2) / (far**2 - near**2)
    assert begin == pytest.approx(point, abs=error + 1e-12)
    assert error < 1e-11


def test_the_backbone_ends_with_its_existence_band() -> None:
    result = along(structure(), driven.SYMMETRIC, 1.4, 1.45)
    problem = existence_bands.Problem(structure(), 1.4, 1.45)
    bands = existence_bands.solve(problem, existence_bands.plan(problem))
    (end,) = points(result, "end")
    assert end == pytest.approx(bands.band_stop, abs=1e-9)


def test_impulses_without_bound_end_a_branch() -> None:
    """Nothing limits the motion at a resonance: the branch ends, the frequency does not."""
    result = along(structure(), driven.SYMMETRIC, 1.4, 1.5)
    largest = result.impact_momentum.max()
    assert 1e3 < largest / np.abs(result.impact_momentum[:2]).max() < 1e4
    assert result.solution_Omega.size < 1000
    assert points(result, "fold").size == 0
