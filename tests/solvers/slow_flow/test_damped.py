"""Damped oscillator between elastic walls: references, orders, brute force, both stages."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vibroimpact_solvers import presets
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.slow_flow import MODELS, Initial, Problem, Result

Solved = Callable[..., Result]
Values = Callable[[str], dict[str, Any]]
Order = Callable[[Any, Any], float]

ZETA = (0.04, 0.02, 0.01, 0.005, 0.0025)


def damped(zeta: float = 0.01, Omega0: float = 1.0, gap: float = 1.0) -> System:
    return presets.oscillator([Constraint.at(0, gap)], Omega0, zeta)


def numbers(texts: Any) -> np.ndarray:
    return np.array(list(texts), dtype=float)


class TestReferences:
    def test_impacts(self, solved: Solved, values: Values) -> None:
        entry = values("08")
        result = solved(damped(), "damped", "exact", [200.0], gamma=0.2)
        assert result.impact_time is not None
        assert result.impact_velocity is not None
        assert result.impact_time.size == entry["n_impacts"]
        for name, impact in entry["impacts"].items():
            found = result.impact_time[int(name) - 1], result.impact_velocity[int(name) - 1]
            expected = float(impact["t"]), float(impact["speed"])
            assert found == pytest.approx(expected, rel=1e-12)
        assert float(result.t_max) == pytest.approx(float(entry["t_last_impact"]), rel=1e-12)

    def test_motion(self, solved: Solved, values: Values) -> None:
        entry = values("09")
        result = solved(damped(), "damped", "exact", numbers(entry), gamma=0.2)
        assert result.x is not None
        assert result.v is not None
        found = np.stack([result.x[:, 0], result.v[:, 0]], axis=1)
        np.testing.assert_allclose(found, [numbers(row) for row in entry.values()], atol=1e-12)

    def test_averaged(self, solved: Solved, values: Values) -> None:
        entry = values("10")
        result = solved(damped(), "damped", "averaged", numbers(entry["at_t"]), gamma=0.2)
        for name, found in (("gamma", result.gamma), ("phi", result.phi)):
            expected = numbers(row[name] for row in entry["at_t"].values())
            np.testing.assert_allclose(found, expected, rtol=1e-12)
        assert float(result.t_max) == pytest.approx(float(entry["t_end"]), rel=1e-12)

    def test_truncated(self, solved: Solved, values: Values) -> None:
        entry = values("11")
        result = solved(damped(), "damped", "truncated", numbers(entry), gamma=0.2)
        for name, found in (("gamma", result.gamma), ("phi", result.phi)):
            expected = numbers(row[name] for row in entry.values())
            np.testing.assert_allclose(found, expected, rtol=1e-12)

    @pytest.mark.parametrize(
        ("variant", "key"),
        [
            ("leading", "t_max_10.21"),
            ("truncated", "t_10.17_reaches_pi/2"),
            ("averaged", "t_10.16_full"),
            ("exact", "t_exact_last_impact"),
        ],
    )
    def test_durations(self, solved: Solved, values: Values, variant: str, key: str) -> None:
        result = solved(damped(), "damped", variant, [1.0], gamma=0.2)
        assert float(result.t_max) == pytest.approx(float(values("12")[key]), rel=1e-12)


class TestExact:
    def test_brute_force(self, solved: Solved) -> None:
        """Integration with events; other numbers, downwards at first, beyond the last impact."""
        zeta, Omega0, gap, end = 0.05, 1.4, 0.3, 30.0
        system = damped(zeta, Omega0, gap)
        start = {"gamma": 0.4, "phi": 1.7}
        result = solved(system, "damped", "exact", [0.0, end], **start)
        assert result.x is not None
        assert result.v is not None

        def wall(t: float, s: np.ndarray) -> float:
            return float(gap - abs(s[0]))

        wall.terminal, wall.direction = True, -1  # type: ignore[attr-defined]
        now, (x, v), impacts = 0.0, (result.x[0, 0], result.v[0, 0]), []
        while now < end:
            run = solve_ivp(
                lambda t, s: [s[1], -2 * zeta * Omega0 * s[1] - Omega0**2 * s[0]],
                (now, end), [x, v], "DOP853", events=wall, rtol=1e-12, atol=1e-13,
            )  # fmt: skip
            now, (x, v) = float(run.t[-1]), run.y[:, -1]
            if run.status == 1:
                impacts.append(now)
                v = -v
        np.testing.assert_allclose(result.impact_time, impacts, atol=1e-9)
        assert (result.x[1, 0], result.v[1, 0]) == pytest.approx((x, v), abs=1e-9)

    def test_state_is_the_transformation(self, solved: Solved) -> None:
        """Eq. 10.14 holds exactly between the impacts."""
        t = np.linspace(0.0, 90.0, 999)
        result = solved(damped(), "damped", "exact", t, gamma=0.2)
        assert result.phi is not None
        assert result.gamma is not None
        assert result.x is not None
        tau = 2 / np.pi * np.arcsin(np.sin(np.pi * result.phi / 2))
        shape = np.sin(result.gamma * tau) / np.sin(result.gamma)
        np.testing.assert_allclose(result.x[:, 0], shape, atol=1e-11)


class TestVariants:
    def test_transformed_equations_are_exact(self, solved: Solved) -> None:
        t = np.linspace(0.0, 110.0, 1201)
        result = solved(damped(), "damped", "transformed", t, gamma=0.2)
        assert result.difference_x is not None
        assert result.difference_phi is not None
        assert np.abs(result.difference_x).max() < 1e-7
        assert np.nanmax(np.abs(result.difference_phi)) < 1e-7

    @pytest.mark.needs("compiled kernels")
    def test_orders_in_zeta(self, solved: Solved, order: Order) -> None:
        """Averaged, to zeta Omega0 t = 0.6: gamma at impacts 2, phase and displacement 1."""
        found = []
        for zeta in ZETA:
            t = np.linspace(0.0, 0.6 / zeta, 4001)
            result = solved(damped(zeta), "damped", "averaged", t, gamma=0.2)
            errors = (result.difference_gamma, result.difference_phi, result.difference_x)
            found.append([np.abs(error).max() for error in errors])
        for column, expected in zip(np.array(found).T, (2, 1, 1), strict=True):
            assert order(ZETA, column) == pytest.approx(expected, abs=0.1)

    @pytest.mark.needs("compiled kernels")
    @pytest.mark.parametrize(("variant", "expected"), [("truncated", 7), ("leading", 5)])
    def test_orders_in_gamma(
        self, solved: Solved, order: Order, variant: str, expected: int
    ) -> None:
        """What eq. 10.16 loses by expansion: gamma^5 and gamma^7 (not gamma^6)."""
        sizes, found = [0.2, 0.14, 0.1, 0.07, 0.05], []
        for gamma in sizes:
            t = [np.log(2) / 0.02]
            both = [solved(damped(), "damped", v, t, gamma=gamma) for v in (variant, "averaged")]
            found.append(abs(float(both[0].gamma[0] - both[1].gamma[0])))
        assert order(sizes, found) == pytest.approx(expected, abs=0.1)

    def test_phase_of_the_truncated_flow_as_printed(self, solved: Solved) -> None:
        """Eq. 10.18 with its own hypergeometric functions, by mpmath."""
        zeta, gamma0, t = 0.03, 0.35, 20.0
        result = solved(damped(zeta, 1.3), "damped", "truncated", [t / 1.3], gamma=gamma0)
        with mpmath.workdps(30):
            r0 = 4 / (4 + 45 * mpmath.mpf(gamma0) ** -4)
            z = mpmath.mpf(zeta)
            quarter = mpmath.mpf(1) / 4
            r = r0 * mpmath.exp(8 * z * t)
            late = (1 - r) ** (5 * quarter) * mpmath.hyp2f1(1, 1, 3 * quarter, r)
            early = mpmath.hyp2f1(-quarter, -quarter, 3 * quarter, r0)
            phi = (4 / (45 * r0)) ** quarter / (2 * z) * (early - mpmath.exp(-2 * z * t) * late)
        assert result.phi is not None
        assert result.phi[0] == pytest.approx(float(phi), rel=1e-13)

    @pytest.mark.parametrize("variant", MODELS["damped"].VARIANTS)
    def test_both_stages_join(self, solved: Solved, variant: str) -> None:
        """Displacement and velocity are continuous at the end of the impacts and decay after."""
        end = float(solved(damped(), "damped", variant, [1.0], gamma=0.2).t_max)
        h = 1e-11
        t = np.array([end - h, end + h, end + 20.0])
        result = solved(damped(), "damped", variant, t, gamma=0.2)
        assert result.x is not None
        assert result.v is not None
        assert result.phi is not None
        assert result.stage.tolist() == [0, 1, 1]
        assert np.isfinite(result.phi[0])
        assert np.isnan(result.phi[1])
        assert result.x[0, 0] == pytest.approx(result.x[1, 0], abs=1e-6)
        # An impact itself, the end of the exact impacts, turns the velocity.
        speeds = np.abs(result.v[:2, 0]) if variant == "exact" else result.v[:2, 0]
        assert speeds[0] == pytest.approx(speeds[1], abs=1e-4)
        energy = (result.x**2 + result.v**2)[:, 0]
        assert energy[2] / energy[1] == pytest.approx(np.exp(-0.4), rel=0.03)

    def test_impulse_vanishes_with_the_impacts(self, solved: Solved) -> None:
        result = solved(damped(), "damped", "averaged", [10.0, 92.5, 100.0], gamma=0.2)
        assert result.impulse is not None
        assert result.gamma is not None
        gamma = result.gamma[0]
        assert result.impulse[0] == pytest.approx(1 / (gamma * np.tan(gamma)), rel=1e-12)
        assert 0.0 < result.impulse[1] < 0.05
        assert result.impulse[2] == 0.0


@pytest.mark.parametrize(
    ("system", "initial", "pointer"),
    [
        (damped(0.0), {"gamma": 0.2}, ("system", "C")),
        (damped(1.5), {"gamma": 0.2}, ("system", "C")),
        (damped(), {"gamma": 1.6}, ("initial", "gamma")),
        (damped(), {}, ("initial", "gamma")),
        (damped(), {"gamma": 0.2, "omega": 5.0}, ("initial", "omega")),
    ],
)
def test_refusals(system: System, initial: dict[str, float], pointer: tuple[str, str]) -> None:
    with pytest.raises(ModelError) as caught:
        Problem(system, "damped", "averaged", Initial(**initial), np.array([1.0]))
    assert caught.value.pointer == pointer
