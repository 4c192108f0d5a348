"""Sweeps and ensembles where numbers go wrong: an invalid point does not affect others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mpmath
import numpy as np
import pytest

from tests.solvers.stress.structures import GAP, springs
from vibroimpact_solvers import (
    ensemble,
    existence_bands,
    impact_modes,
    presets,
    resonances,
    spectrum,
    sweep,
    time_history,
)
from vibroimpact_solvers.errors import Status
from vibroimpact_solvers.kernels import modal
from vibroimpact_solvers.model import RANGE, Constraint, System
from vibroimpact_solvers.plan import Stage

OK, INVALID = Status.OK, Status.INVALID
EXTREMES = [5e-324, 1e-200, 1e-90, 1e-12, 1.0, 1e12, 1e90, 1e200]
STATUSES = [INVALID, INVALID, OK, OK, OK, OK, OK, INVALID]


def swept(
    kind: str,
    values: Sequence[float],
    at: Callable[[float], Any],
    stage: Stage = Stage.SPECTRUM,
) -> sweep.Result:
    """Sweep one field over some values."""
    numbers = np.array(values)
    axis = sweep.Axis("size", "size", numbers, stage=stage)
    problem = sweep.Problem(
        kind, (axis,), lambda index: at(float(numbers[index[0]])), springs([1.0] * 5, [1.0] * 6, ())
    )
    return sweep.solve(problem, sweep.plan(problem))


def chain(gap: float = GAP, stiffness: float = 1.0, mass: float = 1.0) -> System:
    stiffnesses, masses = np.ones(6), np.ones(5)
    stiffnesses[2], masses[2] = stiffness, mass
    return springs(masses, stiffnesses, [Constraint.at(1, gap, 0.9)])


def modes(system: System, Omega: float = 2.5) -> impact_modes.Problem:
    numbers = np.array([Omega])
    outputs = frozenset({"impulse", "exists", "reason", "stability"})
    return impact_modes.Problem(system, numbers * (2 / np.pi), Omega=numbers, outputs=outputs)


def history(system: System, speed: float, t_end: float = 12.0) -> time_history.Problem:
    v = np.zeros(system.n)
    v[1] = speed
    state = time_history.State(np.zeros(system.n), v)
    return time_history.Problem(system, state, t_end, outputs=frozenset({"impacts"}))


def bands(system: System) -> existence_bands.Problem:
    top = spectrum.largest_frequency(system)
    return existence_bands.Problem(system, 1.1 * top, 1.5 * top)


class TestSweeps:
    def test_gaps_of_impact_modes(self) -> None:
        """Impulses are proportional to the gap; the growth of deviations does not see it."""
        result = swept(
            "impact-modes", EXTREMES, lambda size: modes(chain(GAP * size)), Stage.IMPULSE
        )
        assert result.arrays["status"].tolist() == STATUSES
        good = result.arrays["status"] == OK
        scaled = result.arrays["impulse"][good].ravel() / np.array(EXTREMES)[good]
        np.testing.assert_allclose(scaled, scaled[2], rtol=1e-12)
        assert np.isnan(result.arrays["impulse"][~good]).all()
        np.testing.assert_allclose(result.arrays["stability"][good], 1.0, atol=1e-6)

    @pytest.mark.parametrize("name", ["stiffness", "mass"])
    def test_ratios_of_all_kinds(self, name: str) -> None:
        """Every point is what it would be alone, next to refused ones."""
        values = [1e-12, 1.0, 1e12, 5e-324 if name == "mass" else 1e200]
        kinds: dict[str, tuple[Any, Callable[[System], Any], str]] = {
            "impact-modes": (impact_modes, modes, "impulse"),
            "resonances": (resonances, resonances.Problem, "natural"),
            "existence-bands": (
                existence_bands,
                bands,
                "band_start",
            ),
            "time-history": (time_history, lambda s: history(s, 1.0, 1e-5), "impact_time"),
        }
        for kind, (solver, problem, output) in kinds.items():
            result = swept(kind, values, lambda size, of=problem: of(chain(**{name: size})))
            assert result.arrays["status"].tolist() == [OK, OK, OK, INVALID], kind
            for place, size in enumerate(values[:3]):
                one = problem(chain(**{name: size}))
                alone = getattr(solver.solve(one, solver.plan(one)), output)
                array = result.arrays[output]
                dim = output.partition("_")[0] if "_" in output else "resonance"
                if f"{dim}_count" in result.arrays:
                    first = result.arrays[f"{dim}_offset"][place]
                    array = array[first : first + result.arrays[f"{dim}_count"][place]]
                else:
                    array = array[place]
                np.testing.assert_array_equal(array, alone, err_msg=kind)


class TestEnsembles:
    @pytest.mark.parametrize("gap", [1e-90, 1e-12, 1e12, 1e90])
    def test_everything_scales_with_the_gap(self, gap: float) -> None:
        speeds = np.array([1.5, 2.0, 3.0])[:, np.newaxis]
        results = []
        for size in (1.0, gap):
            system = presets.oscillator([Constraint.at(0, size, 0.9)], 1.0)
            problem = ensemble.Problem(system, 0.0 * speeds, speeds * size, 12.0)
            results.append(ensemble.solve(problem, ensemble.plan(problem)))
        one, other = results
        assert (one.status == OK).all()
        assert one.impact_count is not None
        assert other.impact_count is not None
        assert (one.impact_count == other.impact_count).all()
        assert one.impact_count.min() > 3
        assert other.impact_time is not None
        np.testing.assert_allclose(other.impact_time, one.impact_time, rtol=1e-12)

    def test_refused_members_affect_no_others(self) -> None:
        """Denormal and huge speeds, and a start beyond the wall."""
        system = presets.oscillator([Constraint.at(0, 1.0, 0.9)], 1.0)
        x = np.array([0.0, 0.0, 0.0, 0.0, 1.0 + 1e-6, 0.0])[:, np.newaxis]
        v = np.array([3.0, 5e-324, 1e-150, 1e150, 1.0, 1e30])[:, np.newaxis]
        problem = ensemble.Problem(system, x, v, 4.0)
        result = ensemble.solve(problem, ensemble.plan(problem))
        expected = [OK, INVALID, INVALID, INVALID, INVALID, OK]
        assert result.status.tolist() == expected
        assert len(result.error_failures) == 4
        one = problem.member(0)
        alone = time_history.solve(one, time_history.plan(one))
        assert alone.impact_time is not None
        assert result.impact_time is not None
        many = result.impact_time[alone.impact_time.size :]
        np.testing.assert_array_equal(
            result.impact_time[: alone.impact_time.size], alone.impact_time
        )
        # At 1e30 it strikes hundreds of times before it is slow; all the same right.
        with mpmath.workdps(60):
            u, t, expected_times = mpmath.mpf(10) ** 30, mpmath.mpf(10) ** -30, []
            while t < 4:
                expected_times.append(float(t))
                u *= mpmath.mpf(0.9)
                t += 2 * mpmath.atan(1 / u)
        np.testing.assert_allclose(many, expected_times, rtol=1e-13)

    def test_the_kernel_knows_the_range(self) -> None:
        assert (modal.SMALLEST, modal.LARGEST) == RANGE

    def test_grazing_restitution_and_rest_in_one_ensemble(self) -> None:
        """Amplitudes 1e-15 about the wall: members equal their own time histories."""
        for k in (0.0, 1.0):
            system = presets.oscillator([Constraint.at(0, 1.0, k)], 1.0)
            speeds = 1.0 + np.array([-1e-9, -1e-15, 0.0, 1e-15, 1e-9, 1.0])
            v = speeds[:, np.newaxis]
            problem = ensemble.Problem(system, 0.0 * v, v, 20.0)
            result = ensemble.solve(problem, ensemble.plan(problem))
            assert (result.status == OK).all()
            assert result.count_impacts[0] == 0
            assert result.impact_time is not None
            assert result.impact_offset is not None
            for i in range(speeds.size):
                one = problem.member(i)
                alone = time_history.solve(one, time_history.plan(one)).impact_time
                assert alone is not None
                first = result.impact_offset[i]
                rows = result.impact_time[first : first + alone.size]
                np.testing.assert_array_equal(rows, alone)
