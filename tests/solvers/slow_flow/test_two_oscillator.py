"""Damped oscillator between walls coupled to a free one: references, brute force, both stages."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vibroimpact_solvers import presets
from vibroimpact_solvers.errors import ModelError, PlanError
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.slow_flow import Initial, Problem, Result
from vibroimpact_solvers.slow_flow.coupled_rates import Coupled

Solved = Callable[..., Result]
Values = Callable[[str], dict[str, Any]]

FIG = {"gamma": 0.2, "A": -0.003, "B": 0.0}


def coupled(beta: float = 0.05, zeta: float = 0.01, Omega0: float = 1.0, gap: float = 1.0
            ) -> System:  # fmt: skip
    return presets.two_mass([Constraint.at(0, gap)], Omega0, beta / Omega0**2, zeta)


def numbers(texts: Any) -> np.ndarray:
    return np.array(list(texts), dtype=float)


class TestExact:
    def test_states(self, solved: Solved, values: Values) -> None:
        entry = values("22")["state"]
        result = solved(coupled(), "two_oscillator", "exact", numbers(entry), **FIG)
        assert result.x is not None
        assert result.v is not None
        found = np.stack([result.x, result.v], axis=2).reshape(-1, 4)
        np.testing.assert_allclose(found, [numbers(row) for row in entry.values()], atol=1e-11)

    def test_impacts(self, solved: Solved, values: Values) -> None:
        entry = values("22")
        result = solved(coupled(), "two_oscillator", "exact", [300.0], **FIG)
        assert result.impact_time is not None
        assert result.impact_time.size == entry["n_impacts"]
        for name, t in entry["impact_t"].items():
            assert result.impact_time[int(name) - 1] == pytest.approx(float(t), abs=1e-11)

    def test_brute_force_where_the_second_mass_takes_and_gives(self, solved: Solved) -> None:
        """Strong coupling: energy comes back, impacts pause, some turn before the wall."""
        beta, zeta, Omega0, gap, end = 0.4, 0.01, 1.3, 0.5, 40.0
        start = {"gamma": 0.9, "phi": 0.3, "A": 0.3, "B": -0.2}
        result = solved(
            coupled(beta, zeta, Omega0, gap), "two_oscillator", "exact", [0.0, end], **start
        )
        assert result.x is not None
        assert result.v is not None

        def wall(t: float, s: np.ndarray) -> float:
            return float(gap - abs(s[0]))

        def right(t: float, s: np.ndarray) -> list[float]:
            pull = beta * (s[0] - s[1])
            drag = 2 * zeta * Omega0 * s[2]
            return [s[2], s[3], -(Omega0**2) * s[0] - drag - pull, -(Omega0**2) * s[1] + pull]

        wall.terminal, wall.direction = True, -1  # type: ignore[attr-defined]
        now, impacts = 0.0, []
        y = np.concatenate([result.x[0], result.v[0]])
        while now < end:
            run = solve_ivp(
                right, (now, end), y, "DOP853", events=wall, rtol=1e-12, atol=1e-13, max_step=0.05
            )
            now, y = float(run.t[-1]), run.y[:, -1]
            if run.status == 1:
                impacts.append(now)
                y[2] = -y[2]
        np.testing.assert_allclose(result.impact_time, impacts, atol=1e-8)
        np.testing.assert_allclose(np.concatenate([result.x[1], result.v[1]]), y, atol=1e-8)


class TestSlowFlows:
    @pytest.mark.parametrize(
        ("variant", "key"), [("averaged", "averaged_10.44"), ("truncated", "truncated_10.46")]
    )
    def test_reference(self, solved: Solved, values: Values, variant: str, key: str) -> None:
        entry = values("23")[key]
        result = solved(coupled(), "two_oscillator", variant, numbers(entry), **FIG)
        expected = np.array([numbers(row) for row in entry.values()])
        for column, found in enumerate((result.gamma, result.phi, result.A, result.B)):
            np.testing.assert_allclose(found, expected[:, column], rtol=1e-8, atol=1e-10)

    @pytest.mark.needs("compiled kernels")
    def test_transformed_equations_are_exact(self, solved: Solved) -> None:
        t = np.linspace(0.0, 88.0, 881)
        result = solved(coupled(), "two_oscillator", "transformed", t, **FIG)
        exact = solved(coupled(), "two_oscillator", "exact", t, **FIG)
        assert result.difference_x is not None
        assert np.abs(result.difference_x).max() < 1e-9
        for name in ("gamma", "phi", "A", "B"):
            np.testing.assert_allclose(getattr(result, name), getattr(exact, name), atol=1e-8)

    @pytest.mark.needs("compiled kernels")
    @pytest.mark.parametrize("variant", ["transformed", "averaged", "truncated"])
    def test_both_stages_join(self, solved: Solved, variant: str) -> None:
        end = float(solved(coupled(), "two_oscillator", variant, [1.0], **FIG).t_max)
        t = np.array([end - 1e-10, end + 1e-10, end + 30.0])
        result = solved(coupled(), "two_oscillator", variant, t, **FIG)
        assert result.x is not None
        assert result.v is not None
        assert result.stage.tolist() == [0, 1, 1]
        np.testing.assert_allclose(result.x[0], result.x[1], atol=1e-4)
        np.testing.assert_allclose(result.v[0], result.v[1], atol=1e-4)
        assert (result.x[2] ** 2 + result.v[2] ** 2).sum() < 1.0

    @pytest.mark.needs("compiled kernels")
    def test_forced_response_is_overestimated_far_from_resonance(self, solved: Solved) -> None:
        """A and B are slow only near Omega = Omega0: x2 is too large by (Omega0+Omega)/(2 Omega0).

        With A at the averaged equilibrium, Omega = pi Omega0/(2 gamma) gives 4.43 at gamma = 0.2.
        """
        averaged = Coupled(1.0, 1e-3, 0.05, 1.0).averaged(0.0, 1.0, np.array([0.2, 0, 0, 0]))
        slow = (1.0 + 0.025) * np.cos(0.2) - 0.5 * np.pi * averaged[1]
        A = -averaged[3] / slow
        t = np.linspace(0.0, 0.8, 4001)
        system = coupled(zeta=1e-3)
        # The exact forced response: start both on the impact mode of the undamped structure.
        Omega = np.pi / 0.4
        forced = 8 / np.pi**2 * 0.05 / (1.05 - Omega**2)  # first harmonic of a triangle
        result = solved(system, "two_oscillator", "averaged", t, gamma=0.2, A=A)
        assert result.x is not None
        ratio = np.abs(result.x[:, 1]).max() / abs(forced)
        assert ratio == pytest.approx((1 + Omega) / 2, rel=0.02)

    @pytest.mark.needs("compiled kernels")
    def test_soft_walls_have_the_rigid_period_at_first(self, solved: Solved) -> None:
        system = coupled(beta=1e-6, zeta=1e-4)
        t = np.array([0.0, 0.8, 1.6])
        result = solved(system, "two_oscillator", "soft_wall", t, gamma=0.2)
        assert result.x is not None
        np.testing.assert_allclose(result.x[:, 0], 0.0, atol=2e-3)
        assert result.phi is None
        assert result.difference_phi is None


def test_an_endless_integration_is_refused(solved: Solved) -> None:
    with pytest.raises(PlanError, match="too long"):
        solved(coupled(zeta=1e-6), "two_oscillator", "averaged", [1.0], **FIG)


@pytest.mark.parametrize(
    ("system", "initial", "pointer"),
    [
        (coupled(zeta=0.0), FIG, ("system", "C")),
        (coupled(), {"gamma": 1.6}, ("initial", "gamma")),
        (coupled(), {"A": 0.0}, ("initial", "gamma")),
        (presets.oscillator([Constraint.at(0, 1.0)], 1.0), FIG, ("system",)),
        (
            System(
                SymmetricMatrix.diagonal([1.0, 2.0]), SymmetricMatrix.diagonal([1.0, 1.0]),
                (Constraint.at(0, 1.0),),
            ), FIG, ("system", "M"),
        ),
        (
            System(
                SymmetricMatrix.diagonal([1.0, 1.0]), SymmetricMatrix.diagonal([1.0, 2.0]),
                (Constraint.at(0, 1.0),),
            ), FIG, ("system", "K"),
        ),
        (
            presets.two_mass([Constraint.at(1, 1.0)], 1.0, 0.05, 0.01), FIG,
            ("system", "constraints", 0),
        ),
    ],
)  # fmt: skip
def test_refusals(system: System, initial: dict[str, float], pointer: tuple[Any, ...]) -> None:
    with pytest.raises(ModelError) as caught:
        Problem(system, "two_oscillator", "averaged", Initial(**initial), np.array([1.0]))
    assert caught.value.pointer == pointer
