"""Bouncing ball: references of the chapter, order in eps, one parabola after the other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from vibroimpact_solvers import presets
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.slow_flow import Initial, Problem, Result

Solved = Callable[..., Result]
Values = Callable[[str], dict[str, Any]]
Order = Callable[[Any, Any], float]

EPS = (0.08, 0.04, 0.02, 0.01, 0.005)


def ball(k: float = 0.9, g: float = 9.81, floor: float = 0.0) -> System:
    return presets.bouncing_ball([Constraint((0,), (1.0,), -floor, None, k)], g)


def numbers(texts: Any) -> np.ndarray:
    return np.array(list(texts), dtype=float)


def test_impacts(solved: Solved, values: Values) -> None:
    entry = values("41")
    result = solved(ball(), "bouncing_ball", "exact", [9.0], x=1.0)
    assert result.impact_time is not None
    for name, t in entry["t_n"].items():
        assert result.impact_time[int(name) - 1] == pytest.approx(float(t), rel=1e-12)
    assert float(result.t_max) == pytest.approx(float(entry["t_max_exact"]), rel=1e-12)
    for variant in ("nstt", "nsct"):
        found = solved(ball(), "bouncing_ball", variant, [1.0], x=1.0)
        assert float(found.t_max) == pytest.approx(float(entry["t_max_10.149"]), rel=1e-12)
        assert float(found.t_max_exact) == float(result.t_max)


@pytest.mark.parametrize(
    ("variant", "key"), [("exact", "exact"), ("nstt", "NSTT"), ("nsct", "NSCT")]
)
def test_heights(solved: Solved, values: Values, variant: str, key: str) -> None:
    entry = values("42")
    result = solved(ball(), "bouncing_ball", variant, numbers(entry), x=1.0)
    assert result.x is not None
    expected = numbers(row[key] for row in entry.values())
    np.testing.assert_allclose(result.x[:, 0], expected, atol=1e-12)


def test_one_parabola_after_the_other(solved: Solved) -> None:
    g, k, start, t = 3.0, 0.7, 0.0, np.linspace(0.0, 8.0, 1601)
    z, v = np.full(t.size, np.nan), np.full(t.size, np.nan)
    height, speed = 2.0, 0.0
    for _ in range(200):
        interval = (speed + np.sqrt(speed**2 + 2 * g * height)) / g
        now = (t >= start) & (t < start + interval)
        later = t[now] - start
        z[now], v[now] = height + speed * later - g * later**2 / 2, speed - g * later
        start, height, speed = start + interval, 0.0, k * (g * interval - speed)
    result = solved(ball(k, g, floor=-1.5), "bouncing_ball", "exact", t, x=0.5)
    assert result.x is not None
    assert result.v is not None
    moving = t < start - 1e-9
    np.testing.assert_allclose(result.x[moving, 0], z[moving] - 1.5, atol=1e-12)
    near = np.abs(result.x[:, 0] + 1.5) < 1e-9  # the side of an impact is a matter of rounding
    np.testing.assert_allclose(result.v[moving & ~near, 0], v[moving & ~near], atol=1e-11)
    rest = t > start + 1e-9
    assert rest.any()
    assert (result.x[rest] == -1.5).all()
    assert (result.v[rest] == 0.0).all()
    assert (result.stage[rest] == 2).all()


def test_phases_at_impacts_are_odd(solved: Solved) -> None:
    result = solved(ball(), "bouncing_ball", "exact", [8.0], x=1.0)
    assert result.impact_time is not None
    at = solved(ball(), "bouncing_ball", "exact", result.impact_time * (1 + 1e-13), x=1.0)
    np.testing.assert_allclose(at.phi, 2.0 * np.arange(1, result.impact_time.size + 1) - 1.0,
                               atol=1e-6)  # fmt: skip


@pytest.mark.parametrize("variant", ["nstt", "nsct"])
def test_first_order(solved: Solved, order: Order, variant: str) -> None:
    """Heights err by eps at fixed times; once eps t is not small the phase lags by a fixed part."""
    fall, heights, phases = np.sqrt(2 / 9.81), [], []
    for eps in EPS:
        t = np.linspace(0.0, 6 * fall, 4001)
        early = solved(ball(1.0 - eps), "bouncing_ball", variant, t, x=1.0)
        late = solved(ball(1.0 - eps), "bouncing_ball", variant, [fall / eps], x=1.0)
        assert early.difference_x is not None
        assert late.difference_phi is not None
        heights.append(np.abs(early.difference_x).max())
        phases.append(np.abs(late.difference_phi).max())
    assert order(EPS, heights) == pytest.approx(1.0, abs=0.1)
    assert order(EPS, phases) == pytest.approx(0.0, abs=0.1)


def test_the_corrected_transformation_is_of_the_second_order(solved: Solved, order: Order) -> None:
    fall, heights = np.sqrt(2 / 9.81), []
    for eps in EPS:
        t = np.linspace(0.0, 1.9 * fall / eps, 20001)
        result = solved(ball(1.0 - eps), "bouncing_ball", "corrected", t, x=1.0)
        assert result.difference_x is not None
        assert result.difference_phi is not None
        heights.append(np.abs(result.difference_x).max())
        assert np.abs(result.difference_phi).max() < 1e-8
        assert float(result.t_max) == float(result.t_max_exact)
    assert order(EPS, heights) == pytest.approx(2.0, abs=0.1)


def test_duration_exceeds_the_exact_one_by_a_fall(solved: Solved) -> None:
    for eps in EPS:
        result = solved(ball(1.0 - eps), "bouncing_ball", "nstt", [1.0], x=1.0)
        assert float(result.t_max - result.t_max_exact) == pytest.approx(
            np.sqrt(2 / 9.81), rel=1e-9
        )


@pytest.mark.parametrize("variant", ["nstt", "nsct", "corrected"])
def test_velocity_is_the_rate_of_the_height(solved: Solved, variant: str) -> None:
    t, h = np.linspace(0.01, 8.0, 300), 1e-6
    before, at, after = (solved(ball(), "bouncing_ball", variant, t + d, x=1.0) for d in (-h, 0, h))
    assert before.x is not None
    assert after.x is not None
    assert at.v is not None
    same_interval = np.floor((before.phi + 1) / 2) == np.floor((after.phi + 1) / 2)
    rate = (after.x - before.x)[same_interval] / (2 * h)
    np.testing.assert_allclose(at.v[same_interval], rate, atol=1e-5)


@pytest.mark.parametrize(
    ("system", "initial", "pointer"),
    [
        (ball(1.0), {"x": 1.0}, ("system", "constraints", 0, "restitution")),
        (ball(), {"x": -1.0}, ("initial", "x")),
        (ball(), {}, ("initial", "x")),
        (presets.oscillator([Constraint.at(0, 1.0, 0.9)], 1.0), {"x": 1.0}, ("system", "K")),
        (
            presets.bouncing_ball([Constraint.at(0, 1.0, 0.9)]), {"x": 0.5},
            ("system", "constraints", 0, "gap"),
        ),
    ],
)  # fmt: skip
def test_refusals(system: System, initial: dict[str, float], pointer: tuple[Any, ...]) -> None:
    with pytest.raises(ModelError) as caught:
        Problem(system, "bouncing_ball", "nstt", Initial(**initial), np.array([1.0]))
    assert caught.value.pointer == pointer
