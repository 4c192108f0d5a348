"""Derivatives of coordinates along the flow, and bounds of the highest, against exact ones."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest

from tests.solvers.kernels.compiled import compiled
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels import flow
from vibroimpact_solvers.kernels.passages import LOW, ORDER

derivatives, near_derivatives = compiled(flow.derivatives), compiled(flow.near_derivatives)
bound, set_lengths = compiled(flow.bound), compiled(flow.set_lengths)
propagate_state, set_propagator = compiled(flow.propagate_state), compiled(flow.set_propagator)

ROTATIONS, HYPERBOLAS = 2, 6
ALPHA = np.array([-0.1, 0.0, -1.0, -1.0, -0.7, 0.2, -0.5])
NU = np.array([1.0, 0.3, 0.999, 0.2, 1e-6, 0.9, 0.0])
"""Of two rotations; a slow and a fast exponential, two near ones, nearly critical ones and a
saddle; and of a parabola."""


def moves() -> flow.Flow:
    """Return the flow of these pairs."""
    none = np.zeros(ALPHA.size)
    drives = np.zeros(0, flow.DRIVE)
    return flow.Flow(ALPHA, NU, none, none, drives, ROTATIONS, HYPERBOLAS, True, 0.0)


def watched(form: Floats) -> flow.Watched:
    """Return one coordinate, and the sizes of its parts that bounds are made of."""
    rotates, apart = np.arange(ALPHA.size) < ROTATIONS, np.abs(ALPHA) + NU
    rate = np.where(rotates, np.hypot(ALPHA, NU), apart)
    size = np.where(rotates, np.hypot(*form), np.abs(form).max(axis=0))[np.newaxis]
    one = form[np.newaxis]
    return flow.Watched(one, one, one, one, size, size * rate**ORDER, size * rate**LOW)


def exact(form: Floats, z: Floats, order: int) -> tuple[mp.mpf, mp.mpf]:
    """Return a derivative, and the sum of the magnitudes of its exponentials."""
    total, size = mp.mpf(0), mp.mpf(0)
    for j, (alpha, nu) in enumerate(zip(ALPHA.tolist(), NU.tolist(), strict=True)):
        back = -nu if j < ROTATIONS else (nu if j < HYPERBOLAS else 0.0)
        there = nu if j < HYPERBOLAS else 1.0
        power = mp.matrix([[alpha, there], [back, alpha]]) ** order
        value = power * mp.matrix(z[:, j].tolist())
        parts = [mp.mpf(form[k, j]) * value[k] for k in range(2)]
        total += sum(parts)
        size += sum(map(abs, parts)) + abs(mp.mpf(form[:, j] @ z[:, j]))
    return total, size


@pytest.mark.parametrize("seed", range(4))
def test_derivatives_are_those_of_matrices(seed: int) -> None:
    form, z = np.random.default_rng(seed).standard_normal((2, 2, ALPHA.size))
    d, low = np.empty(ORDER), np.empty(LOW)
    derivatives(moves(), form, z, d)
    near_derivatives(moves(), form, z, low)
    with mp.workdps(50):
        for order in range(ORDER):
            value, size = exact(form, z, order)
            for found in (d, low)[: 1 + (order < LOW)]:
                assert abs(found[order] - value) <= 1e-13 * 2.0**order * (size + 1.0)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("high", [True, False])
def test_bounds_hold_for_a_while(seed: int, high: bool) -> None:
    form, z = np.random.default_rng(seed).standard_normal((2, 2, ALPHA.size))
    moved, propagator = np.empty(z.shape), np.empty(z.shape)
    lengths, H = np.empty(ALPHA.size), 1.5
    set_lengths(moves(), z, lengths)
    most = bound(moves(), watched(form), 0, z, lengths, high, H)
    with mp.workdps(50):
        for s in np.linspace(0.0, H, 16).tolist():
            set_propagator(moves(), s, 0.0, propagator)
            propagate_state(moves(), propagator, s, z, moved)
            value, _ = exact(form, moved, ORDER if high else LOW)
            assert abs(value) <= most * (1.0 + 1e-12)


def test_what_has_decayed_bounds_nothing() -> None:
    """Of two exponentials, the slow one is bounded by its own rate once the fast one is over."""
    form = np.zeros((2, ALPHA.size))
    z, lengths = np.zeros(form.shape), np.empty(ALPHA.size)
    form[0, 2], z[:, 2] = 1.0, 1.0  # nothing of the fast one
    set_lengths(moves(), z, lengths)
    most = bound(moves(), watched(form), 0, z, lengths, True, 1.0)
    assert math.isclose(most, (1.0 - NU[2]) ** ORDER, rel_tol=1e-9)
