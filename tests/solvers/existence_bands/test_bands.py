"""Bands against impact modes solved one by one, closed forms, and scans for missed bands."""

from __future__ import annotations

import numpy as np
import pytest

from tests.solvers.beams import OMEGA, cantilever
from tests.solvers.structures import chain, random_system
from vibroimpact_solvers import existence_bands as bands
from vibroimpact_solvers import impact_modes as modes
from vibroimpact_solvers import presets
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.existence_bands import Edge, Result, stability_ranges
from vibroimpact_solvers.existence_bands.search import SearchedBands
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System


def solved(system: System, start: float, stop: float, **more: object) -> Result:
    problem = bands.Problem(system, start, stop, **more)
    return bands.solve(problem, bands.plan(problem))


def exists(system: System, Omega: np.ndarray, active: tuple[int, ...] = ()) -> np.ndarray:
    """Existence of impact modes, each by a check of its path."""
    problem = modes.Problem(system, Omega * (2 / np.pi), active, frozenset({"exists"}), Omega=Omega)
    answer = modes.solve(problem, modes.plan(problem)).exists
    assert answer is not None
    return answer


def inside(result: Result, Omega: np.ndarray) -> np.ndarray:
    assert result.band_start is not None
    assert result.band_stop is not None
    place = np.searchsorted(result.band_start, Omega) - 1
    return (place >= 0) & (Omega < result.band_stop[np.maximum(place, 0)])


def clear_of_edges(result: Result, Omega: np.ndarray, distance: float) -> np.ndarray:
    edges = np.concatenate([result.band_start, result.band_stop])
    return np.abs(Omega[:, None] / edges - 1).min(axis=1) > distance


def scan(result: Result, system: System, Omega: np.ndarray, active: tuple[int, ...] = ()) -> None:
    # Impact modes exist up to 1e-10 of the gap beyond a limit: edges differ by that much.
    some = Omega[clear_of_edges(result, Omega, 1e-7)]
    assert some.size > 0.99 * Omega.size
    np.testing.assert_array_equal(exists(system, some, active), inside(result, some))


@pytest.mark.needs("compiled kernels")
def test_the_chain_of_the_figures() -> None:
    system = chain()
    result = solved(system, 0.2, 3.0)
    assert result.band_certified is not None
    assert result.band_certified.all()
    assert result.unresolved_start.size == 0
    assert result.band_start.size == 26
    scan(result, system, np.random.default_rng(0).uniform(0.2, 3.0, 100_000))


def test_the_last_band_begins_at_the_highest_natural_frequency() -> None:
    result = solved(chain(), 1.97, 3.0)
    # eq. 10.63
    assert result.band_start[-1] == pytest.approx(2 * np.sin(13 * np.pi / 28), rel=4e-15)
    assert result.band_start_reason[-1] == Edge.NEGATIVE_IMPULSE
    assert result.band_stop[-1] == 3.0
    assert result.band_stop_reason[-1] == Edge.RANGE


@pytest.mark.needs("compiled kernels")
def test_bands_begin_at_natural_frequencies_or_odd_parts_of_them() -> None:
    result = solved(chain(), 0.2, 3.0)
    natural = 2 * np.sin(np.arange(1, 14) * np.pi / 28)
    odd = np.outer(natural, 1 / np.arange(1, 21, 2)).ravel()
    for start in result.band_start:
        assert np.abs(odd / start - 1).min() < 1e-14


@pytest.mark.needs("compiled kernels")
def test_one_oscillator_exists_above_its_natural_frequency_only() -> None:
    # Fig. 10.2: the other branches with positive impulse are phantoms.
    system = presets.oscillator([Constraint.at(0, 1.0)], 1.0)
    result = solved(system, 0.05, 2.0)
    assert result.band_start.tolist() == [pytest.approx(1.0, rel=1e-15)]
    assert result.rejected_start.size == 9
    # At their lower ends the limit is passed by the square of the distance: below 1e-8 of it
    # rounding hides by how much.
    hidden = result.unresolved_stop - result.unresolved_start
    assert (hidden < 1e-7 * result.unresolved_stop).all()
    assert (result.rejected_reason == Edge.PENETRATION).all()
    # Between Omega_0/(2k+1) and Omega_0/2k the impulse is positive (10.9).
    k = np.arange(1, 10)[::-1]
    np.testing.assert_allclose(result.rejected_start, 1 / (2 * k + 1), rtol=1e-7)
    np.testing.assert_allclose(result.rejected_stop, 1 / (2 * k), rtol=1e-12)


