"""Histories against exact motions of the book chapter, recomputed in extended precision."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import mpmath as mp
import numpy as np
import pytest

from vibroimpact_solvers import presets
from vibroimpact_solvers import time_history as th
from vibroimpact_solvers.model import Constraint, System

Reference = Callable[[str, str], dict[str, Any]]
FILE = "time_history"
SIZE = 5.0  # of the states, by their velocity


def solve(
    system: System, x: list[float], v: list[float], t_end: float, t: Any = (0.0,)
) -> th.Result:
    problem = th.Problem(
        system,
        th.State(np.array(x), np.array(v)),
        t_end,
        t=np.array(t, dtype=float),
        outputs=frozenset(th.OUTPUTS),
    )
    return th.solve(problem, th.plan(problem))


def check_impacts(
    result: th.Result, impacts: Mapping[str, Mapping[str, str]], speed: str, relative: float
) -> None:
    assert result.impact_time is not None
    assert result.impact_velocity is not None
    for number, values in impacts.items():
        index = int(number) - 1
        np.testing.assert_allclose(result.impact_time[index], float(values["t"]), rtol=relative)
        found = abs(result.impact_velocity[index])
        np.testing.assert_allclose(found, float(values[speed]), rtol=relative)


def check_states(result: th.Result, states: Mapping[str, list[str]]) -> None:
    """Compare states; they can be known to the growth of rounding and no better."""
    absolute = 4.0 * SIZE * 2.0**-52 * result.error_condition
    assert result.x is not None
    assert result.v is not None
    for index, values in enumerate(states.values()):
        found = np.stack([result.x[index], result.v[index]], axis=1).ravel()
        expected = np.array(values, dtype=float)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=absolute)


def test_damped_oscillator_to_its_last_impact(reference: Reference) -> None:
    """The last impact is nearly a grazing: 0.138 of speed, the next extremum at 0.978."""
    impacts, states = reference(FILE, "08")["values"], reference(FILE, "09")["values"]
    system = presets.oscillator([Constraint.at(0, 1.0)], 1.0, 0.01)
    result = solve(system, [0.0], [float(1 / mp.sin("0.2"))], 120.0, [float(t) for t in states])
    assert result.count_impacts == impacts["n_impacts"]
    check_impacts(result, impacts["impacts"], "speed", 2e-12)
    check_states(result, states)


def test_coupled_damping(reference: Reference) -> None:
    values = reference(FILE, "22")["values"]
    system = presets.two_mass([Constraint.at(0, 1.0)], 1.0, 0.05, 0.01)
    speed = float(1 / mp.sin("0.2"))
    states = values["state"]
    result = solve(system, [0.0, 0.0], [speed, -0.003], 95.0, [float(t) for t in states])
    assert result.count_impacts == values["n_impacts"]
    assert result.impact_time is not None
    for number, time in values["impact_t"].items():
        np.testing.assert_allclose(result.impact_time[int(number) - 1], float(time), rtol=5e-12)
    check_states(result, states)


@pytest.mark.needs("compiled kernels")
def test_restitution_for_a_thousand_units_of_time(reference: Reference) -> None:
    impacts, states = reference(FILE, "36")["values"], reference(FILE, "37")["values"]
    system = presets.oscillator([Constraint.at(0, 1.0, 0.95)], 1.0)
    x = float(mp.mpf("-0.01241504694424810561069968906903897"))
    v = float(mp.mpf("5.0334895476723442024260963675258527"))
    result = solve(system, [x], [v], 1000.0, [float(t) for t in states])
    assert result.impact_time is not None
    for limit in (15, 100, 1000):
        assert (result.impact_time < limit).sum() == impacts[f"count_t<{limit}"]
    early = {n: e for n, e in impacts["impacts"].items() if float(e["t"]) < 1000.0}
    check_impacts(result, {n: e for n, e in early.items() if int(n) < 150}, "u_before", 1e-11)
    check_states(result, states)


def test_bouncing_ball_comes_to_rest(reference: Reference) -> None:
    values, places = reference(FILE, "41")["values"], reference(FILE, "42")["values"]
    floor = Constraint((0,), (1.0,), 0.0, None, 0.9)
    times = [float(t) for t in places]
    result = solve(presets.bouncing_ball([floor]), [1.0], [0.0], 20.0, [*times, 9.0, 20.0])
    assert result.impact_time is not None
    assert result.contact_rest is not None
    assert result.contact_stop is not None
    assert result.x is not None
    assert result.v is not None
    for number in ("1", "2", "5", "10", "50"):
        found = result.impact_time[int(number) - 1]
        np.testing.assert_allclose(found, float(values["t_n"][number]), rtol=1e-15)
    np.testing.assert_allclose(result.contact_rest, [float(values["t_max_exact"])], rtol=1e-15)
    assert result.contact_stop.tolist() == [20.0]
    expected = [float(entry["exact"]) for entry in places.values()]
    np.testing.assert_allclose(result.x[:-2, 0], expected, rtol=0.0, atol=1e-14)
    assert result.x[-2:].tolist() == [[0.0], [0.0]]
    assert result.v[-2:].tolist() == [[0.0], [0.0]]
