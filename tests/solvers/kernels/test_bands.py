"""Bounds over boxes hold everywhere in them; signs change where they are said to."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from tests.solvers.kernels.compiled import compiled
from vibroimpact_solvers.kernels import bands


def margin(root: np.ndarray, alpha: np.ndarray, beta: np.ndarray, q: float, tau: float) -> float:
    """P in extended precision."""
    with mpmath.workdps(30):
        total = mpmath.mpf(0)
        for r, a, b in zip(root, alpha, beta, strict=True):
            theta = mpmath.mpf(r) * mpmath.mpf(q)
            part = a * mpmath.sin(theta) - b * mpmath.sin(theta * mpmath.mpf(tau))
            total += part / (r * mpmath.cos(theta))
        return float(total)


prepare, box = compiled(bands._prepare), compiled(bands._box)


def margins(root: np.ndarray, alpha: np.ndarray, beta: np.ndarray) -> bands.Margin:
    """P of one limit, without rigid-body modes."""
    none, zero = np.zeros((1, root.size)), np.zeros(1)
    exact = none[0], alpha[None], beta[None], none
    # At the struck limit alpha and beta are the same.
    return bands.Margin(root, *exact, zero, zero, zero, zero, 0 if alpha is beta else 1)


@pytest.mark.parametrize("seed", range(6))
def test_bounds_hold_inside_the_box(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tried = 0
    while tried < 40:
        n = int(rng.integers(1, 6))
        root = np.sort(rng.uniform(0.2, 3.0, n))
        row, other = rng.normal(size=(2, n))
        alpha, beta = rng.uniform(0.2, 2.0) * row**2, row * other
        if rng.random() < 0.5:
            alpha = beta = row**2
        q, half = rng.uniform(0.1, 6.0), 10.0 ** rng.uniform(-6, -1.5)
        tau, width = rng.uniform(-1, 1), 10.0 ** rng.uniform(-6, -1)
        turns = np.floor(np.outer([q - half, q + half], root) / np.pi + 0.5)
        if q - half <= 0 or (turns[0] != turns[1]).any():
            continue  # a pole lies inside: no cell of a sign band
        tried += 1
        modes = bands._Modes(*np.empty((7, n)), np.empty(n, np.int64))
        far, sums = bands._Far(*np.empty((3, 1, n))), bands._Sums(*np.empty((8, 1, n + 1)))
        P = margins(root, alpha, beta)
        count = prepare(P, modes, far, sums, q, half)
        cell = bands._Cell(P, modes, far, sums, q, half, count)
        (value, low, high, least, rounding), _ = box(cell, 0, tau, width, n)
        # Of the fastest modes, which may turn many times in a wider box, the least will do.
        wide = 10.0 ** rng.uniform(-3, 0)
        (*_, lowest, _), _ = box(cell, 0, tau, wide, int(rng.integers(n)))
        for s in np.linspace(-1, 1, 7):
            exact = margin(root, alpha, beta, q + s * half, tau)
            assert low <= exact <= high
            for t in np.linspace(-1, 1, 7):
                assert least <= margin(root, alpha, beta, q + s * half, tau + t * width)
                inside = min(max(tau + t * wide, -1.0), 1.0)
                assert lowest <= margin(root, alpha, beta, q + s * half, inside)
        assert value == pytest.approx(margin(root, alpha, beta, q, tau), abs=8 * rounding, rel=1e-9)


def test_the_sign_changes_once_between_poles() -> None:
    root, weight2 = np.array([0.7, 1.1, 1.9]), np.array([0.3, 0.5, 0.2])
    left, right = np.pi / 2 / 1.9, np.pi / 2 / 1.1
    zero, error = bands.sign_change(margins(root, weight2, weight2), left, right)
    with mpmath.workdps(30):

        def response(q: mpmath.mpf) -> mpmath.mpf:
            terms = zip(root.tolist(), weight2.tolist(), strict=True)
            return sum(w / r * mpmath.tan(r * q) for r, w in terms)

        exact = mpmath.findroot(response, (zero * (1 - 1e-6), zero * (1 + 1e-6)), solver="anderson")
    assert zero == pytest.approx(float(exact), rel=4e-16)
    assert abs(float(exact) - zero) <= error <= 1e-14


def test_one_oscillator_has_solutions_below_its_first_pole_only() -> None:
    # y = sin(theta tau)/sin(theta) passes its limit wherever |sin(theta)| < 1 past the pole.
    one = np.ones(1)
    bounds, status, witness, _, _ = bands.survey(
        margins(one, one, one), np.pi + 1e-3, 1.5 * np.pi - 1e-3, 1e-12, 10**7
    )
    assert status.tolist() == [bands.PHANTOM]
    assert bounds[0] == np.pi + 1e-3
    assert bounds[-1] == 1.5 * np.pi - 1e-3
    theta = bounds[0]
    assert np.abs(np.sin(theta * witness[0])) > np.abs(np.sin(theta))


def test_a_fast_mode_takes_no_part_of_the_period_out_of_the_proof() -> None:
    """Few boxes in tau are laid out, each of which it turns in; the limit is passed late in tau."""
    root, seen = np.array([1.0, 5e4]), np.array([1.0, 0.0])
    start = np.pi + 0.5
    _, status, witness, _, _ = bands.survey(
        margins(root, seen, seen), start, start + 1e-5, 1e-12, 10**7
    )
    assert status.tolist() == [bands.PHANTOM]
    assert np.abs(np.sin(start * witness[0])) > np.abs(np.sin(start))


def test_what_the_budget_does_not_reach_is_undecided() -> None:
    root = np.linspace(0.3, 2.0, 12)
    weight2 = np.full(12, 1.0 / 12)
    poles = np.sort(np.outer(0.5 * np.pi / root, [1.0, 3.0, 5.0]).ravel())
    zero, _ = bands.sign_change(margins(root, weight2, weight2), poles[12], poles[13])
    result = bands.survey(margins(root, weight2, weight2), zero, poles[13], 1e-12, 1)
    assert bands.UNDECIDED in result.status


def test_a_limit_that_rigid_body_modes_alone_pass_is_looked_at() -> None:
    """P = (alpha - beta tau) q of the other limit is negative before the impact; no mode turns."""
    none = np.empty(0)
    table = np.empty((2, 0))
    alpha, beta = np.array([1.0, 1.0]), np.array([1.0, 2.0])
    margin = bands.Margin(none, none, table, table, table, alpha, beta, *np.zeros((2, 2)), 0)
    _, status, witness, limit, _ = bands.survey(margin, 1.0, 2.0, 1e-12, 10**6)
    assert status.tolist() == [bands.PHANTOM]
    assert limit.tolist() == [1]
    assert witness[0] > 0.5
