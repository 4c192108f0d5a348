"""Motions of solutions by vector loops, against extended precision."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest

from tests.solvers.kernels.compiled import compiled
from vibroimpact_solvers.kernels import motions, response, sums

EPS = float(np.finfo(np.float64).eps)

# Rigid, falling slowly and fast, hardly swinging, and swinging modes.
ROOTS = np.array([0.0, -0.3, -40.0, 1e-200, 1e-5, 0.02, 0.7, 3.0, 11.0, 250.0, 3e9])
LOADS = np.array([0.0, 0.4, -0.2, 0.0, 1e-9, 0.3, -0.5, 0.0, 2.0, 1.0, 0.1])
OMEGA = np.array([0.31, 1.0, 1.9, 6.4])


def place(root: float, load: float, omega: float, D: float, U: float | None, tau: float) -> Any:
    """Return a modal coordinate to 50 digits, and the size of its terms."""
    with mpmath.workdps(50):
        gamma, t = mpmath.mpf(abs(root)) / mpmath.mpf(omega), mpmath.mpf(tau)
        if root < 0:
            terms = [D * mpmath.sinh(gamma * t) / (gamma * mpmath.cosh(gamma))]
        else:
            terms = [D * (mpmath.sin(gamma * t) / gamma if gamma else t)]
        if U is None:
            return terms[0], abs(terms[0])
        squared = mpmath.mpf(omega) ** 2
        if root < 0 and gamma >= 1:
            terms += [U * mpmath.cosh(gamma * t) / mpmath.cosh(gamma)]
            terms += [-load / (gamma**2 * squared)]
        elif root < 0:
            terms += [U * mpmath.cosh(gamma * t)]
            terms += [load / squared * (mpmath.cosh(gamma * t) - 1) / gamma**2]
        else:
            terms += [U * mpmath.cos(gamma * t)]
            terms += [
                load / squared * ((1 - mpmath.cos(gamma * t)) / gamma**2 if gamma else t * t / 2)
            ]
        return mpmath.fsum(terms), mpmath.fsum(abs(term) for term in terms)


@pytest.mark.parametrize("parts", ["odd", "even", "both"])
@pytest.mark.parametrize("times", [1, 4, 700])
def test_coordinates(parts: str, times: int) -> None:
    """Blocks of one frequency, of a few and of all of them."""
    random = np.random.default_rng(times)
    tau = np.sort(random.uniform(-1.0, 1.0, times))
    tau[-1] = 1.0
    D, U = random.uniform(-2.0, 2.0, (2, OMEGA.size, ROOTS.size))
    none = np.zeros((OMEGA.size, 0))
    odd, even = parts != "even", parts != "odd"
    load = LOADS if even else np.zeros(ROOTS.size)
    some = motions.Motions(ROOTS, load, OMEGA, D if odd else none, U if even else none)
    q = motions.coordinates(some, tau)
    for f in range(OMEGA.size):
        for t in range(0, times, max(1, times // 5)):
            for j in range(ROOTS.size):
                swing, start = (D[f, j] if odd else 0.0), (U[f, j] if even else None)
                exact, size = place(ROOTS[j], load[j], OMEGA[f], swing, start, tau[t])
                # An error of the phase is as many roundings as there are of it.
                phase = abs(ROOTS[j]) / OMEGA[f] * EPS
                amplitude = abs(swing) / max(abs(ROOTS[j]) / OMEGA[f], 1.0) + abs(start or 0.0)
                room = 8.0 * EPS * float(size) + 2.0 * phase * amplitude + 1e-300
                assert abs(float(q[f, t, j] - exact)) < room, (ROOTS[j], OMEGA[f], tau[t])


def test_no_coordinates() -> None:
    none = np.zeros((2, 0))
    still = motions.Motions(ROOTS[:0], LOADS[:0], OMEGA[:2], none, none)
    empty = motions.coordinates(still, np.zeros(3))
    assert empty.shape == (2, 3, 0)


def test_energies() -> None:
    """Kinetic and potential energy at tau = 0, of falling modes too."""
    random = np.random.default_rng(5)
    D, U = random.uniform(-2.0, 2.0, (2, OMEGA.size, ROOTS.size))
    found = motions.energies(motions.Motions(ROOTS, LOADS, OMEGA, D, U))
    for f, omega in enumerate(OMEGA):
        with mpmath.workdps(50):
            total, size = mpmath.mpf(0), mpmath.mpf(0)
            for j, root in enumerate(ROOTS):
                gamma = mpmath.mpf(root) / omega
                stiffness = mpmath.mpf(root) * abs(mpmath.mpf(root))
                fade = 1 / mpmath.cosh(gamma) if root < 0 else mpmath.mpf(1)
                speed = omega * D[f, j] * fade
                start = mpmath.mpf(U[f, j])
                if gamma <= -1:
                    start = start * fade + LOADS[j] / stiffness
                terms = [speed**2 / 2, stiffness * start**2 / 2, -LOADS[j] * start]
                total += mpmath.fsum(terms)
                size += mpmath.fsum(abs(term) for term in terms)
        assert abs(float(found[f] - total)) < 16.0 * EPS * float(size)


@pytest.mark.parametrize("offset", [0.3, 1e-3, 1e-7, 1e-12, 0.0])
@pytest.mark.parametrize("sets", [1, 3])
def test_amplitudes_beside_a_pole(offset: float, sets: int) -> None:
    """D = a gap/(S cos gamma) is as good there as anywhere: its error is that of S cos gamma."""
    roots = np.array([0.0, 0.4, 1.3, 2.9, 5.2, 17.0, 90.0, -0.8])
    row = np.array([0.3, -0.2, 0.5, 0.1, -0.7, 0.4, 0.2, 0.1])
    rests = np.array([0.0, 0.3, -0.4, 0.2, 0.1, -0.3, 0.4, 0.0]) * EPS
    omega = np.array([2.9, 5.2, 17.0]) * 2.0 / np.pi * (1.0 + offset)
    omega_rests = np.array([0.2, -0.3, 0.1]) * EPS
    gaps = np.linspace(0.2, 0.5, sets)
    S, condition = response.response_one(roots, rests, row**2, omega, omega_rests)
    modes = response.Participations(row, 0.0 * row, 0.0 * row, 0.0 * row)
    scale = np.divide.outer(gaps, S)
    D, sizes = response.amplitudes_one(roots, rests, modes, omega, omega_rests, scale)
    error = np.abs(scale) * (sizes.motion_error + EPS * condition * sizes.motion)
    with mpmath.workdps(60):
        for f in range(omega.size):
            w = mpmath.mpf(omega[f]) * (1 + mpmath.mpf(omega_rests[f]))
            natural = [
                mpmath.mpf(r) * (1 + mpmath.mpf(e)) for r, e in zip(roots, rests, strict=True)
            ]
            gamma = [abs(r) / w for r in natural]
            responses = [
                mpmath.mpf(1) if g == 0 else (mpmath.tanh(g) if r < 0 else mpmath.tan(g)) / g
                for r, g in zip(roots, gamma, strict=True)
            ]
            total = mpmath.fsum(mpmath.mpf(a) ** 2 * T for a, T in zip(row, responses, strict=True))
            for j in range(roots.size):
                cosine = mpmath.mpf(1) if roots[j] < 0 else mpmath.cos(gamma[j])
                for s in range(sets):
                    exact = mpmath.mpf(row[j]) * mpmath.mpf(gaps[s]) / (total * cosine)
                    least = min(1, 1 / gamma[j]) if gamma[j] else 1
                    assert abs(D[s, f, j] - exact) * least <= error[s, f]
                    assert abs(float(D[s, f, j] / exact - 1)) < 64.0 * EPS, (f, j, s)
    assert np.isfinite(condition).all()


def test_what_has_no_response_does_not_move() -> None:
    one = np.ones(1)
    modes = response.Participations(one, 0.0 * one, 0.0 * one, 0.0 * one)
    D, _ = response.amplitudes_one(one, 0.0 * one, modes, one, 0.0 * one, np.zeros((1, 1)))
    assert D.tolist() == [[[0.0]]]


@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 16, 17, 100, 1001])
def test_folded_sums(count: int) -> None:
    folded = compiled(sums.folded)
    terms = np.random.default_rng(count).uniform(-1.0, 1.0, count)
    exact = float(mpmath.fsum(map(mpmath.mpf, terms)))
    size = float(np.abs(terms).sum())
    assert folded(terms.copy()) == pytest.approx(exact, abs=12 * EPS * size, rel=0)
