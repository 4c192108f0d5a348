"""Attractors of two masses: the impact damper of Masri and Caughey, and a torus."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import scipy.linalg

from vibroimpact_solvers import attractors, time_history
from vibroimpact_solvers.attractors import Force, Nature, Verification
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System


@dataclass(frozen=True)
class Damper:
    """A mass 1 on a spring 1 and a damper, a particle between two stops on it."""

    omega: float = 1.0
    zeta: float = 0.05
    mu: float = 0.1
    k: float = 0.3
    d: float = 6.0  # between the stops
    F: float = 0.5

    def system(self) -> System:
        stops = Constraint((1, 0), (1.0, -1.0), 0.5 * self.d, 0.5 * self.d, self.k)
        return System(
            SymmetricMatrix.diagonal([1.0, self.mu]),
            SymmetricMatrix.diagonal([1.0, 0.0]),
            (stops,),
            C=SymmetricMatrix.diagonal([2.0 * self.zeta, 0.0]),
        )

    def speeds(self) -> list[float]:
        """Return the speeds u of the particle in symmetric motions with two impacts per cycle.

        S. F. Masri and T. K. Caughey, On the stability of the impact damper, J. Appl. Mech. 33
        (1966) 586-592. After half a period, the motion is its mirror image: the particle has flown
        at u from one stop to the other, the mass struck at xa has been carried to -xa. Momentum and
        restitution give its velocities before and after, both multiples of u, and the phase of the
        load is left, with its amplitude known: a quadratic equation.
        """
        k, mu, half = self.k, self.mu, math.pi / self.omega
        A = np.array([[0.0, 1.0], [-1.0, -2.0 * self.zeta]])
        E = scipy.linalg.expm(A * half)
        after, before = (1.0 - k - 2.0 * k * mu) / (1.0 + k), (1.0 - k + 2.0 * mu) / (1.0 + k)
        # u half = d - 2 xa, and the response to the load is p = a + b u at the impact.
        solve = np.linalg.inv(np.eye(2) + E)
        constant, by_u = np.array([0.5 * self.d, 0.0]), np.array([-0.5 * half, 0.0])
        a = solve @ (E @ constant + constant)
        b = solve @ (E @ (by_u + np.array([0.0, after])) + by_u + np.array([0.0, before]))
        size = self.F / math.hypot(1.0 - self.omega**2, 2.0 * self.zeta * self.omega)
        a, b = (p / np.array([1.0, self.omega]) for p in (a, b))
        roots = np.roots([b @ b, 2.0 * a @ b, a @ a - size**2])
        return [float(u.real) for u in roots if abs(u.imag) < 1e-12 and u.real > 0.0]


def test_the_impact_damper_settles_on_the_symmetric_motion_of_masri_and_caughey() -> None:
    damper = Damper()
    rng = np.random.default_rng(3)
    x = rng.uniform(-1.0, 1.0, (12, 2))
    v = rng.uniform(-1.0, 1.0, (12, 2))
    problem = attractors.Problem(
        damper.system(), np.array([damper.omega]), x, v, (Force((0,), (1.0,), damper.F),)
    )
    result = attractors.solve(problem, attractors.plan(problem))
    assert result.attractor_verification is not None
    assert result.attractor_verification[0] == Verification.CONFIRMED
    assert (result.attractor_period[0], result.attractor_impacts[0]) == (1, 2)
    assert result.attractor_motions[0] == 12
    first, second = np.flatnonzero(result.impact_attractor == 0)
    assert abs(result.impact_phase[second] - result.impact_phase[first]) == pytest.approx(math.pi)
    assert result.impact_side[first] == -result.impact_side[second]
    # The particle turns: it exchanges twice its momentum.
    speed = result.impact_momentum[first] / (2.0 * damper.mu)
    assert min(abs(speed - u) for u in damper.speeds()) < 1e-9


def quasi_periodic() -> System:
    stop = Constraint((0,), (1.0,), lower=None, upper=0.1, restitution=0.9)
    K = np.array([[1.5, -0.5], [-0.5, 0.5]])
    return System(
        SymmetricMatrix.diagonal([1.0, 1.0]), SymmetricMatrix.dense(K), (stop,),
        C=SymmetricMatrix.dense(0.04 * K),
    )  # fmt: skip


OMEGA = 2.75
LOAD = (Force((0,), (1.0,), 1.0),)


def test_motions_on_a_torus_are_quasi_periodic() -> None:
    x, v = np.zeros((2, 2)), np.array([[1.0, 0.5], [-1.0, 0.3]])
    problem = attractors.Problem(
        quasi_periodic(), np.array([OMEGA]), x, v, LOAD, settle=800, observe=2000
    )
    result = attractors.solve(problem, attractors.plan(problem))
    assert result.attractor_nature.tolist() == [Nature.QUASI_PERIODIC]
    assert result.attractor_motions.tolist() == [2]
    assert abs(result.attractor_exponent[0]) <= result.error_attractor_exponent[0] < 2e-3
    # A time history from there does not return within 300 periods; one from beside it comes no
    # closer and goes no farther, but for the turn along the torus.
    states = followed(result.attractor_x[0], result.attractor_v[0])
    beside = followed(result.attractor_x[0] + 1e-6, result.attractor_v[0])
    size = np.ptp(states, axis=0).max()
    assert min(np.abs(states[n:] - states[:-n]).max() for n in range(1, 301)) > 1e-3 * size
    apart = np.abs(states - beside).max(axis=1)
    assert 1e-8 < apart[-300:].min() <= apart[-300:].max() < 1e-4


def followed(x: Any, v: Any) -> Any:
    """Return displacements, and velocities over the frequency, once per period of the drive."""
    t = 2.0 * math.pi / OMEGA * np.arange(2001)
    motion = time_history.Problem(
        quasi_periodic(), time_history.State(x, v), float(t[-1]), t,
        outputs=frozenset({"x", "v"}), load=(time_history.Harmonic(0, 1.0, OMEGA),),
    )  # fmt: skip
    result = time_history.solve(motion, time_history.plan(motion))
    assert result.x is not None
    assert result.v is not None
    return np.concatenate([result.x, result.v / OMEGA], axis=1)


def test_loads_in_a_direction_and_harmonics_are_those_of_periodic_motions() -> None:
    """What settles is confirmed by Newton's method, which knows the load by itself."""
    load = (
        Force((0, 1), (1.0, -0.5), 0.6, phase=0.3),
        Force((1,), (1.0,), 0.2, harmonic=2, phase=-1.0),
    )
    x, v = np.zeros((4, 2)), np.linspace(-1.0, 1.0, 8).reshape(4, 2)
    problem = attractors.Problem(
        quasi_periodic(), np.array([1.9]), x, v, load, settle=800, dofs=np.array([1])
    )
    result = attractors.solve(problem, attractors.plan(problem))
    assert result.attractor_verification is not None
    assert (result.attractor_verification == Verification.CONFIRMED).all()
    assert result.attractor_x.shape[1] == 1


