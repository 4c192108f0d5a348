"""Slow flows where numbers go wrong, against exact recursions in extended precision."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest

from vibroimpact_solvers import presets, slow_flow
from vibroimpact_solvers.errors import ModelError, PlanError
from vibroimpact_solvers.model import Constraint
from vibroimpact_solvers.slow_flow import Initial, Problem, Result

EVERYTHING = frozenset(slow_flow.OUTPUTS)


def solve(system: Any, model: str, variant: str, t: Any, **initial: float) -> Result:
    times = np.atleast_1d(np.asarray(t, dtype=float))
    problem = Problem(system, model, variant, Initial(**initial), times, EVERYTHING)
    return slow_flow.solve(problem, slow_flow.plan(problem))


def finite(result: Result) -> None:
    for name in ("gamma", "omega", "phi", "x", "v", "impulse", "difference_x"):
        value = getattr(result, name)
        if value is not None:
            assert not np.isinf(value).any(), name
    assert result.x is not None
    assert np.isfinite(result.x).all()


def impacts(gamma: float, k: float, count: int, Omega: float = 1.0) -> tuple[list[Any], list[Any]]:
    """Return times and speeds of impacts of one mass between walls, with 40 digits.

    The speed after the impact of gap 1 at gamma is Omega/tan(gamma); the way from wall to wall
    with the speed u takes 2 arctan(Omega/u)/Omega, eq. 10.95 ff.
    """
    speed = Omega / mpmath.tan(mpmath.mpf(gamma))
    t, times, speeds = mpmath.mpf(0), [], []
    for _ in range(count):
        times.append(t)
        speeds.append(speed)
        speed *= mpmath.mpf(k)
        t += 2 * mpmath.atan(Omega / speed) / Omega
    return times, speeds


class TestRestitution:
    """One mass between walls at +-gap with a coefficient of restitution k."""

    @pytest.mark.parametrize("gap", [1e-12, 1.0, 1e12])
    @pytest.mark.parametrize("Omega", [1e-8, 1.0, 1e8])
    @pytest.mark.parametrize("k", [0.5, 0.999999])
    def test_scales(self, gap: float, Omega: float, k: float) -> None:
        system = presets.oscillator([Constraint.at(0, gap, k)], Omega)
        result = solve(system, "restitution", "exact", np.linspace(0.0, 8.0, 21) / Omega, gamma=0.3)
        finite(result)
        assert result.impact_time is not None
        assert result.impact_velocity is not None
        with mpmath.workdps(40):
            steps = np.diff(result.impact_time)
            for i, step in enumerate(steps):
                speed = mpmath.mpf(float(result.impact_velocity[i])) * mpmath.mpf(k)
                exact = 2 * mpmath.atan(mpmath.mpf(gap) * Omega / speed) / Omega
                assert abs(step / exact - 1) < 1e-12 * (1 + float(result.impact_time[i] / exact))
            ratios = result.impact_velocity[1:] / result.impact_velocity[:-1]
            np.testing.assert_allclose(ratios, k, rtol=1e-13)

    @pytest.mark.parametrize("variant", ["exact", "corrected", "second_order", "printed"])
    @pytest.mark.parametrize("k", [1.0 - 1e-15, 1.0 - 1e-9, 0.9])
    def test_almost_no_loss(self, variant: str, k: float) -> None:
        system = presets.oscillator([Constraint.at(0, 1.0, k)], 1.0)
        result = solve(system, "restitution", variant, np.linspace(0.0, 50.0, 51), gamma=0.5)
        finite(result)
        assert result.difference_x is not None
        # The first correction is of the order of the loss; the printed one of another equation.
        if variant != "printed":
            assert np.abs(result.difference_x).max() < 2e-13 + 3.0 * (1.0 - k)

    @pytest.mark.parametrize("below", [1e-3, 1e-9, 1e-15])
    def test_almost_grazing(self, below: float) -> None:
        """The last impact before the end of contact, however near."""
        gamma = 0.5 * np.pi * (1.0 - below)
        system = presets.oscillator([Constraint.at(0, 1.0, 0.9)], 1.0)
        t = np.linspace(0.0, 20.0, 41)
        for variant in ("exact", "corrected", "printed"):
            if below == 1e-3:
                finite(solve(system, "restitution", variant, t, gamma=gamma))
                continue
            with pytest.raises(ModelError, match="grazes"):
                solve(system, "restitution", variant, t, gamma=gamma)

    @pytest.mark.parametrize("gamma", [1e-9, 1e-3])
    def test_very_fast(self, gamma: float) -> None:
        system = presets.oscillator([Constraint.at(0, 1.0, 0.9)], 1.0)
        result = solve(system, "restitution", "exact", np.linspace(0.0, 20 * gamma, 9), gamma=gamma)
        finite(result)
        assert result.impact_time is not None
        assert result.impact_velocity is not None
        with mpmath.workdps(40):
            for before, after in zip(
                result.impact_velocity[:-1], result.impact_velocity[1:], strict=True
            ):
                assert abs(after / before / mpmath.mpf(0.9) - 1) < 1e-14

    def test_both_ends_of_restitution(self) -> None:
        """Without loss all intervals last 2 gamma; without rebound, half a period from the wall."""
        for k, interval in ((0.0, np.pi), (1.0, 1.0)):
            system = presets.oscillator([Constraint.at(0, 1.0, k)], 1.0)
            found = solve(system, "restitution", "exact", [9.0], gamma=0.5).impact_time
            assert found is not None
            assert found.size > 2
            np.testing.assert_allclose(found, 0.5 + interval * np.arange(found.size), rtol=1e-14)
            for variant in ("corrected", "second_order", "printed"):
                with pytest.raises(ModelError, match="between 0 and 1"):
                    solve(system, "restitution", variant, [9.0], gamma=0.5)

    @pytest.mark.parametrize("k", [5e-324, 1e-12, 0.01])
    def test_starts_beyond_a_wall(self, k: float) -> None:
        """Where eq. 10.116 starts, Delta cos(gamma) ln(k) / 4, is no place between the walls."""
        system = presets.oscillator([Constraint.at(0, 1.0, k)], 1.0)
        with pytest.raises(ModelError, match="beyond a wall"):
            solve(system, "restitution", "exact", [5.0], gamma=0.5)


class TestBouncingBall:
    @pytest.mark.parametrize("height", [1e-12, 1.0, 1e12])
    @pytest.mark.parametrize("g", [1e-8, 9.81, 1e8])
    @pytest.mark.parametrize("k", [0.1, 0.9, 0.9999])
    def test_times_of_rest(self, height: float, g: float, k: float) -> None:
        """The sum of all intervals between impacts, sqrt(2H/g) (1 + k)/(1 - k)."""
        system = presets.bouncing_ball([Constraint((0,), (1.0,), 0.0, None, k)], g)
        with mpmath.workdps(40):
            fall = mpmath.sqrt(2 * mpmath.mpf(height) / mpmath.mpf(g))
            exact = fall * (1 + mpmath.mpf(k)) / (1 - mpmath.mpf(k))
            result = solve(system, "bouncing_ball", "exact", [0.0, float(exact) * 0.5], x=height)
            finite(result)
            # Rounding of k by an ulp changes 1 - k.
            room = 1e-14 + 4e-16 / (1.0 - k)
            assert abs(float(result.t_max) / exact - 1) < room


class TestDamped:
    @pytest.mark.parametrize("zeta", [1e-6, 1e-4, 1e-2])
    @pytest.mark.parametrize("variant", ["averaged", "truncated", "leading"])
    def test_little_damping(self, zeta: float, variant: str) -> None:
        system = presets.oscillator([Constraint.at(0, 1.0)], 1.0, zeta)
        result = solve(system, "damped", variant, np.linspace(0.0, 20.0, 41), gamma=0.5)
        finite(result)
        assert result.difference_x is not None
        assert np.abs(result.difference_x).max() < 1e-9 + 200.0 * zeta

    @pytest.mark.parametrize("scale", [1e-8, 1e8])
    def test_time_may_be_scaled(self, scale: float) -> None:
        t = np.linspace(0.0, 20.0, 41)
        one = solve(
            presets.oscillator([Constraint.at(0, 1.0)], 1.0, 0.01),
            "damped",
            "averaged",
            t,
            gamma=0.5,
        )
        other = solve(
            presets.oscillator([Constraint.at(0, 1.0)], scale, 0.01),
            "damped",
            "averaged",
            t / scale,
            gamma=0.5,
        )
        np.testing.assert_allclose(other.x, one.x, rtol=1e-8, atol=1e-8)


class TestRefused:
    @pytest.mark.parametrize("variant", ["exact", "transformed", "averaged"])
    def test_half_a_million_millions_of_impacts(self, variant: str) -> None:
        """As many as almost no damping allows until the last one, whose time is in the answer."""
        system = presets.oscillator([Constraint.at(0, 1.0)], 1.0, 1e-12)
        with pytest.raises(PlanError, match="impacts"):
            solve(system, "damped", variant, [20.0], gamma=0.5)

    def test_impacts_without_number(self) -> None:
        system = presets.oscillator([Constraint.at(0, 1.0, 1.0 - 1e-12)], 1.0)
        with pytest.raises(PlanError, match="ask for less time"):
            solve(system, "restitution", "exact", [1e12], gamma=0.1)

    @pytest.mark.parametrize("gamma", [0.0, -0.5, 0.5 * np.pi, 1e99])
    def test_no_impacts_to_start_from(self, gamma: float) -> None:
        system = presets.oscillator([Constraint.at(0, 1.0, 0.9)], 1.0)
        with pytest.raises(ModelError):
            solve(system, "restitution", "exact", [1.0], gamma=gamma)

    @pytest.mark.parametrize("value", [np.nan, np.inf])
    def test_numbers_that_are_none(self, value: float) -> None:
        system = presets.oscillator([Constraint.at(0, 1.0, 0.9)], 1.0)
        with pytest.raises(ModelError):
            solve(system, "restitution", "exact", [1.0], gamma=value)
        with pytest.raises(ModelError):
            solve(system, "restitution", "exact", [value], gamma=0.5)

    @pytest.mark.parametrize("value", [5e-324, 1e-310, 1e-150, 1e150])
    def test_numbers_that_are_lost(self, value: float) -> None:
        ball = presets.bouncing_ball([Constraint((0,), (1.0,), 0.0, None, 0.5)], 9.81)
        with pytest.raises(ModelError, match="neither zero nor between"):
            solve(ball, "bouncing_ball", "exact", [0.0], x=value)
        system = presets.oscillator([Constraint.at(0, 1.0, 0.9)], 1.0)
        with pytest.raises(ModelError, match="neither zero nor between"):
            solve(system, "restitution", "exact", [1.0], gamma=value)
