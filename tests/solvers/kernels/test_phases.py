"""Tangents of phases, and what rounding took from them, against extended precision."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import pytest

from vibroimpact_solvers.impact_modes.problem import conversion_rests
from vibroimpact_solvers.kernels import phases
from vibroimpact_solvers.kernels.jit import kernel

EPS = float(np.finfo(np.float64).eps)


@kernel
def tangents(x: np.ndarray, rest: np.ndarray) -> np.ndarray:
    found = np.empty(x.size)
    for i in range(x.size):
        found[i] = phases.tangent(x[i], rest[i])
    return found


@kernel
def sines(x: np.ndarray) -> np.ndarray:
    found = np.empty((2, x.size))
    for i in range(x.size):
        found[0, i], found[1, i] = phases.sine_cosine(x[i], 0.0)
    return found


def excess(found: np.ndarray, x: np.ndarray, exact: Callable[[Any], Any], rest: Any = 0) -> float:
    """Return the largest relative error, less what an error of 1e-32 of the phase does to it."""
    with mpmath.workdps(60):
        errors = []
        for value, phase, extra in zip(found, x, np.broadcast_to(rest, x.shape), strict=True):
            at = mpmath.mpf(float(phase)) + mpmath.mpf(float(extra))
            right, moved = exact(at), exact(at * (1 + mpmath.mpf(10) ** -32))
            errors.append(
                float((abs(mpmath.mpf(float(value)) - right) - abs(moved - right)) / abs(right))
            )
    return max(errors)


def phases_up_to(largest: float, count: int = 3000) -> np.ndarray:
    return np.random.default_rng(1).uniform(0.0, largest, count)


@pytest.mark.parametrize("largest", [0.8, 7.0, 1e3, 1e8, 1e12])
def test_tangent(largest: float) -> None:
    x = phases_up_to(largest)
    assert excess(tangents(x, np.zeros(x.size)), x, mpmath.tan) < 2 * EPS


@pytest.mark.parametrize("multiple", [1, 2, 3, 1001, 10**9 + 1, 10**12])
def test_tangent_beside_its_poles_and_zeros(multiple: int) -> None:
    """The numbers nearest to multiples of pi/2, and what they miss of them."""
    x = multiple * 0.5 * np.pi * (1.0 + EPS * np.arange(-4, 5))
    rest = 0.3 * EPS * x
    assert excess(tangents(x, np.zeros(x.size)), x, mpmath.tan) < 2 * EPS
    assert excess(tangents(x, rest), x, mpmath.tan, rest) < 2 * EPS


def test_small_phases() -> None:
    x = np.array([5e-324, 2.2e-308, 1e-300, 1e-20, 1e-8, 1e-3])
    assert excess(tangents(x, np.zeros(x.size)), x, mpmath.tan) < 2 * EPS


@pytest.mark.parametrize("largest", [0.8, 1e3, 1e12])
def test_sine_and_cosine(largest: float) -> None:
    x = phases_up_to(largest)
    sine, cosine = sines(x)
    assert excess(sine, x, mpmath.sin) < EPS
    assert excess(cosine, x, mpmath.cos) < EPS


def test_conversion_of_frequencies() -> None:
    Omega = np.concatenate([10.0 ** np.arange(-280.0, 300.0, 7.0), phases_up_to(10.0, 100)])
    omega = Omega * (2.0 / np.pi)
    rests = conversion_rests(Omega, omega)
    with mpmath.workdps(60):
        for each, w, rest in zip(Omega, omega, rests, strict=True):
            exact = 2 * mpmath.mpf(float(each)) / mpmath.pi / mpmath.mpf(float(w)) - 1
            assert abs(float(exact) - rest) < 1e-30


def test_a_frequency_that_is_not_the_other_one_is_meant() -> None:
    assert conversion_rests(np.array([1.0]), np.array([0.64])) == 0.0
