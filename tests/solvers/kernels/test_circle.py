"""Roots of trigonometric polynomials that are made from their roots."""

from __future__ import annotations

import numpy as np
import pytest

from vibroimpact_solvers.kernels.circle import circle_roots

TWO_PI = 2.0 * np.pi


def coefficients(angles: np.ndarray, others: np.ndarray) -> tuple[np.ndarray, float]:
    """Return amplitudes Q_1, Q_2, ... and the wall of one with these roots and no others.

    Each pair of angles is a factor ``2 sin((t - a)/2) sin((t - b)/2)``, each other number, larger
    than 1, one ``c - cos t``.
    """
    pairs = angles.reshape(-1, 2)
    rows = [np.array([0.5 * np.cos(a - b), 0.0]) for a, b in pairs]
    whole = np.array([1.0 + 0.0j])
    for a, b in pairs:
        half = np.exp(-0.5j * (a + b))
        whole = np.convolve(whole, [-0.5 * half.conj(), np.cos(0.5 * (a - b)), -0.5 * half])
    for c in others:
        whole = np.convolve(whole, [-0.5, c, -0.5])
    assert len(rows) == len(pairs)
    middle = whole.size // 2
    return 2.0 * whole[middle + 1 :], -float(whole[middle].real)


def found(Q: np.ndarray, wall: float, orders: np.ndarray | None = None) -> np.ndarray:
    """Return the roots of one polynomial, in [0, 2 pi)."""
    orders = np.arange(1, Q.size + 1) if orders is None else orders
    size = np.abs(Q).sum()
    room = max(2 * int(orders[-1]), 1)
    index, phases = np.empty(room, np.int64), np.empty(room)
    walls = np.array([wall / size])
    following, count = circle_roots((Q / size)[np.newaxis], orders, walls, 0, index, phases)
    assert following == 1
    return np.sort(np.mod(phases[:count], TWO_PI))


@pytest.mark.parametrize("seed", range(40))
def test_each_root_is_found_once(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0.0, TWO_PI, 2 * int(rng.integers(0, 5))))
    others = 1.0 + 10.0 ** rng.uniform(-3.0, 1.0, int(rng.integers(1, 4)))
    Q, wall = coefficients(angles, others)
    roots = found(Q, wall)
    assert roots.size == angles.size
    assert roots == pytest.approx(angles, abs=1e-6)


@pytest.mark.parametrize("apart", [1e-3, 1e-5, 1e-6])
def test_two_roots_beside_each_other(apart: float) -> None:
    angles = np.array([1.0, 1.0 + apart, 3.0, 3.0 + 3.0 * apart])
    roots = found(*coefficients(angles, np.array([1.5])))
    assert roots == pytest.approx(angles, rel=0.05 * apart)


def test_a_touch_is_none_or_two_and_a_threefold_root_one() -> None:
    for turn in np.linspace(0.0, TWO_PI, 25):
        Q, wall = coefficients(np.mod([turn, turn, 1.0, 2.0], TWO_PI), np.array([]))
        assert found(Q, wall).size in (2, 4)
        Q, wall = coefficients(np.array([turn, turn, turn, turn + 2.0]), np.array([]))
        roots = np.exp(1j * found(Q, wall))
        assert sorted(np.abs(roots - np.exp(1j * turn)) < 1e-4) == [False, True]


@pytest.mark.needs("compiled kernels")
def test_the_multiple_root_of_a_flat_one_costs_no_time() -> None:
    Q, wall = coefficients(np.full(20, 2.0), np.array([]))
    assert found(Q, wall).size == 0
    Q, wall = coefficients(np.append(np.full(19, 2.0), 4.0), np.array([]))
    assert found(Q, wall).size == 2


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("highest", [0.0, 5e-324, 1e-300, 1e-20, 1e-3])
@pytest.mark.parametrize("order", [2, 7, 1_000_000])
def test_little_or_nothing_of_the_highest_harmonic(highest: float, order: int) -> None:
    roots = found(np.array([1.0, highest + 0.0j]), 0.5, np.array([1, order]))
    near = np.arccos(0.5)
    few = np.abs(np.minimum(np.abs(roots - near), np.abs(roots + near - TWO_PI)))
    assert few.max() <= 2.0 * highest + 1e-14
    if highest * order < 0.1:
        assert roots == pytest.approx([near, TWO_PI - near], abs=2.0 * highest + 1e-14)


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("order", [3, 50, 1000])
def test_all_roots_of_a_high_harmonic(order: int) -> None:
    roots = found(np.array([0.1, 1.0j]), 0.2, np.array([1, order]))
    assert roots.size == 2 * order
    f = 0.1 * np.cos(roots) - np.sin(order * roots) - 0.2
    assert np.abs(f).max() < 1e-12 * order
    assert np.diff(roots).min() > 0.5 / order


def test_many_polynomials_in_little_room() -> None:
    rng = np.random.default_rng(5)
    Q = rng.standard_normal((50, 3)) + 1j * rng.standard_normal((50, 3))
    Q /= np.abs(Q).sum(axis=1, keepdims=True)
    walls = rng.uniform(-0.6, 0.6, 50)
    orders = np.array([1, 2, 4])
    index, phases = np.empty(20, np.int64), np.empty(20)
    begin, of, roots = 0, [], []
    while begin < 50:
        begin, count = circle_roots(Q, orders, walls, begin, index, phases)
        of.append(index[:count].copy())
        roots.append(phases[:count].copy())
    index, phases = np.concatenate(of), np.concatenate(roots)
    for k in range(50):
        dense = np.linspace(0.0, TWO_PI, 100_001)
        f = (Q[k] * np.exp(1j * dense[:, np.newaxis] * orders)).real.sum(axis=1) - walls[k]
        expected = dense[np.flatnonzero(np.diff(np.signbit(f)))]
        assert np.sort(np.mod(phases[index == k], TWO_PI)) == pytest.approx(expected, abs=1e-4)
