"""Deviations against differences of exact motions with other data."""

from __future__ import annotations

import numpy as np

from tests.solvers.kernels.compiled import compiled
from vibroimpact_solvers.kernels import deviations, flow
from vibroimpact_solvers.kernels.rigid_state import IMPACT, PROGRESS, Errors, Motion

PAIRS = 3  # a rotation, a hyperbola and a free body
PUSH = 0.8


def flow_of(nu: np.ndarray) -> flow.Flow:
    none, push = np.zeros(PAIRS), np.array([0.0, 0.0, PUSH])
    return flow.Flow(none, nu, none, push, np.zeros(0, flow.DRIVE), 1, 2, False, 0.0)


def errors_of(drifts: np.ndarray, drift: float) -> Errors:
    """Return the errors of frequencies, and no others."""
    none = np.zeros(PAIRS)
    return Errors(
        np.zeros((4, 2, PAIRS)), drifts, *np.zeros((3, 1, 1, 2, PAIRS)),
        np.ones((2, PAIRS)), np.ones((2, PAIRS)), none,
        np.zeros((0, 2, PAIRS)), np.zeros(0, np.int64), 0.0, drift,
    )  # fmt: skip


def moved(nu: np.ndarray, z: np.ndarray, s: float) -> np.ndarray:
    propagator, out = np.zeros((2, PAIRS)), np.zeros((2, PAIRS))
    compiled(flow.set_propagator)(flow_of(nu), s, 0.0, propagator)
    compiled(flow.propagate_state)(flow_of(nu), propagator, s, z, out)
    return out


def held(start: np.ndarray, drift: float, s: float) -> np.ndarray:
    """Return what an eigenvalue 2 drift does to a free body, to first order."""
    times, weights = np.polynomial.legendre.leggauss(8)
    t = 0.5 * s * (times + 1.0)
    force = -2.0 * drift * (start[0] + start[1] * t + 0.5 * PUSH * t**2)
    return np.array([(weights * (s - t)) @ force, weights @ force]) * 0.5 * s


def test_errors_of_frequencies_turn_rotations_stretch_hyperbolas_and_push_free_bodies() -> None:
    nu, drift, s = np.array([1.3, 0.7, 0.0]), np.array([0.9, 0.4, 0.3]), 2.1
    z0, step = np.array([[0.3, 0.5, 0.2], [-0.8, 0.6, 1.1]]), 1e-6
    z = moved(nu, z0, s)
    expected = (moved(nu + step * drift, z0, s) - moved(nu - step * drift, z0, s)) / (2.0 * step)
    expected[:, 2] = held(z0[:, 2], drift[2], s)
    motion = Motion(
        z,
        np.zeros((1, 2, PAIRS)),
        np.zeros(1, PROGRESS),
        np.zeros(1, IMPACT),
        np.zeros(0),
    )
    errors = errors_of(drift[np.newaxis], 0.9)
    compiled(deviations.add_rounding)(flow_of(nu), motion, errors, 0, s, np.abs(z))
    np.testing.assert_allclose(motion.deviations[0], expected, rtol=1e-8)


def test_an_error_that_is_not_a_number_stays() -> None:
    progress = np.zeros(1, PROGRESS)
    progress["largest"] = 1.0
    columns = np.ones((3, 2, PAIRS))
    columns[1, 0, 0] = np.nan
    errors = errors_of(np.zeros((3, PAIRS)), 0.0)
    assert np.isnan(compiled(deviations.estimated_error)(columns, errors, progress))
