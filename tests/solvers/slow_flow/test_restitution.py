"""Oscillator between lossy walls: references of the chapter, orders, brute force."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vibroimpact_solvers import presets
from vibroimpact_solvers.errors import ModelError, PlanError
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.slow_flow import Initial, Problem, Result

Solved = Callable[..., Result]
Values = Callable[[str], dict[str, Any]]
Order = Callable[[Any, Any], float]

# The start of Fig. 10.19: eq. 10.116 as printed, at t = 0.
FIG = {"x": -0.01241504694424810561069968906903897, "v": 5.0334895476723442024260963675258527}
EPS = (0.16, 0.08, 0.04, 0.02, 0.01)
SMALL = (0.02, 0.01, 0.005, 0.0025)


def lossy(k: float = 0.95, Omega: float = 1.0, gap: float = 1.0) -> System:
    return presets.oscillator([Constraint.at(0, gap, k)], Omega)


def free(k: float) -> System:
    one, zero = SymmetricMatrix.diagonal([1.0]), SymmetricMatrix.diagonal([0.0])
    return System(one, zero, (Constraint.at(0, 1.0, k),))


def numbers(texts: Any) -> np.ndarray:
    return np.array(list(texts), dtype=float)


class TestExact:
    def test_impacts(self, solved: Solved, values: Values) -> None:
        entry = values("36")
        result = solved(lossy(), "restitution", "exact", [2100.0], **FIG)
        assert result.impact_time is not None
        assert result.impact_velocity is not None
        for name, impact in entry["impacts"].items():
            index = int(name) - 1
            assert result.impact_time[index] == pytest.approx(float(impact["t"]), rel=1e-12)
            assert result.impact_velocity[index] == pytest.approx(
                float(impact["u_before"]), rel=1e-12
            )
        for until, count in ((15, 21), (100, 63), (1000, 352)):
            assert (result.impact_time < until).sum() == count

    def test_motion(self, solved: Solved, values: Values) -> None:
        entry = values("37")
        result = solved(lossy(), "restitution", "exact", numbers(entry), **FIG)
        assert result.x is not None
        assert result.v is not None
        for row, expected in enumerate(entry.values()):
            assert result.x[row, 0] == pytest.approx(float(expected[0]), abs=1e-12)
            assert result.v[row, 0] == pytest.approx(float(expected[1]), abs=1e-12)

    def test_brute_force(self, solved: Solved) -> None:
        """Integration with events, downwards at first, other numbers, over impacts."""
        Omega, gap, k = 1.7, 0.3, 0.8
        x, v, start = 0.1, -2.0, 0.0

        def wall(t: float, s: np.ndarray) -> float:
            return gap - abs(s[0])

        wall.terminal, wall.direction = True, -1  # type: ignore[attr-defined]
        impacts = []
        while start < 4.0:
            run = solve_ivp(
                lambda t, s: [s[1], -(Omega**2) * s[0]],
                (start, 4.0), [x, v], "DOP853", events=wall, rtol=1e-12, atol=1e-13,
            )  # fmt: skip
            start, (x, v) = float(run.t[-1]), run.y[:, -1]
            if run.status == 1:
                impacts.append(start)
                v = -k * v
        result = solved(
            lossy(k, Omega, gap), "restitution", "exact", [4.0], x=0.1, v=-2.0
        )  # fmt: skip
        assert result.impact_time is not None
        assert result.x is not None
        np.testing.assert_allclose(result.impact_time, impacts, atol=1e-9)
        assert result.x[0, 0] == pytest.approx(x, abs=1e-9)

    def test_elastic_and_perfectly_plastic_walls(self, solved: Solved) -> None:
        t = np.linspace(0.0, 20.0, 50)
        elastic = solved(lossy(1.0), "restitution", "exact", t, x=0.0, v=2.0)
        assert elastic.x is not None
        assert elastic.v is not None
        np.testing.assert_allclose(elastic.x**2 + elastic.v**2, 4.0, rtol=1e-12)
        plastic = solved(lossy(0.0), "restitution", "exact", t, x=0.0, v=2.0)
        assert plastic.x is not None
        after = t > np.pi / 6
        expected = np.cos(t[after] - np.pi / 6)
        np.testing.assert_allclose(plastic.x[after, 0], expected, atol=1e-12)

    def test_state_describes_the_motion(self, solved: Solved) -> None:
        """X = Delta sin(gamma tau)/sin(gamma) with the gamma of each interval is exact."""
        t = np.linspace(0.0, 30.0, 400)
        result = solved(lossy(), "restitution", "exact", t, **FIG)
        assert result.phi is not None
        assert result.gamma is not None
        assert result.x is not None
        tau = 2 / np.pi * np.arcsin(np.sin(np.pi * result.phi / 2))
        shape = np.sin(result.gamma * tau) / np.sin(result.gamma)
        np.testing.assert_allclose(result.x[:, 0], shape, atol=1e-12)


class TestSlowFlow:
    @pytest.mark.parametrize(
        ("variant", "key"), [("corrected", "corrected_kappa"), ("printed", "book_10.114")]
    )
    def test_reference(self, solved: Solved, values: Values, variant: str, key: str) -> None:
        entry = values("38")
        result = solved(lossy(), "restitution", variant, numbers(entry), omega=5.0)
        for name, found in (("lambda", result.gamma), ("phi", result.phi)):
            expected = numbers(row[key][name] for row in entry.values())
            np.testing.assert_allclose(found, expected, rtol=1e-12)

    def test_period_and_impulse(self, solved: Solved, values: Values) -> None:
        entry = values("39")
        rows = {float(t): row for t, row in entry.items() if t != "T_nat"}
        result = solved(lossy(), "restitution", "corrected", list(rows), omega=5.0)
        assert result.omega is not None
        period = numbers(row["T_imp"] for row in rows.values())
        np.testing.assert_allclose(4.0 / result.omega, period, rtol=1e-12)
        p = numbers(row["p0"] for row in rows.values())
        np.testing.assert_allclose(result.impulse, p, rtol=1e-12)

    def test_figure_10_19(self, solved: Solved) -> None:
        t = np.linspace(0.0, 100.0, 2001)
        errors = {}
        for variant in ("corrected", "second_order", "printed"):
            result = solved(lossy(), "restitution", variant, t, **FIG)
            assert result.difference_gamma is not None
            assert result.difference_phi is not None
            assert result.difference_gamma.size == 63
            errors[variant] = (
                np.abs(result.difference_gamma).max(),
                np.abs(result.difference_phi).max(),
            )
        assert errors["corrected"][0] <= 1e-4
        assert errors["corrected"][1] <= 0.02
        assert errors["second_order"][0] <= 1e-8
        assert errors["second_order"][1] <= 1e-6
        assert errors["printed"] == (pytest.approx(7.5e-2, rel=0.02), pytest.approx(3.2, rel=0.02))

    @pytest.mark.needs("compiled kernels")
    @pytest.mark.parametrize(
        ("variant", "gamma", "phi", "x"), [("corrected", 2, 1, 1), ("second_order", 4, 3, 2)]
    )
    def test_orders(
        self, solved: Solved, order: Order, variant: str, gamma: int, phi: int, x: int
    ) -> None:
        """Orders in kappa, uniformly to kappa Omega t = 4 and beyond."""
        sizes, found = [-np.log1p(-eps) for eps in EPS], []
        for eps, kappa in zip(EPS, sizes, strict=True):
            t = np.linspace(0.0, 4.0 / kappa, 4001)
            result = solved(lossy(1.0 - eps), "restitution", variant, t, x=0.0, v=5.0)
            assert result.difference_gamma is not None
            assert result.difference_phi is not None
            assert result.difference_x is not None
            worst = [np.abs(e).max() for e in (result.difference_gamma, result.difference_phi)]
            found.append([*worst, np.abs(result.difference_x).max()])
        for column, expected in zip(np.array(found).T, (gamma, phi, x), strict=True):
            assert order(sizes, column) == pytest.approx(expected, abs=0.1)

    def test_printed_flow_is_not_asymptotic(self, solved: Solved, order: Order) -> None:
        """The error of lambda of eq. 10.114 does not vanish with eps at eps Omega t = 4."""
        found = []
        for eps in SMALL:
            result = solved(
                lossy(1.0 - eps), "restitution", "printed", [4.0 / eps], x=0.0, v=5.0
            )  # fmt: skip
            assert result.difference_gamma is not None
            found.append(abs(result.difference_gamma[-1]))
        assert order(SMALL, found) == pytest.approx(0.0, abs=0.1)

    def test_velocity_is_the_rate_of_the_displacement(self, solved: Solved, order: Order) -> None:
        """V = dx/dt to the first order in kappa, between the impacts."""
        worst = []
        for eps in SMALL:
            t = np.linspace(0.0, 4.0, 401)
            h = 1e-5
            both = np.stack([t, t + h, t + 2 * h])
            result = solved(lossy(1.0 - eps), "restitution", "corrected", both.ravel(), omega=3.0)
            assert result.x is not None
            assert result.v is not None
            assert result.phi is not None
            x, v = result.x.reshape(3, -1), result.v.reshape(3, -1)
            phi = result.phi.reshape(3, -1)
            same_interval = np.floor((phi[2] + 1) / 2) == np.floor((phi[0] + 1) / 2)
            rate = (x[2] - x[0]) / (2 * h)
            worst.append(np.abs(rate - v[1])[same_interval].max())
        assert order(SMALL, worst) == pytest.approx(2.0, abs=0.1)

    def test_shape_solves_its_boundary_value_problem(self) -> None:
        """Y1'' + lambda^2 Y1 = -(X0' omega' + 2 omega X0'_eta)/(eps omega^2), with mpmath."""
        with mpmath.workdps(30):
            lam, tau = mpmath.mpf("0.7"), mpmath.mpf("0.3")
            rate = mpmath.sin(2 * lam) / (4 * lam)  # dlambda/deta, Omega = Delta = 1

            def shape(s: Any) -> Any:
                bow = (1 + s**2) / 2 * mpmath.cos(lam * s)
                return mpmath.cos(lam) / 2 * (mpmath.cot(lam) * s * mpmath.sin(lam * s) - bow)

            def slope(ratio: Any) -> Any:
                return ratio * mpmath.cos(ratio * tau) / mpmath.sin(ratio)

            left = mpmath.diff(shape, tau, 2) + lam**2 * shape(tau)
            # omega = 1/lambda, omega' = -lambda'/lambda^2
            right = rate * slope(lam) - 2 * lam * rate * mpmath.diff(slope, lam)
            assert abs(left - right) < 1e-12
            assert abs(shape(1)) < 1e-25
            drop = lam * mpmath.cot(lam) / 2
            # Y1' = X0'/2 at the wall, less the slow rate of the wall's own place, which is 0.
            assert abs(mpmath.diff(shape, 1) - drop) < 1e-12

    def test_mirrored_start(self, solved: Solved) -> None:
        t = np.linspace(0.0, 10.0, 101)
        up = solved(lossy(), "restitution", "corrected", t, x=0.1, v=3.0)
        down = solved(lossy(), "restitution", "corrected", t, x=-0.1, v=-3.0)
        assert up.x is not None
        assert up.v is not None
        assert up.phi is not None
        np.testing.assert_array_equal(down.x, -up.x)
        np.testing.assert_array_equal(down.v, -up.v)
        np.testing.assert_array_equal(down.phi, up.phi + 2.0)
        np.testing.assert_allclose(down.difference_phi, up.difference_phi, atol=1e-13)


class TestLimits:
    def test_free_particle(self, solved: Solved, values: Values) -> None:
        """Without a spring; entry 40 starts at x = -eps/4 with speed 5."""
        entry = values("40")
        t = numbers(row["t"] for row in entry.values())
        for variant, key in (("high_energy_printed", "phi_10.118"), ("high_energy", "phi_kappa")):
            result = solved(free(0.95), "restitution", variant, t, omega=5.0)
            expected = numbers(row[key] for row in entry.values())
            np.testing.assert_allclose(result.phi, expected, rtol=1e-12)
        exact = solved(free(0.95), "restitution", "exact", [t.max() + 1e-9], x=-0.0125, v=5.0)
        assert exact.impact_time is not None
        found = [exact.impact_time[int(n) - 1] for n in entry]
        np.testing.assert_allclose(found, t, rtol=1e-12)

    def test_high_energy_limit(self, solved: Solved, order: Order) -> None:
        """The corrected flow approaches eq. 10.117-10.118 as lambda^2."""
        ratios, found = [0.08, 0.04, 0.02, 0.01], []
        for lam in ratios:
            t = np.array([8.0 * lam])
            both = [
                solved(lossy(), "restitution", variant, t, omega=1.0 / lam).phi
                for variant in ("corrected", "high_energy")
            ]
            assert both[0] is not None
            assert both[1] is not None
            found.append(abs(both[0][0] - both[1][0]))
        assert order(ratios, found) == pytest.approx(2.0, abs=0.1)

    def test_grazing_is_exponential(self, solved: Solved) -> None:
        """Rho decays by exp(-kappa/2 (phi2 - phi1)); the printed law is algebraic."""
        t = np.array([0.0, 100.0, 200.0])
        kappa = -np.log(0.95)
        flows = {
            variant: solved(lossy(), "restitution", variant, t, gamma=np.pi / 2 - 1e-3)
            for variant in ("exact", "corrected", "grazing", "grazing_printed")
        }
        rho = {variant: np.pi / 2 - flow.gamma for variant, flow in flows.items()}
        np.testing.assert_allclose(rho["grazing"], 1e-3 * np.exp(-kappa * t / np.pi), rtol=1e-9)
        np.testing.assert_allclose(rho["grazing"], rho["corrected"], rtol=2e-3)
        assert rho["grazing_printed"][2] > 0.98e-3
        assert flows["grazing"].difference_x is not None
        assert flows["grazing_printed"].difference_x is not None
        assert np.abs(flows["grazing"].difference_x).max() < 1e-3

    def test_grazing_lag_is_bounded(self, solved: Solved) -> None:
        """(pi/2) phi - Omega t tends to 2 rho0/kappa (eq. 10.123 as corrected)."""
        rho0, kappa = 1e-4, -np.log(0.95)
        t = np.array([0.0, 2000.0])
        exact = solved(lossy(), "restitution", "exact", t, gamma=np.pi / 2 - rho0)
        assert exact.phi is not None
        lag = np.diff(np.pi / 2 * exact.phi - t)[0]
        assert lag == pytest.approx(2 * rho0 / kappa, rel=0.02)
        grazing = solved(lossy(), "restitution", "grazing", t, gamma=np.pi / 2 - rho0)
        assert grazing.phi is not None
        assert np.diff(np.pi / 2 * grazing.phi - t)[0] == pytest.approx(lag, rel=0.02)


class TestRefusals:
    @pytest.mark.parametrize(
        ("system", "variant", "initial", "pointer"),
        [
            (lossy(1.0), "corrected", {"omega": 5.0}, ("system", "constraints", 0, "restitution")),
            (free(0.9), "corrected", {"omega": 5.0}, ("system", "K")),
            (lossy(), "corrected", {}, ("initial", "omega")),
            (lossy(), "corrected", {"omega": 0.5}, ("initial", "omega")),
            (lossy(), "corrected", {"gamma": 1.6}, ("initial", "gamma")),
            (lossy(), "corrected", {"x": 0.0}, ("initial", "v")),
            (lossy(), "corrected", {"x": 1.5, "v": 9.0}, ("initial", "x")),
            (lossy(), "corrected", {"x": 0.0, "v": 0.9}, ("initial", "v")),
            (lossy(), "corrected", {"x": 0.0, "v": 9.0, "omega": 2.0}, ("initial", "x")),
            (lossy(), "corrected", {"A": 1.0}, ("initial", "A")),
            (lossy(), "averaged", {"omega": 5.0}, ("variant",)),
            (presets.chain(2, [Constraint.at(0, 1.0, 0.9)]), "exact", {}, ("system",)),
            (presets.oscillator([], 1.0), "exact", {"omega": 5.0}, ("system", "constraints")),
            (
                presets.oscillator([Constraint.at(0, 1.0, 0.9)], 1.0, 0.1), "exact",
                {"omega": 5.0}, ("system", "C"),
            ),
            (
                presets.oscillator([Constraint((0,), (1.0,), None, 1.0, 0.9)], 1.0), "exact",
                {"omega": 5.0}, ("system", "constraints", 0, "gap"),
            ),
        ],
    )  # fmt: skip
    def test_the_field_is_named(
        self,
        system: System,
        variant: str,
        initial: dict[str, float],
        pointer: tuple[Any, ...],
    ) -> None:
        with pytest.raises(ModelError) as caught:
            Problem(system, "restitution", variant, Initial(**initial), np.array([1.0]))
        assert caught.value.pointer == pointer

    def test_too_many_impacts(self, solved: Solved) -> None:
        for until, words in ((1e9, r"about \S+ impacts are more"), (1e308, "beyond number")):
            with pytest.raises(PlanError, match=words) as refused:
                solved(lossy(0.999999), "restitution", "corrected", [until], omega=5.0)
            assert refused.value.pointer == ("t",)
