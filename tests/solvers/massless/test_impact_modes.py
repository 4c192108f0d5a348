"""Impact modes and bands with degrees of freedom without mass, against ball arithmetic.

The references take the structure that was condensed by hand, which is exact.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.reference import impact_modes as reference
from tests.reference.balls import UndecidedError
from tests.solvers.massless.condensable import Condensable, condensable
from tests.solvers.structures import referenced
from vibroimpact_solvers import existence_bands, impact_modes
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.plan import Stage

OUTPUTS = frozenset({"impulse", "exists", "reason", "shape", "energy", "stability", "harmonics"})
OMEGA = np.array([0.4, 0.83, 1.3, 2.1, 5.0, 17.0])

LIMITERS = {
    "one": (Constraint.at(0, 0.3),),
    "idle": (Constraint.at(1, 0.3), Constraint.at(0, 0.4)),
    "coupled": (Constraint.at(0, 0.3), Constraint((0, 1), (1.0, -1.0), 0.2, 0.2)),
    "unequal": (Constraint((1,), (1.0,), 0.3, 0.5),),
    "one wall": (Constraint((0,), (1.0,), None, 0.3),),
}


def solved(system: System, active: tuple[int, ...], Omega: Floats) -> impact_modes.Result:
    omega = 2.0 / np.pi * Omega
    problem = impact_modes.Problem(system, omega, active, OUTPUTS, Omega=Omega)
    plan = impact_modes.plan(problem)
    step = plan.step(Stage.SPECTRUM)
    assert step is not None
    assert "no mass: " in step.reason
    return impact_modes.solve(problem, plan)


@pytest.mark.parametrize(("massive", "massless"), [(2, 1), (3, 9), (6, 2), (13, 7)])
@pytest.mark.parametrize("name", LIMITERS)
def test_solutions_are_within_their_errors(name: str, massive: int, massless: int) -> None:
    """Impulses, energy, stability, and displacements of all degrees of freedom."""
    case = condensable(massive, massive, massless, lumped=massive == 6)
    limiters = LIMITERS[name]
    active = (0,) if name == "idle" else tuple(range(len(limiters)))
    result = solved(case.whole(limiters, sparse=massive == 13), active, OMEGA)
    structure, rows = referenced(case.condensed(limiters))
    family = reference.Family(structure, rows, active)
    compared = sum(agrees(result, f, family, case) for f in range(OMEGA.size))
    assert compared >= 4


@pytest.mark.parametrize("seed", range(16))
def test_graded_springs_cost_no_certificate(seed: int) -> None:
    case = condensable(100 + seed, 2 + seed % 4, 1 + seed % 7, graded=True)
    name = list(LIMITERS)[seed % len(LIMITERS)]
    limiters, active = LIMITERS[name], (0,) if name != "coupled" else (0, 1)
    result = solved(case.whole(limiters), active, OMEGA)
    assert result.certified is not None
    assert result.certified.all()
    structure, rows = referenced(case.condensed(limiters))
    family = reference.Family(structure, rows, active)
    assert sum(agrees(result, f, family, case) for f in range(OMEGA.size)) >= 4


def agrees(
    result: impact_modes.Result, f: int, family: reference.Family, case: Condensable
) -> bool:
    """Compare one solution; return whether the reference could tell whether it exists."""
    solution = reference.solved(family, float(OMEGA[f]))
    impulses = [float(solution.impulse[a]) for a in solution.upper]
    assert result.impulse is not None
    upper = [place for place, a in enumerate(family.active) if a in solution.upper]
    doubt = result.impulse_error[f, upper] + 2e-16 * np.abs(impulses).max()
    assert (np.abs(result.impulse[f, upper] - impulses) <= 1.001 * doubt).all()
    assert result.shape is not None
    assert result.shape_error is not None
    shape = np.array([float(x) for x in solution.displacement(1.0)])
    wrong = np.abs(result.shape[f, case.massive] - shape)
    assert (wrong <= 1.001 * result.shape_error[f, case.massive] + 1e-16).all()
    follow = case.static @ shape
    rounding = 4e-16 * (np.abs(case.static) @ np.abs(shape))  # of the sum here
    wrong = np.abs(result.shape[f, case.massless] - follow)
    assert (wrong <= 1.001 * result.shape_error[f, case.massless] + rounding).all()
    assert result.shape_error[f].max() < 1e-9 * np.abs(result.shape[f]).max()
    assert result.energy is not None
    assert result.energy_error is not None
    assert abs(result.energy[f] - float(solution.energy)) <= 1.001 * result.energy_error[f]
    assert result.harmonics is not None
    third = np.array([float(b) for b in solution.harmonic(3)])
    np.testing.assert_allclose(
        result.harmonics[f][list(result.harmonic).index(3)][case.massive], third, atol=1e-12
    )
    try:
        exists = solution.exists()
    except UndecidedError:
        return False
    assert result.certified is not None
    assert result.exists is not None
    if exists is None or not result.certified[f]:
        return False
    assert bool(result.exists[f]) == exists
    if exists and len(family.active) == 1:
        assert result.stability is not None
        assert result.stability_error is not None
        radius = float(solution.radius())
        assert abs(result.stability[f] - radius) <= result.stability_error[f] + 1e-12
    return True


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("seed", range(4))
def test_bands_are_those_of_the_condensed_structure(seed: int) -> None:
    """With equal certificates; the edges are within their errors of each other."""
    case = condensable(20 + seed, 4, 1 + seed)
    limiters = (Constraint.at(seed, 0.3), Constraint.at((seed + 1) % 4, 0.5))
    results = []
    for system in (case.whole(limiters), case.condensed(limiters)):
        problem = existence_bands.Problem(system, 0.3, 6.0, (0,))
        results.append(existence_bands.solve(problem, existence_bands.plan(problem)))
    ours, theirs = results
    assert ours.error_statement == theirs.error_statement
    assert ours.error_statement.startswith("certified")
    assert ours.band_start is not None
    assert theirs.band_start is not None
    assert ours.band_start.size == theirs.band_start.size
    for name in ("band_start", "band_stop"):
        apart = np.abs(getattr(ours, name) - getattr(theirs, name))
        assert (apart <= ours.band_edge_error.max() + theirs.band_edge_error.max()).all()
    np.testing.assert_array_equal(ours.band_certified, theirs.band_certified)
    # The middle of every band exists in ball arithmetic.
    structure, rows = referenced(case.condensed(limiters))
    family = reference.Family(structure, rows, (0,))
    for start, stop in list(zip(ours.band_start, ours.band_stop, strict=True))[:6]:
        assert reference.solved(family, float(0.5 * (start + stop))).exists() is True


def test_a_static_load_shifts_the_rest_position() -> None:
    case = condensable(31, 4, 3)
    limiters = (Constraint.at(1, 0.3),)
    whole, condensed = case.whole(limiters), case.condensed(limiters)
    load = np.array([0.01, -0.02, 0.03, 0.0])
    loaded = System(whole.M, whole.K, whole.constraints, force=case.spread(load))
    by_hand = System(condensed.M, condensed.K, condensed.constraints, force=load)
    ours = solved(loaded, (0,), OMEGA)
    problem = impact_modes.Problem(by_hand, 2.0 / np.pi * OMEGA, (0,), OUTPUTS, Omega=OMEGA)
    theirs = impact_modes.solve(problem, impact_modes.plan(problem))
    assert ours.shape is not None
    assert theirs.shape is not None
    np.testing.assert_allclose(ours.impulse, theirs.impulse, rtol=1e-11)
    np.testing.assert_array_equal(ours.exists, theirs.exists)
    np.testing.assert_allclose(ours.shape[:, case.massive], theirs.shape, atol=1e-12)
