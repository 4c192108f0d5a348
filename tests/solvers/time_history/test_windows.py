"""Long motions window by window: one motion, whatever is computed where and when."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from vibroimpact_solvers import presets
from vibroimpact_solvers import time_history as th
from vibroimpact_solvers.errors import Cancelled
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.plan import Plan, Stage
from vibroimpact_solvers.time_history import planning, solving

ALL = frozenset(th.OUTPUTS)
STICKY = System(
    SymmetricMatrix.dense(np.eye(2)),
    SymmetricMatrix.dense(np.array([[2.0, -1.0], [-1.0, 2.0]])),
    (Constraint((0,), (1.0,), None, 0.05, 0.0), Constraint((1,), (1.0,), 0.1, 0.5, 0.6)),
    C=SymmetricMatrix.dense(np.array([[0.2, -0.1], [-0.1, 0.3]])),
)
LOAD = (th.Harmonic(0, 0.6, 0.5), th.Harmonic(1, -0.5, 0.35, 0.4))


def sticky(outputs: frozenset[str] = ALL, **other: object) -> th.Problem:
    given: dict[str, object] = {"t": np.linspace(0.0, 120.0, 301), "load": LOAD} | other
    start = th.State(np.zeros(2), np.array([0.2, 0.0]))
    return th.Problem(STICKY, start, 120.0, outputs=outputs, **given)  # type: ignore[arg-type]


def in_windows(
    monkeypatch: pytest.MonkeyPatch, problem: th.Problem, count: int
) -> tuple[Plan, list[th.Window]]:
    """Return a plan of about that many windows, and these."""
    monkeypatch.setattr(planning, "SECONDS", 1e9)
    monkeypatch.setattr(planning, "BYTES", 1e18)
    whole = th.plan(problem)
    seconds = sum(s.flops / 1e9 + s.bytes / 5e8 for s in whole.steps if s.stage != "spectrum")
    # A rounding more, so that the rounding of the quotient adds no window.
    monkeypatch.setattr(planning, "SECONDS", seconds / count * (1.0 + 1e-12))
    plan = th.plan(problem)
    return plan, th.split(problem, plan, 0.2)


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("count", [2, 7, 60, 400])
def test_windows_are_one_motion(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Contacts last over many windows when these are short, and their table is the same."""
    problem = sticky(ALL | {"a"})
    plan, windows = in_windows(monkeypatch, problem, count)
    assert count <= len(windows) <= count + 1
    step = plan.step(Stage.FREE_MOTION)
    assert step is not None
    assert f"in {len(windows)} windows" in step.reason
    found, whole = th.solve(problem, plan), solving.solve(problem, plan)
    assert whole.contact_rest is not None
    assert whole.contact_rest.size > 10
    for field in fields(th.Result):
        expected, value = getattr(whole, field.name), getattr(found, field.name)
        stated = field.name.startswith("error_") and isinstance(expected, np.ndarray)
        if stated and field.name.startswith("error_impact_"):
            # Where the error says that an impact may be missing, which the rounding decides too.
            known = np.isfinite(value) & np.isfinite(expected)
            assert known.mean() > 0.5
            # A cut within a chatter rounds the state, where hops round their changes only.
            most = 100.0 if count < whole.count_impacts else 200.0
            assert (value[known] < most * expected[known]).all(), field.name
        elif stated and field.name.startswith("error_contact_"):
            sure = np.isfinite(expected)
            assert sure.mean() > 0.5
            assert (value[sure] < 100.0 * expected[sure] + 1e-13).all(), field.name
        elif stated:
            # Of the whole motion it is that at its end.
            assert (value < 100.0 * expected).all(), field.name
        elif field.name in {"impact_condition", "error_condition"}:
            # An estimate: the rounding of a free motion is random, and every cut of one adds to it.
            ratio = np.asarray(value / expected)
            assert (ratio > 0.1).all(), field.name
            assert (ratio < (10.0 if count < whole.count_impacts else 100.0)).all(), field.name
        elif isinstance(expected, np.ndarray):
            np.testing.assert_allclose(value, expected, rtol=1e-11, atol=1e-11, err_msg=field.name)
        elif field.name == "error_penetration":
            assert value < 1e-15
        elif field.name == "count_expansions":
            assert expected <= value <= expected + 3 * len(windows)
        elif isinstance(expected, float):
            assert value == pytest.approx(expected, rel=1e-3), field.name
        else:
            assert value == expected, field.name


