"""What motions cost, by counters, and the cases of comparisons with other integrators."""

from __future__ import annotations

import math
import tracemalloc

import mpmath as mp
import numpy as np
import pytest

from vibroimpact_solvers import impact_modes, presets, spectrum
from vibroimpact_solvers import time_history as th
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.time_history.history import new_history

GAP = 0.2


def solve(system: System, state: th.State, t_end: float, *outputs: str) -> th.Result:
    history = np.array([t_end]) if outputs else None
    wanted = frozenset({"impacts", *outputs})
    problem = th.Problem(system, state, t_end, t=history, outputs=wanted)
    return th.solve(problem, th.plan(problem))


def on_mode(n: int, dof: int, omega: float) -> tuple[System, th.State]:
    """Return an elastic chain on its impact mode, at tau = 0: x = 0, v from eq. 10.47."""
    system = presets.chain(n, [Constraint.at(dof, GAP)])
    natural = spectrum.spectrum(system)
    problem = impact_modes.Problem(system, np.array([omega]), outputs=frozenset({"impulse"}))
    impulse = impact_modes.solve(problem, impact_modes.plan(problem)).impulse
    assert impulse is not None
    amplitude = natural.rows(np.array([dof]))[0] / np.cos(natural.roots / omega)
    return system, th.State(np.zeros(n), impulse[0, 0] / omega * (natural.modes @ amplitude))


@pytest.mark.needs("compiled kernels")
def test_expansions_grow_with_impacts_and_not_with_masses() -> None:
    """Two expansions for an impact in such motions, whatever the size; each costs O(N)."""
    for n, dof in ((13, 5), (100, 49), (400, 199)):
        top = 2.0 * math.sin(n * math.pi / (2 * (n + 1)))
        omega = 1.5 * 2.0 / np.pi * top
        for periods in (5, 20, 80):
            system, state = on_mode(n, dof, omega)
            result = solve(system, state, periods * 4.0 / omega)
            assert result.count_impacts == 2 * periods
            assert result.count_expansions <= 2.5 * result.count_impacts + 2


def test_a_hundred_impacts_of_an_oscillator() -> None:
    """Case A: walls +-1, k = 0.95, v = 5: from wall to wall at speed u takes 2 arctan(1/u)."""
    with mp.workdps(30):
        k, speed = mp.mpf("0.95"), mp.sqrt(24)
        t, times = mp.asin(mp.mpf(1) / 5), []
        for _ in range(100):
            times.append(t)
            speed *= k
            t += 2 * mp.atan(1 / speed)
        end = float((times[99] + t) / 2)
    system = presets.oscillator([Constraint.at(0, 1.0, 0.95)], 1.0)
    result = solve(system, th.State(np.zeros(1), np.array([5.0])), end)
    assert result.count_impacts == 100
    assert result.count_expansions == 101  # in closed form
    np.testing.assert_allclose(result.impact_time, [float(t) for t in times], rtol=4e-15)


@pytest.mark.needs("compiled kernels")
def test_a_million_impacts_of_an_oscillator() -> None:
    """Intervals of 2 arcsin(1/5): the time after 10^6 of them is known to two units in the last.

    Phases add up to 10^6 intervals with an error of a few roundings of one interval each.
    """
    count = 10**6
    with mp.workdps(40):
        half = mp.asin(mp.mpf(1) / 5)
        end = float(2 * half * count)
        last = half * (2 * count - 1)
    system = presets.oscillator([Constraint.at(0, 1.0)], 1.0)
    problem = th.Problem(system, th.State(np.zeros(1), np.array([5.0])), end)
    result = th.solve(problem, th.plan(problem))
    assert result.count_impacts == count
    assert result.impact_time is not None
    assert abs(float(result.impact_time[-1] / last - 1)) < 2.0 * 2.0**-52
    assert result.impact_velocity is not None
    np.testing.assert_allclose(np.abs(result.impact_velocity), math.sqrt(24.0), rtol=1e-13)


def test_a_mode_after_one_period_and_after_ten() -> None:
    """Case B: chain of 13, on the mode at (2/pi) Omega_5 + 0.02, which is unstable.

    The exact motion from the first state rounded to doubles, computed with 40 digits, departs
    from the mode by 1.6e-15 in one period and 3.2e-10 in ten: more cannot be asked for.
    """
    natural = spectrum.spectrum(presets.chain(13, [Constraint.at(5, GAP)]))
    omega = 2.0 / np.pi * float(natural.roots[4]) + 0.02
    system, state = on_mode(13, 5, omega)
    size = float(np.abs(state.v).max())
    for periods, bound in ((1, 2e-15), (10, 1e-9)):
        result = solve(system, state, periods * 4.0 / omega, "x", "v")
        assert result.count_impacts == 2 * periods
        assert result.x is not None
        assert result.v is not None
        off = np.concatenate([result.x[0] - state.x, result.v[0] - state.v])
        assert float(np.abs(off).max()) / size < bound
        length = float(np.linalg.norm(off) / np.linalg.norm(state.v))
        assert length < result.error_condition * 2.0**-52


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize(("n", "dof", "bound"), [(100, 49, 5e-14), (1000, 499, 5e-14)])
def test_a_mode_of_a_long_chain_after_ten_periods(n: int, dof: int, bound: float) -> None:
    """Case C: the mode at 1.5 (2/pi) Omega_N is hardly unstable."""
    top = 2.0 * math.sin(n * math.pi / (2 * (n + 1)))
    omega = 1.5 * 2.0 / np.pi * top
    system, state = on_mode(n, dof, omega)
    result = solve(system, state, 10 * 4.0 / omega, "x", "v")
    assert result.count_impacts == 20
    assert result.x is not None
    assert result.v is not None
    size = float(np.abs(state.v).max())
    assert float(np.abs(result.v[0] - state.v).max()) < bound * size
    assert float(np.abs(result.x[0]).max()) < bound * size


def test_histories_cost_what_is_asked() -> None:
    """Displacements are only made for the times and degrees of freedom that are wanted."""
    system, state = on_mode(13, 5, 1.9)
    given = {"t": np.linspace(0.0, 50.0, 7), "dofs": np.array([3, 1])}
    for outputs, sizes in (
        ({"impacts"}, (0, 0, 0, 0, 0)), ({"x"}, (14, 0, 0, 0, 7)), ({"energy"}, (0, 0, 0, 7, 7)),
        ({"a"}, (0, 0, 14, 0, 7)),
    ):  # fmt: skip
        problem = th.Problem(system, state, 50.0, outputs=frozenset(outputs), **given)  # type: ignore[arg-type]
        assert tuple(array.size for array in new_history(problem, 1)) == sizes
    assert solve(system, state, 50.0).x is None


@pytest.mark.needs("compiled kernels")
def test_free_bodies_of_a_dense_structure_take_the_memory_of_its_modes() -> None:
    """Six of them: the roundings in their eigenvalues are sums of n^2 terms for each."""
    n, bodies = 600, 6
    rng = np.random.default_rng(5)
    rest, _ = np.linalg.qr(rng.standard_normal((n, n - bodies)))
    K = SymmetricMatrix.dense(rest @ np.diag(np.arange(1.0, n - bodies + 1)) @ rest.T)
    system = System(SymmetricMatrix.diagonal(np.ones(n)), K, (Constraint.at(0, GAP),))
    problem = th.Problem(system, th.State(np.zeros(n), np.eye(1, n)[0]), 0.1)
    tracemalloc.start()
    th.prepare(problem, th.plan(problem))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert (spectrum.spectrum(system).roots == 0.0).sum() == bodies
    assert peak < 20 * 8 * n**2