@pytest.mark.parametrize("omega", [0.7, 0.9, 1.3, 1.9, 2.5])
def test_exponents_are_those_of_the_multipliers_where_damping_couples_modes(omega: float) -> None:
    """Two stops, a constant load, and damping that modes share."""
    stops = (
        Constraint((0,), (1.0,), lower=None, upper=0.1, restitution=0.7),
        Constraint((1,), (1.0,), lower=0.4, upper=0.3, restitution=0.5),
    )
    system = System(
        SymmetricMatrix.diagonal([1.0, 2.0]),
        SymmetricMatrix.dense(np.array([[2.0, -1.0], [-1.0, 1.5]])),
        stops,
        C=SymmetricMatrix.dense(np.array([[0.30, -0.05], [-0.05, 0.08]])),
        force=np.array([0.05, -0.02]),
    )
    v = np.random.default_rng(2).standard_normal((10, 2))
    problem = attractors.Problem(system, np.array([omega]), np.zeros((10, 2)), v, LOAD)
    result = attractors.solve(problem, attractors.plan(problem))
    assert result.attractor_verification is not None
    assert result.attractor_stability is not None
    assert result.error_stability is not None
    rows = np.flatnonzero(result.attractor_verification == Verification.CONFIRMED)
    assert rows.size
    duration = result.attractor_period[rows] * 2.0 * math.pi / omega
    modulus, doubt = result.attractor_stability[rows], result.error_stability[rows]
    apart = np.abs(result.attractor_exponent[rows] - np.log(modulus) / duration)
    assert (apart <= result.error_attractor_exponent[rows] + doubt / modulus / duration).all()