@pytest.mark.needs("compiled kernels")
def test_elastic_windows_keep_energy_and_state_its_drift(monkeypatch: pytest.MonkeyPatch) -> None:
    system = presets.chain(9, [Constraint.at(4, 0.2)])
    rng = np.random.default_rng(4)
    state = th.State(rng.uniform(-0.1, 0.1, 9), rng.standard_normal(9))
    t = np.linspace(0.0, 300.0, 1001)
    problem = th.Problem(system, state, 300.0, t=t, outputs=frozenset({"energy", "impacts"}))
    plan, _ = in_windows(monkeypatch, problem, 50)
    result = th.solve(problem, plan)
    assert result.energy is not None
    drift = np.abs(result.energy - result.energy[0]).max() / np.abs(result.energy).max()
    assert result.error_energy_drift == pytest.approx(drift, rel=1e-15)
    assert drift < 1e-13


@pytest.mark.needs("compiled kernels")
def test_the_predictability_of_windows_is_that_of_one_motion(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Deviations go along from window to window: nothing starts anew at their ends."""
    system = presets.chain(12, [Constraint.at(4, 0.2, 0.9), Constraint.at(8, 0.2, 0.9)])
    rng = np.random.default_rng(0)
    state = th.State(0.05 * rng.standard_normal(12), rng.standard_normal(12))
    problem = th.Problem(system, state, 200.0)
    plan, windows = in_windows(monkeypatch, problem, 40)
    assert len(windows) >= 40
    found, whole = th.solve(problem, plan), solving.solve(problem, plan)
    assert whole.error_predictable_until < 190.0
    assert whole.impact_condition is not None
    assert whole.impact_time is not None
    # What is drawn for roundings differs: by less than a factor of ten.
    at = float(np.searchsorted(whole.impact_time, whole.error_predictable_until))
    limit = whole.impact_condition[int(at)]
    bounds = [
        whole.impact_time[np.argmax(whole.impact_condition > factor * limit)]
        for factor in (0.1, 10.0)
    ]
    assert bounds[0] <= found.error_predictable_until <= bounds[1]
    assert bounds[1] < 190.0


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("outputs", [{"impacts"}, {"contacts"}, {"x"}, {"energy"}, ALL])
def test_results_do_not_depend_on_who_computes_the_windows(
    outputs: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = sticky(frozenset(outputs))
    plan, windows = in_windows(monkeypatch, problem, 12)
    parts: list[th.Part] = []
    for window in windows:
        parts.append(th.follow(window, plan, parts[-1] if parts else None))
    again = th.follow(windows[5], plan, parts[4])
    np.testing.assert_array_equal(again.seed_state, parts[5].seed_state)
    joined, whole = th.join(problem, plan, parts), th.solve(problem, plan)
    for field in fields(th.Result):
        expected, value = getattr(whole, field.name), getattr(joined, field.name)
        if isinstance(expected, np.ndarray):
            np.testing.assert_array_equal(value, expected, err_msg=field.name)
        else:
            assert value == expected, field.name


@pytest.mark.needs("compiled kernels")
def test_parts_hold_no_more_than_their_window(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = sticky()
    plan, windows = in_windows(monkeypatch, problem, 10)
    parts: list[th.Part] = []
    for window in windows:
        parts.append(th.follow(window, plan, parts[-1] if parts else None))
    for window, part in zip(windows, parts, strict=True):
        assert part.x is not None
        assert part.impact_time is not None
        assert part.x.shape[0] == window.times.stop - window.times.start
        start = 120.0 * window.index / window.count
        assert (part.impact_time >= start).all()
        assert (part.impact_time <= window.stop).all()
    assert sum(part.count_impacts for part in parts) == sum(
        part.impact_time.size for part in parts if part.impact_time is not None
    )
    assert parts[-1].seed_open.size == 0


def test_short_motions_and_other_methods_are_one_piece() -> None:
    short = sticky()
    assert th.split(short, th.plan(short), 0.2) == [short]
    rk = sticky(method="RK45")
    assert th.split(rk, th.plan(rk), 1e-9) == [rk]


def test_progress_goes_by_time_and_stops_the_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = sticky()
    plan, _ = in_windows(monkeypatch, problem, 20)
    seen: list[int] = []

    def note(done: int, total: int) -> None:
        seen.append(done)
        assert total == 1000
        if done >= 500:
            raise Cancelled

    with pytest.raises(Cancelled):
        th.solve(problem, plan, note)
    assert seen == sorted(seen)
    assert 500 <= seen[-1] <= 600