@pytest.mark.needs("compiled kernels")
def test_witnesses_are_beyond_the_limit() -> None:
    system = chain()
    result = solved(system, 0.5, 3.0)
    middle = 0.5 * (result.rejected_start + result.rejected_stop)
    problem = modes.Problem(system, middle * 2 / np.pi, outputs=frozenset({"exists"}), Omega=middle)
    assert not modes.solve(problem, modes.plan(problem)).exists.any()
    assert (np.abs(result.rejected_witness) <= 1).all()


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("seed", range(8))
def test_no_band_of_a_random_structure_is_missed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 9))
    system = random_system(seed, n, [Constraint.at(int(rng.integers(n)), 1.0)])
    result = solved(system, 0.15, 3.0)
    assert result.unresolved_start.size == 0
    scan(result, system, rng.uniform(0.15, 3.0, 1_000_000 if seed < 4 else 60_000))


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("seed", range(4))
def test_limits_that_are_not_struck_count(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    stops = [Constraint.at(0, 1.0), Constraint((1, 2), (1.0, -1.0), 0.4, 0.9)]
    system = random_system(seed, 4, stops)
    result = solved(system, 0.2, 4.0, active=(0,))
    free = solved(random_system(seed, 4, stops[:1]), 0.2, 4.0)
    width = np.sum(result.band_stop - result.band_start)
    assert width < np.sum(free.band_stop - free.band_start)
    scan(result, system, rng.uniform(0.2, 4.0, 30_000), (0,))


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize(
    "stops",
    [
        [Constraint.at(4, 0.2), Constraint.at(7, 0.2)],
        [Constraint((4,), (1.0,), 0.1, 0.3)],
        [Constraint((4,), (1.0,), None, 0.3)],
        [Constraint((4,), (1.0,), None, -0.3)],
    ],
    ids=["two", "unequal", "one wall", "preloaded wall"],
)
def test_other_families_are_searched(stops: list[Constraint]) -> None:
    system = presets.chain(12, stops)
    result = solved(system, 0.8, 3.0)
    assert not result.band_certified.any()
    assert 0 < result.error_resolution < 2e-3
    assert result.band_start.size
    scan(result, system, np.random.default_rng(1).uniform(0.8, 3.0, 20_000))


def test_searched_edges_are_enclosed_and_say_what_lies_beyond_them() -> None:
    system = presets.chain(12, [Constraint.at(4, 0.2), Constraint.at(7, 0.2)])
    result = solved(system, 0.8, 3.0)
    ends = (
        (-1.0, result.band_start, result.band_start_reason),
        (1.0, result.band_stop, result.band_stop_reason),
    )
    for outwards, edges, reasons in ends:
        inner = reasons != Edge.RANGE
        assert inner.sum() == edges.size - 1
        step = outwards * result.band_edge_error[inner]
        assert exists(system, edges[inner] - step).all()
        Omega = edges[inner] + step
        beyond = modes.Problem(
            system, Omega * (2 / np.pi), outputs=frozenset({"reason"}), Omega=Omega
        )
        found = modes.solve(beyond, modes.plan(beyond)).reason
        np.testing.assert_array_equal(found, reasons[inner])


def test_rigid_body_modes_take_part() -> None:
    K = np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    system = System(
        SymmetricMatrix.diagonal([1.0, 2.0, 1.5]),
        SymmetricMatrix.dense(K),
        (Constraint.at(0, 1.0),),
    )
    result = solved(system, 0.1, 3.0)
    assert result.band_certified.all()
    scan(result, system, np.linspace(0.1, 3.0, 20_000))


def test_repeated_frequencies_and_modes_with_a_node_change_nothing() -> None:
    # Two equal oscillators, only one of them limited, beside the pair (10.22).
    K = np.diag([1.0, 1.0, 4.0, 4.0])
    system = System(
        SymmetricMatrix.diagonal(np.ones(4)), SymmetricMatrix.dense(K), (Constraint.at(0, 1.0),)
    )
    result = solved(system, 0.3, 3.0)
    assert result.band_start.tolist() == [pytest.approx(1.0)]


def test_an_unstable_structure_is_searched() -> None:
    K = np.array([[1.0, -0.2], [-0.2, -0.3]])
    system = System(
        SymmetricMatrix.diagonal([1.0, 1.0]), SymmetricMatrix.dense(K), (Constraint.at(0, 1.0),)
    )
    problem = bands.Problem(system, 0.3, 3.0)
    plan = bands.plan(problem)
    assert [step.method for step in plan.steps][-1] == "search"
    scan(bands.solve(problem, plan), system, np.linspace(0.3, 3.0, 5_000))


def test_the_plan_says_what_is_skipped() -> None:
    plan = bands.plan(bands.Problem(chain(), 1.0, 3.0))
    skipped = {skip.what for skip in plan.skips}
    assert {"a grid of frequencies", "the proof above the spectrum", "stability"} <= skipped


def test_stability_splits_the_localized_band() -> None:
    # Spectral radius at 1.01, 1.05, 1.1, 1.2, 1.5, 2 Omega_N: unstable up to 1.2, stable from 1.5.
    result = solved(chain(), 1.99, 4.0, outputs=frozenset({"stability"}))
    assert result.band_start is None
    assert result.stability_stable.tolist() == [False, True]
    Omega_N = 2 * np.sin(13 * np.pi / 28)
    assert 1.2 < result.stability_stop[0] / Omega_N < 1.5


@pytest.mark.parametrize(
    ("start", "stop", "more", "pointer"),
    [
        (0.0, 1.0, {}, ("frequency", "start")),
        (1.0, np.inf, {}, ("frequency", "stop")),
        (2.0, 1.0, {}, ("frequency", "stop")),
        (1.0, 2.0, {"active": (3,)}, ("active", 0)),
        (1.0, 2.0, {"outputs": frozenset({"shape"})}, ("outputs",)),
        (1.0, 2.0, {"tolerance": 1e-20}, ("tolerance",)),
    ],
)
def test_faults_are_named(
    start: float, stop: float, more: dict[str, object], pointer: tuple[object, ...]
) -> None:
    with pytest.raises(ModelError) as caught:
        bands.Problem(chain(), start, stop, **more)
    assert caught.value.pointer == pointer


@pytest.mark.parametrize("n", [2, 13])
def test_more_poles_than_can_be_listed_are_refused(n: int) -> None:
    far = bands.Problem(chain(n, 0), 1e-9, 1.0)
    with pytest.raises(ModelError, match="poles above it") as caught:
        bands.plan(far)
    assert caught.value.pointer == ("frequency", "start")


@pytest.mark.parametrize("idle", [0.2, 3.0])
def test_without_stiffness_one_solution_decides(idle: float) -> None:
    """Both coordinates move along straight lines; M^-1 w tells where to."""
    M = np.array([[2.0, 0.5], [0.5, 1.0]])
    stops = (Constraint.at(0, 1.0), Constraint.at(1, idle))
    system = System(SymmetricMatrix.dense(M), SymmetricMatrix.dense(np.zeros((2, 2))), stops)
    problem = bands.Problem(system, 0.5, 2.0, active=(0,))
    plan = bands.plan(problem)
    assert "other frequencies" in {skip.what for skip in plan.skips}
    result = bands.solve(problem, plan)
    reach = np.linalg.solve(M, [1.0, 0.0])
    is_admissible = abs(reach[1] / reach[0]) <= idle
    assert result.band_start.tolist() == ([0.5] if is_admissible else [])
    assert result.rejected_stop.tolist() == ([] if is_admissible else [2.0])
    assert np.concatenate([result.band_certified, result.rejected_certified]).all()
    searched = SearchedBands(problem, np.empty(0)).find(None)
    assert len(searched.bands) == result.band_start.size


def test_results_say_that_losses_are_neglected() -> None:
    damping, stop = SymmetricMatrix.diagonal([0.1]), Constraint.at(0, 1.0, 0.8)
    one = SymmetricMatrix.diagonal([1.0])
    sentences = solved(System(one, one, (stop,), C=damping), 0.5, 2.0).neglected
    assert sentences is not None
    assert len(sentences) == 2
    assert solved(System(one, one, (Constraint.at(0, 1.0),)), 0.5, 2.0).neglected is None


def test_a_range_of_another_reason_beside_an_edge_is_no_part_of_the_band() -> None:
    # Negative impulses, wrong velocities, a band: the middle one is narrower than the grid.
    M, K = [[1.0, 0.01], [0.01, 1.0]], [[0.4, -0.22], [-0.22, 0.76]]
    full = [SymmetricMatrix.dense(matrix) for matrix in (M, K)]
    system = System(full[0], full[1], (Constraint.at(0, 1.0), Constraint.at(1, 0.54)))
    result = solved(system, 0.55, 30.0)
    assert result.band_start_reason is not None
    (k,) = np.flatnonzero(result.band_start_reason == Edge.WRONG_VELOCITY)
    beside = float(result.band_start[k]) + np.array([-1e-3, -1e-9, 1e-9, 1e-3])
    np.testing.assert_array_equal(exists(system, beside), [False, False, True, True])
    scan(result, system, np.random.default_rng(0).uniform(0.55, 30.0, 20_000))


@pytest.mark.parametrize(
    ("mass", "stiffness", "start", "stop"),
    [
        (1.3435023034095341, 1.2196383958928352, 0.7791964122922904, 1.2027262153678533),
        (1.0, 1.0, 0.440907955944553, 2.2683140398330948),
    ],
)
def test_what_is_not_certain_beside_an_edge_is_unresolved(
    mass: float, stiffness: float, start: float, stop: float
) -> None:
    """One wall, struck once a period: modes exist from the natural frequency to twice that."""
    one, other = SymmetricMatrix.diagonal([mass]), SymmetricMatrix.diagonal([stiffness])
    result = solved(System(one, other, (Constraint((0,), (1.0,), None, 1.0),)), start, stop)
    natural = float(np.sqrt(stiffness / mass))
    assert result.band_start.size == 1
    assert abs(result.band_start[0] - natural) <= result.band_edge_error[0]
    expected = min(2.0 * natural, stop)
    assert abs(result.band_stop[0] - expected) <= result.band_edge_error[0]
    assert result.unresolved_start.size <= 2
    assert (result.unresolved_stop - result.unresolved_start < 1e-8 * natural).all()


def test_deviations_grow_where_the_radius_exceeds_1_by_more_than_its_error() -> None:
    """However small the growth is; only without a bound the root of rounding stands for it."""
    radius = np.array([1.0, 1.0 + 1e-7, 1.0 + 1e-7, 1.0 + 1e-3, 1.0 + 1e-7, 1.5, np.nan])
    error = np.array([1e-15, 1e-9, 1e-6, 1e-2, np.inf, np.inf, np.nan])
    expected = [False, True, False, False, False, True, True]
    assert stability_ranges.grows(radius, error).tolist() == expected


def test_ranges_of_stability_agree_with_what_impact_modes_say() -> None:
    system = presets.chain(5, [Constraint.at(2, gap=1.0)])
    result = solved(system, 0.5, 4.0, outputs=frozenset({"stability"}))
    assert result.stability_start is not None
    assert result.stability_stop is not None
    assert result.stability_stable is not None
    assert set(result.stability_stable.tolist()) == {False, True}
    for start, stop, stable in zip(
        result.stability_start, result.stability_stop, result.stability_stable, strict=True
    ):
        Omega = start + (stop - start) * np.linspace(1e-6, 1.0 - 1e-6, 41)
        outputs = frozenset({"stability"})
        problem = modes.Problem(system, Omega * (2 / np.pi), outputs=outputs, Omega=Omega)
        family = modes.solve(problem, modes.plan(problem))
        assert family.neutral is not None
        assert (family.neutral == stable).all()


@pytest.mark.parametrize(("elements", "stop"), [(6, 1.1), (12, 1.02)])
def test_bands_of_beams_are_where_impact_modes_exist(elements: int, stop: float) -> None:
    """Fast modes are bounded here and resolved there, at frequencies at random."""
    beam = cantilever(elements, damped=False)
    result = solved(beam, OMEGA, stop * OMEGA)
    assert result.band_start is not None
    assert result.band_start.size > 40
    Omega = np.random.default_rng(0).uniform(OMEGA, stop * OMEGA, 2000)
    Omega = Omega[clear_of_edges(result, Omega, 1e-9)]
    np.testing.assert_array_equal(inside(result, Omega), exists(beam, Omega))
    assert 0.05 < inside(result, Omega).mean() < 0.95
