"""What must hold for all structures: invariances, superposition, limits, exact free motion."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tests.solvers.structures import chain, random_system
from vibroimpact_solvers import impact_modes as modes
from vibroimpact_solvers import spectrum
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

pytestmark = pytest.mark.needs("compiled kernels")

EPS = np.finfo(np.float64).eps
ALL = frozenset({"impulse", "exists", "shape", "energy"})

seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(2, 7)
ratios = st.floats(0.1, 8.0)


def solve(
    system: System,
    omega: np.ndarray,
    active: tuple[int, ...] = (),
    outputs: frozenset[str] = ALL,
    tau: np.ndarray | None = None,
) -> modes.Result:
    problem = modes.Problem(system, omega, active, outputs, tau=tau)
    return modes.solve(problem, modes.plan(problem))


def case(seed: int, n: int, ratio: float, count: int = 1) -> tuple[System, np.ndarray]:
    """A random structure with limiters along random directions, and one frequency."""
    rng = np.random.default_rng(seed)
    stops = []
    for _ in range(count):
        gap = float(rng.uniform(0.5, 2.0))
        weights = tuple(float(w) for w in rng.normal(size=n))
        stops.append(Constraint(tuple(range(n)), weights, gap, gap))
    system = random_system(seed, n, stops)
    return system, np.array([2 / np.pi * ratio * spectrum.largest_frequency(system)])


def trusted(*results: modes.Result) -> float:
    """What the results say they may differ by, relative to the largest impulse."""
    error = float(sum(result.relative_error[0] for result in results))
    assume(error < 1e-6)
    return 4.0 * error + 100.0 * EPS


def changed(system: System, T: np.ndarray) -> System:
    """The same structure in coordinates z, x = T z."""
    M, K = (T.T @ matrix.to_dense() @ T for matrix in (system.M, system.K))
    stops = []
    for constraint in system.constraints:
        w = np.zeros(system.n)
        w[list(constraint.dofs)] = constraint.weights
        weights = tuple(float(x) for x in T.T @ w)
        stops.append(
            Constraint(tuple(range(system.n)), weights, constraint.lower, constraint.upper)
        )
    return System(
        SymmetricMatrix.dense(0.5 * (M + M.T)), SymmetricMatrix.dense(0.5 * (K + K.T)), tuple(stops)
    )


@pytest.mark.needs("compiled kernels")
@settings(deadline=None)
@given(seeds, sizes, ratios, st.integers(1, 2))
def test_coordinates_do_not_matter(seed: int, n: int, ratio: float, count: int) -> None:
    system, omega = case(seed, n, ratio, count)
    rng = np.random.default_rng(seed + 1)
    Q, _ = np.linalg.qr(rng.normal(size=(n, n)))
    # M-orthogonal: z keep the mass matrix when x = M^(-1/2) Q M^(1/2) z.
    root = scipy.linalg.sqrtm(system.M.to_dense()).real
    T = np.linalg.solve(root, Q @ root)
    before, after = solve(system, omega), solve(changed(system, T), omega)
    scale = np.abs(before.impulse).max()
    # The matrices themselves are rounded anew, which moves the natural frequencies.
    bound = trusted(before, after) * np.linalg.cond(T) * 50.0
    assume(bound < 1e-6)
    np.testing.assert_allclose(after.impulse, before.impulse, rtol=0, atol=bound * scale)
    np.testing.assert_allclose(after.energy, before.energy, rtol=4.0 * bound)


@pytest.mark.needs("compiled kernels")
@settings(deadline=None)
@given(seeds, sizes, ratios, st.integers(-30, 30), st.integers(-30, 30), st.integers(-30, 30))
def test_units_do_not_matter(
    seed: int, n: int, ratio: float, time: int, mass: int, length: int
) -> None:
    # Powers of two change no digit: p scales as mass length / time^2 to the last bit or nearly.
    system, omega = case(seed, n, ratio)
    s, m, d = 4.0**time, 4.0**mass, 2.0**length
    (stop,) = system.constraints
    scaled = System(
        SymmetricMatrix.dense(system.M.to_dense() * m),
        SymmetricMatrix.dense(system.K.to_dense() * (m / s**2)),
        (Constraint(stop.dofs, stop.weights, stop.lower * d, stop.upper * d),),
    )
    before, after = solve(system, omega), solve(scaled, omega / s)
    bound = trusted(before, after)
    np.testing.assert_allclose(after.impulse, before.impulse * (m * d / s**2), rtol=bound)
    np.testing.assert_array_equal(after.exists, before.exists)
    largest = np.abs(before.shape).max() * d
    np.testing.assert_allclose(after.shape, before.shape * d, rtol=0, atol=10 * bound * largest)
    np.testing.assert_allclose(after.energy, before.energy * (m * d**2 / s**2), rtol=20 * bound)


@pytest.mark.needs("compiled kernels")
@settings(deadline=None)
@given(seeds, st.integers(3, 7), ratios)
def test_two_impacts_are_a_sum_of_single_ones(seed: int, n: int, ratio: float) -> None:
    # eq. 10.56-10.59
    system, omega = case(seed, n, ratio, 2)
    both, first, second = (solve(system, omega, active) for active in ((0, 1), (0,), (1,)))
    bound = trusted(both, first, second)
    assume(min(abs(first.impulse[0, 0]), abs(second.impulse[0, 0])) > 0)
    shares = both.impulse[0] / np.array([first.impulse[0, 0], second.impulse[0, 0]])
    parts = shares[0] * first.shape[0], shares[1] * second.shape[0]
    largest = max(np.abs(part).max() for part in parts)
    np.testing.assert_allclose(parts[0] + parts[1], both.shape[0], atol=100 * bound * largest)
    # Both walls are met.
    gaps = np.array([stop.upper for stop in system.constraints])
    y = system.directions((0, 1)) @ both.shape[0]
    np.testing.assert_allclose(y, gaps, atol=200 * bound * max(largest, gaps.max()))


@settings(deadline=None)
@given(seeds, sizes, st.floats(20.0, 1e6))
def test_high_frequencies_have_their_limit(seed: int, n: int, ratio: float) -> None:
    # eq. 10.80-10.86: with m = w M^-1 w and k = w M^-1 K M^-1 w, p -> gap omega^2 / (m + k/(3
    # omega^2)), and the shape tends to M^-1 w gap/m; the next term is of the order ratio^-4.
    system, omega = case(seed, n, ratio)
    result = solve(system, omega)
    (stop,) = system.constraints
    w = system.directions((0,))[0]
    mobile = np.linalg.solve(system.M.to_dense(), w)
    m, k = w @ mobile, mobile @ system.K.to_dense() @ mobile
    expected = stop.upper * omega**2 / (m + k / (3.0 * omega**2))
    np.testing.assert_allclose(result.impulse[:, 0], expected, rtol=3.0 / ratio**4 + 1e-12)
    np.testing.assert_allclose(
        result.shape[0], mobile * stop.upper / m, atol=20 * np.abs(mobile).max() / m / ratio**2
    )
    assert result.exists.all()


@settings(deadline=None)
@given(seeds, sizes, st.floats(0.2, 4.0), st.integers(1, 2))
def test_solutions_are_exact_motions(seed: int, n: int, ratio: float, count: int) -> None:
    """From just after the impacts at tau = -1 the free structure flies to those at tau = 1."""
    system, omega = case(seed, n, ratio, count)
    result = solve(system, omega)
    bound = trusted(result)
    M, K = system.M.to_dense(), system.K.to_dense()
    W = system.directions(tuple(range(count)))
    velocity = np.linalg.solve(M, W.T @ result.impulse[0]) / omega[0]
    state = np.concatenate([-result.shape[0], velocity])
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), np.zeros((n, n))]])
    landed = scipy.linalg.expm(A * (2.0 / omega[0])) @ state
    # All coordinates turn back at once, the constrained ones by their impulses 2 p/omega.
    size = np.abs(result.shape).max() + np.abs(velocity).max()
    growth = np.linalg.cond(A) + np.linalg.norm(A) * 2.0 / omega[0]
    atol = size * (100.0 * bound + 1e-13) * growth
    np.testing.assert_allclose(landed[:n], result.shape[0], atol=atol)
    np.testing.assert_allclose(landed[n:], velocity, atol=atol)


@settings(deadline=None, max_examples=50)
@given(seeds, sizes, st.floats(0.3, 3.0))
def test_the_energy_is_the_one_of_the_motion(seed: int, n: int, ratio: float) -> None:
    system, omega = case(seed, n, ratio)
    result = solve(system, omega)
    bound = trusted(result)
    M, K = system.M.to_dense(), system.K.to_dense()
    w = system.directions((0,))[0]
    velocity = np.linalg.solve(M, w) * result.impulse[0, 0] / omega[0]
    kinetic, potential = velocity @ M @ velocity, result.shape[0] @ K @ result.shape[0]
    expected = 0.5 * (kinetic + potential)
    np.testing.assert_allclose(result.energy[0], expected, rtol=1000 * bound)


@settings(deadline=None)
@given(seeds, sizes, st.floats(-6.0, 8.0))
def test_no_number_is_infinite_or_missing(seed: int, n: int, exponent: float) -> None:
    system, _ = case(seed, n, 1.0)
    omega = np.array([10.0**exponent * spectrum.largest_frequency(system)])
    result = solve(system, omega, outputs=frozenset({"impulse", "shape", "energy"}))
    for values in (result.impulse, result.shape, result.energy, result.relative_error):
        assert np.isfinite(values).all()


@settings(deadline=None)
@given(seeds, st.integers(1, 7), st.integers(1, 40))
def test_nothing_breaks_at_a_pole_in_floating_point(seed: int, n: int, odd: int) -> None:
    system, _ = case(seed, n, 1.0)
    roots = spectrum.spectrum(system).roots
    gamma = 0.5 * np.pi * (2 * odd - 1)
    at = roots / gamma
    omega = np.concatenate([at, np.nextafter(at, 0), np.nextafter(at, np.inf)])
    result = solve(system, omega, outputs=frozenset({"impulse", "shape", "energy"}))
    for values in (result.impulse, result.shape, result.energy):
        assert np.isfinite(values).all()
    # The impulse passes through zero there.
    usual = system.constraints[0].upper * omega**2
    assert (np.abs(result.impulse[:, 0]) < 1e-6 * usual * (1 + (roots.max() / omega) ** 2)).all()


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("unit", [1e-12, 1e12])
def test_lengths_in_other_units_exist_as_well(unit: float) -> None:
    Omega = np.linspace(0.3, 3.0, 2000)

    def reasons(gap: float) -> np.ndarray:
        problem = modes.Problem(
            chain(gap=gap), Omega * (2 / np.pi), outputs=frozenset({"reason"}), Omega=Omega
        )
        found = modes.solve(problem, modes.plan(problem)).reason
        assert found is not None
        return found

    expected = reasons(0.2)
    assert np.unique(expected).size > 2
    np.testing.assert_array_equal(reasons(0.2 * unit), expected)
