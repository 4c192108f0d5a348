"""Preset structures: natural frequencies against formulas, refusals by the parameter to blame."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import scipy.linalg

from benchmarks.beams import EI, RHO_A, matrices
from vibroimpact_solvers import presets
from vibroimpact_solvers.errors import ModelError

ROOTS = (1.87510407, 4.69409113, 7.85475744)
"""cos(x) cosh(x) = -1: Blevins, Formulas for Natural Frequency and Mode Shape, table 8-1."""


def _frequencies(system: Any) -> np.ndarray[Any, Any]:
    M, K = system.M.to_dense(), system.K.to_dense()
    return np.sqrt(scipy.linalg.eigh(K, M, eigvals_only=True))


@pytest.mark.parametrize(("length", "stiffness", "mass"), [(1.0, 1.0, 1.0), (0.5, 100.0, 0.8)])
def test_a_beam_has_the_frequencies_of_a_cantilever(
    length: float, stiffness: float, mass: float
) -> None:
    Omega = _frequencies(presets.beam([], 30, length, stiffness, mass))[:3]
    unit = math.sqrt(stiffness / mass) / length**2
    # The elements lie above by about (x h)^4 / 720: 1e-6 of the third one.
    assert Omega == pytest.approx([root**2 * unit for root in ROOTS], rel=1e-5)


@pytest.mark.parametrize("elements", [1, 2, 7])
def test_a_beam_is_that_of_independently_assembled_elements(elements: int) -> None:
    system = presets.beam([], elements, 1.0, EI, RHO_A)
    M, K = matrices(elements)
    np.testing.assert_allclose(system.M.to_dense(), M, rtol=1e-14)
    np.testing.assert_allclose(system.K.to_dense(), K, rtol=1e-14)


def test_an_absorber_has_the_frequencies_of_den_hartog() -> None:
    """With f the tuning and m the ratio: g^4 - g^2 (1 + f^2 (1 + m)) + f^2 = 0."""
    ratio, tuning, Omega0 = 0.05, 0.9, 3.0
    Omega = _frequencies(presets.absorber([], Omega0, ratio, tuning)) / Omega0
    squares = np.sort(np.roots([1.0, -(1.0 + tuning**2 * (1.0 + ratio)), tuning**2]))
    assert Omega**2 == pytest.approx(squares, rel=1e-12)


def test_without_a_spring_an_absorber_is_held_by_its_stops_alone() -> None:
    system = presets.absorber([], 2.0, 0.1, 0.0)
    np.testing.assert_array_equal(system.K.to_dense(), [[4.0, 0.0], [0.0, 0.0]])


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: presets.absorber([], -1.0), "Omega0"),
        (lambda: presets.absorber([], 1.0, 0.0), "ratio"),
        (lambda: presets.absorber([], 1.0, 0.1, math.nan), "tuning"),
        (lambda: presets.beam([], 0), "elements"),
        (lambda: presets.beam([], 2, math.nan), "length"),
        (lambda: presets.beam([], 2, 1.0, -1.0), "EI"),
        (lambda: presets.beam([], 2, 1.0, 1.0, math.inf), "rhoA"),
    ],
)
def test_a_wrong_parameter_is_named(make: Any, name: str) -> None:
    with pytest.raises(ModelError) as failure:
        make()
    assert failure.value.pointer[0] == name
