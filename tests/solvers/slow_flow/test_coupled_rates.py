"""Averages of eq. 10.44 in closed form, against quadrature and the chapter's references."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from vibroimpact_solvers.slow_flow.coupled_rates import Coupled

Values = Callable[[str], dict[str, Any]]
Order = Callable[[Any, Any], float]

FIG = Coupled(1.0, 0.01, 0.05, 1.0)
OTHER = Coupled(1.7, 0.03, 0.2, 0.6)


def numbers(texts: Any) -> np.ndarray:
    return np.array(list(texts), dtype=float)


def mean(of: Coupled, y: np.ndarray) -> np.ndarray:
    """Return the mean of the exact rates over the phase: tau in [-1, 1], e = 1 and -1."""
    nodes, weights = np.polynomial.legendre.leggauss(80)
    rates = [[of.exact(tau, e, y) for tau in nodes] for e in (1.0, -1.0)]
    found: np.ndarray = np.einsum("etk,t->k", np.array(rates), weights) / 4.0
    return found


@pytest.mark.parametrize("gamma", ["0.2", "0.8", "1.4"])
def test_reference(values: Values, gamma: str) -> None:
    row = values("21")[gamma]
    y = np.array([float(gamma), 0.0, -0.003, 0.04])
    averaged = np.array(FIG.averaged(0.0, 1.0, y)[:4]) / np.cos(y[0])
    expected = numbers(row["averaged_closed_form"])
    np.testing.assert_allclose(averaged, expected, rtol=1e-12)
    truncated = FIG.truncated(0.0, 1.0, y)
    np.testing.assert_allclose(truncated[:4], numbers(row["truncated_10.46"]), rtol=1e-12)


@pytest.mark.parametrize("of", [FIG, OTHER])
@pytest.mark.parametrize("gamma", [0.05, 0.7, 1.2, 1.5, 1.57, np.pi / 2 - 1e-5])
def test_averages_are_the_means(of: Coupled, gamma: float) -> None:
    y = np.array([gamma, 0.0, -0.07, 0.11])
    np.testing.assert_allclose(of.averaged(0.0, 1.0, y), mean(of, y), rtol=1e-10, atol=1e-12)


def test_averages_are_regular_at_grazing() -> None:
    at, near = (FIG.averaged(0.0, 1.0, np.array([np.pi / 2 - d, 0, -0.1, 0.2])) for d in (0, 1e-8))
    np.testing.assert_allclose(at, near, atol=1e-7)


def test_truncation_leaves_higher_powers(order: Order) -> None:
    """What eq. 10.46 leaves is one power smaller than it says: gamma^4, gamma^5 and gamma^4."""
    sizes, found = [0.06, 0.04, 0.03, 0.02], []
    for gamma in sizes:
        y = np.array([gamma, 0.0, -0.5, 0.7])
        averaged = np.array(OTHER.averaged(0.0, 1.0, y)) / np.cos(gamma)
        difference = averaged - np.array(OTHER.truncated(0.0, 1.0, y))
        # B' contains phi', whose remainder is of its own order.
        difference[3] -= -0.5 * np.pi * difference[1] * y[2]
        found.append(np.abs(difference[[0, 1, 3]]))
    slopes = [order(sizes, column) for column in np.array(found).T]
    assert slopes == pytest.approx([4.0, 5.0, 4.0], abs=0.1)
