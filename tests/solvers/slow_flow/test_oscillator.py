"""Elastic oscillators: admissible solutions and phantoms, and the reflected motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vibroimpact_solvers import presets
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.slow_flow import Initial, Problem, Result

Solved = Callable[..., Result]
Values = Callable[[str], dict[str, Any]]


def between(gap: float = 1.0, Omega0: float = 1.0) -> System:
    return presets.oscillator([Constraint.at(0, gap)], Omega0)


def below(wall: float) -> System:
    return presets.oscillator([Constraint((0,), (1.0,), None, wall)], 1.0)


def test_admissible_solution(solved: Solved, values: Values) -> None:
    entry = values("01")
    t = np.array([float(time) for time in entry["x"]])
    result = solved(between(), "oscillator", "family", t, energy=0.6)
    assert result.gamma is not None
    assert result.omega is not None
    assert result.x is not None
    assert result.gamma[0] == pytest.approx(float(entry["gamma1"]), rel=1e-12)
    assert result.omega[0] == pytest.approx(float(entry["omega"]), rel=1e-12)
    expected = np.array(list(entry["x"].values()), dtype=float)
    np.testing.assert_allclose(result.x[:, 0], expected, rtol=1e-12)
    np.testing.assert_allclose(result.impulse, float(entry["p"]), rtol=1e-12)
    np.testing.assert_allclose(result.difference_x, 0.0, atol=1e-14)
    assert result.exists == np.True_


def test_first_phantom(solved: Solved, values: Values) -> None:
    entry = values("02")
    gamma = float(entry["gamma2"])
    t = np.linspace(0.0, 4.0 * gamma, 2001)
    result = solved(between(), "oscillator", "family", t, energy=0.6, root=1)
    assert result.gamma is not None
    assert result.x is not None
    assert result.gamma[0] == pytest.approx(gamma, rel=1e-12)
    assert np.abs(result.x).max() == pytest.approx(float(entry["max_abs_x_over_Delta"]), rel=1e-5)
    np.testing.assert_allclose(result.impulse, float(entry["p"]), rtol=1e-12)
    assert result.exists == np.False_


@pytest.mark.parametrize(("name", "root"), [("03", 2), ("04", 4)])
def test_higher_phantoms(solved: Solved, values: Values, name: str, root: int) -> None:
    """A positive impulse alone does not make a solution admissible."""
    entry = values(name)
    result = solved(between(), "oscillator", "family", [0.0], energy=0.6, root=root)
    assert result.gamma is not None
    assert result.gamma[0] == pytest.approx(float(entry["gamma"]), rel=1e-12)
    np.testing.assert_allclose(result.impulse, float(entry["p"]), rtol=1e-12)
    assert result.exists == np.False_


@pytest.mark.parametrize(("name", "wall"), [("05", 1.0), ("06", -1.0), ("07", 1.0)])
def test_one_wall(solved: Solved, values: Values, name: str, wall: float) -> None:
    entry = values(name)
    gamma = 2.0 if name == "05" else 1.0
    tau = np.array([float(time) for time in entry["X_at_tau"]])
    t = tau * gamma  # tau = omega t until the first impact
    outputs = frozenset({"state", "x", "impulse"})
    result = solved(below(wall), "oscillator", "family", t, outputs, gamma=gamma)
    assert result.omega is not None
    assert result.x is not None
    assert result.omega[0] == pytest.approx(float(entry["omega"]), rel=1e-12)
    expected = np.array(list(entry["X_at_tau"].values()), dtype=float)
    np.testing.assert_allclose(result.x[:, 0], expected, rtol=1e-12)
    np.testing.assert_allclose(result.impulse, float(entry["p"]), rtol=1e-12)
    assert bool(result.exists) is entry["real_motion"]
    root = {"05": 1, "06": 0, "07": 0}[name]
    by_energy = solved(
        below(wall), "oscillator", "family", t, outputs, energy=float(entry["E"]), root=root
    )
    np.testing.assert_allclose(by_energy.gamma, gamma, rtol=1e-12)


@pytest.mark.parametrize(
    ("system", "walls", "initial"),
    [
        (between(0.4, 1.3), (-0.4, 0.4), {"gamma": 0.9, "phi": -0.6}),
        (between(0.4, 1.3), (-0.4, 0.4), {"gamma": 1.2, "phi": 1.7}),
        (below(0.5), (-np.inf, 0.5), {"gamma": 2.1, "phi": 0.4}),
        (below(-0.5), (-np.inf, -0.5), {"gamma": 1.1, "phi": -0.3}),
    ],
)
def test_solutions_are_the_reflected_motion(
    solved: Solved, system: System, walls: tuple[float, float], initial: dict[str, float]
) -> None:
    end = 6.0
    family = solved(system, "oscillator", "family", [0.0, end], **initial)
    assert family.x is not None
    assert family.v is not None
    np.testing.assert_allclose(family.difference_x, 0.0, atol=1e-13)
    np.testing.assert_allclose(family.difference_phi, 0.0, atol=1e-12)
    stiffness = float(system.K.to_dense()[0, 0])

    def room(t: float, s: np.ndarray) -> float:
        return float(min(walls[1] - s[0], s[0] - walls[0]))

    room.terminal, room.direction = True, -1  # type: ignore[attr-defined]
    start, (x, v) = 0.0, (family.x[0, 0], family.v[0, 0])
    impacts = []
    while start < end:
        run = solve_ivp(
            lambda t, s: [s[1], -stiffness * s[0]],
            (start, end), [x, v], "DOP853", events=room, rtol=1e-12, atol=1e-13,
        )  # fmt: skip
        start, (x, v) = float(run.t[-1]), run.y[:, -1]
        if run.status == 1:
            impacts.append((start, abs(v)))
            v = -v
    assert family.x[1, 0] == pytest.approx(x, abs=1e-9)
    assert family.v[1, 0] == pytest.approx(v, abs=1e-9)
    np.testing.assert_allclose(family.impact_time, [t for t, _ in impacts], atol=1e-9)
    np.testing.assert_allclose(family.impact_velocity, [u for _, u in impacts], atol=1e-9)


def test_the_exact_variant_of_a_phantom_keeps_within_the_walls(solved: Solved) -> None:
    t = np.linspace(0.0, 20.0, 999)
    exact = solved(between(), "oscillator", "exact", t, energy=0.6, root=1)
    assert exact.x is not None
    assert np.abs(exact.x).max() <= 1.0 + 1e-14
    phantom = solved(between(), "oscillator", "family", t, energy=0.6, root=1)
    assert phantom.difference_x is not None
    assert np.abs(phantom.difference_x).max() > 0.09


@pytest.mark.parametrize(
    ("initial", "pointer"),
    [
        ({"energy": 0.4}, ("initial", "energy")),
        ({"gamma": 1.0, "energy": 0.6}, ("initial", "gamma")),
        ({}, ("initial", "energy")),
        ({"gamma": np.pi}, ("initial", "gamma")),
    ],
)
def test_refusals(initial: dict[str, float], pointer: tuple[str, str]) -> None:
    with pytest.raises(ModelError) as caught:
        Problem(between(), "oscillator", "family", Initial(**initial), np.array([1.0]))
    assert caught.value.pointer == pointer


def test_a_phantom_that_starts_beyond_a_wall_has_no_exact_motion() -> None:
    start = Initial(energy=0.6, root=1, phi=0.9)
    with pytest.raises(ModelError):
        Problem(between(), "oscillator", "exact", start, np.array([1.0]))
