"""Accuracy against sums over natural modes in 80 digits."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from tests.solvers.structures import chain
from vibroimpact_solvers import impact_modes as modes

EPS = np.finfo(np.float64).eps
N, DOF, GAP = 13, 5, 0.2


def solve(Omega: np.ndarray, outputs: frozenset[str]) -> modes.Result:
    problem = modes.Problem(chain(N, DOF, GAP), Omega * (2 / np.pi), outputs=outputs, Omega=Omega)
    return modes.solve(problem, modes.plan(problem))


def exact(Omega: float) -> tuple[mpmath.mpf, list[mpmath.mpf]]:
    """Return p and x(tau = 1) of the chain, eq. 10.53, 10.63 and 10.65."""
    with mpmath.workdps(80):
        omega = 2 * mpmath.mpf(Omega) / mpmath.pi
        size = mpmath.mpf(2) / (N + 1)
        sums = [mpmath.mpf(0)] * N
        for j in range(1, N + 1):
            gamma = 2 * mpmath.sin(j * mpmath.pi / (2 * (N + 1))) / omega
            angle = j * mpmath.pi / (N + 1)
            seen = size * mpmath.sin(angle * (DOF + 1)) * mpmath.tan(gamma) / gamma
            for i in range(N):
                sums[i] += seen * mpmath.sin(angle * (i + 1))
        p = mpmath.mpf(str(GAP)) * omega**2 / sums[DOF]
        return p, [p * s / omega**2 for s in sums]


@pytest.mark.parametrize("ratio", [1.05, 1.5, 3.0, 10.0, 23.7, 50.0, 100.0, 300.0, 1000.0])
def test_every_entry_of_a_localized_shape_has_its_digits(ratio: float) -> None:
    # At 300 Omega_N the far mass moves by 4e-42 of the gap.
    Omega = ratio * 2 * np.sin(13 * np.pi / 28)
    result = solve(np.array([Omega]), frozenset({"impulse", "shape"}))
    p, x = exact(Omega)
    assert float(abs(result.impulse[0, 0] / p - 1)) < 1e-14
    error = [
        float(abs(computed / true - 1)) for computed, true in zip(result.shape[0], x, strict=True)
    ]
    kept = [e for e, true in zip(error, x, strict=True) if abs(true) > 1e-30 * GAP]
    assert len(kept) >= 7
    assert max(kept) < 1e-12


def test_the_smallest_entries_are_as_small_as_they_should_be() -> None:
    _, x = exact(47.0)
    assert 1e-31 < float(min(abs(each) for each in x)) / GAP < 1e-17


@pytest.mark.needs("compiled kernels")
def test_impulses_over_the_whole_family() -> None:
    Omega = np.random.default_rng(3).uniform(0.2, 3.0, 400)
    result = solve(Omega, frozenset({"impulse"}))
    true = [exact(each)[0] for each in Omega]
    error = np.array(
        [float(abs(p / t - 1)) for p, t in zip(result.impulse[:, 0], true, strict=True)]
    )
    assert (error <= 100 * EPS * result.condition).all()
    # Away from the edges of bands, where the condition is that of the data alone.
    usual = result.condition < 100.0
    assert usual.mean() > 0.5
    assert error[usual].max() < 1e-13
