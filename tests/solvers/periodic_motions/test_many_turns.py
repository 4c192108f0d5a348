"""Numbers along motions whose load turns hundreds of thousands of times in a period."""

from __future__ import annotations

import numpy as np
import pytest

from vibroimpact_solvers import periodic_motions as driven
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.plan import Stage

TWO_PI = 2.0 * np.pi
ZETA, OMEGA = 0.005, 0.83
Loads = list[tuple[float, int, float]]  # amplitude, harmonic and phase


def solved(periods: int, gap: float, loads: Loads) -> driven.Result:
    one = SymmetricMatrix.diagonal([1.0])
    wall = Constraint((0,), (1.0,), None, gap, 0.8)
    system = System(one, one, (wall,), C=SymmetricMatrix.diagonal([2.0 * ZETA]))
    load = tuple(driven.Force((0,), (1.0,), *term) for term in loads)
    outputs = frozenset({"extremes", "energy"})
    problem = driven.Problem(system, np.array([OMEGA]), load, periods=periods, outputs=outputs)
    return driven.solve(problem, driven.plan(problem))


def terms(phase: float, impulse: float, T: float, loads: Loads) -> tuple[np.ndarray, np.ndarray]:
    """Return c and s of ``x = Re sum c e^(s t)``, t being the time since the impact."""
    own = complex(-ZETA, np.sqrt(1.0 - ZETA**2))
    c, s = [-1j * impulse / own.imag / -np.expm1(own * T)], [own]
    for amplitude, h, at in loads:
        rate = 1j * h * OMEGA
        c.append(amplitude * np.exp(1j * (h * phase + at)) / (1.0 + rate**2 + 2.0 * ZETA * rate))
        s.append(rate)
    return np.array(c), np.array(s)


def integral(a: np.ndarray, b: np.ndarray, s: np.ndarray, T: float) -> float:
    """Return the integral over [0, T] of ``Re sum a e^(s t) Re sum b e^(s t)``."""
    total = 0.0
    for k in range(s.size):
        for j in range(s.size):
            for factor, rate in ((b[j], s[k] + s[j]), (b[j].conj(), s[k] + s[j].conj())):
                turned = round(float((rate * T).imag) / TWO_PI)
                whole = rate.real == 0.0 and abs(rate.imag * T - TWO_PI * turned) < 1e-6
                value = (T if rate == 0.0 else 0.0) if whole else np.expm1(rate * T) / rate
                total += 0.5 * float((a[k] * factor * value).real)
    return total


@pytest.mark.parametrize(("periods", "gap", "high"), [(7, 0.3, 9.0), (70, 1e7, 9e5)])
def test_numbers_along_a_motion_of_many_turns(periods: int, gap: float, high: float) -> None:
    loads = [(1.0, 1, 0.4), (high, 1000, 1.0)]
    result = solved(periods, gap, loads)
    assert (result.solution_impacts == 0).sum() == 1
    assert ((result.solution_impacts == 1).sum() >= 2) == (gap == 0.3)
    high = high / (1000.0 * OMEGA) ** 2
    T = periods * TWO_PI / OMEGA
    for row in range(result.solution_impacts.size):
        mine = np.flatnonzero(result.impact_solution == row)
        phase = float(result.impact_phase[mine[0]]) if mine.size else 0.0
        p = -float(result.impact_momentum[mine[0]]) if mine.size else 0.0
        c, s = terms(phase, p, T, loads)
        rms = np.sqrt(integral(c, c, s, T) / T)
        assert result.solution_rms[row, 0] == pytest.approx(rms, rel=1e-8)
        lost = 2.0 * ZETA * integral(c * s, c * s, s, T)
        if mine.size:
            lost += 0.5 * (1.0 - 0.8**2) * float(result.impact_velocity[mine[0]]) ** 2
        assert result.solution_energy_lost[row] == pytest.approx(lost, rel=1e-8)
        assert result.solution_work[row] == pytest.approx(lost, rel=1e-8)
        t = np.linspace(0.0, T, 40_001)
        x = (c * np.exp(t[:, np.newaxis] * s)).real.sum(axis=1)
        most, least = result.solution_x_max[row, 0], result.solution_x_min[row, 0]
        assert x.max() <= most + 1e-8
        assert x.min() >= least - 1e-8
        # Points are half a turn apart, or less.
        assert most - x.max() < 2.0 * high + 1e-4
        assert x.min() - least < 2.0 * high + 1e-4
        assert (np.abs(result.error_rms[row]) < 1e-7).all()


@pytest.mark.parametrize("output", ["extremes", "energy"])
def test_the_plan_counts_turns_and_harmonics(output: str) -> None:
    one = SymmetricMatrix.diagonal([1.0])
    damped = SymmetricMatrix.diagonal([2.0 * ZETA])

    def price(harmonics: tuple[int, ...], periods: int, C: SymmetricMatrix | None) -> float:
        system = System(one, one, (Constraint((0,), (1.0,), None, 1.0),), C=C)
        load = tuple(driven.Force((0,), (1.0,), 1.0, h) for h in harmonics)
        outputs = frozenset({output})
        Omega = np.array([OMEGA])
        problem = driven.Problem(system, Omega, load, periods=periods, outputs=outputs)
        step = driven.plan(problem).step(Stage.ENERGY)
        assert step is not None
        return step.flops

    # One harmonic alone is as many solutions as any other.
    assert price((1,), 1000, damped) > 100.0 * price((1,), 1, damped)
    assert price((1000,), 1, damped) > 100.0 * price((1,), 1, damped)
    assert price((1, 50), 20, damped) > 20.0 * price((1, 2), 1, damped)
    assert price((100, 101), 1, damped) > 10.0 * price((100,), 1, damped)
    assert price((1,), 1000, None) > 100.0 * price((1,), 1, None)
