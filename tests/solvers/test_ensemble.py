"""Ensembles: every member is the motion it would be alone; wrong ones do not affect the others."""

from __future__ import annotations

import threading
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from vibroimpact_solvers import ensemble, presets, time_history
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import Cancelled, ModelError, PlanError
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.plan import Stage
from vibroimpact_solvers.time_history import rigid_motions

ALL = frozenset(time_history.OUTPUTS)
OSCILLATOR = presets.oscillator([Constraint.at(0, 1.0, 0.9)], 1.0)
CHAIN = presets.chain(5, [Constraint.at(2, 0.2, 0.6), Constraint((4,), (1.0,), None, 0.1, 0.0)])


def states(system: System, count: int, seed: int = 1) -> tuple[Floats, Floats]:
    rng = np.random.default_rng(seed)
    x = rng.uniform(-0.05, 0.05, (count, system.n))
    return x, rng.standard_normal((count, system.n))


def problem(system: System, x: Floats, v: Floats, **other: object) -> ensemble.Problem:
    given: dict[str, object] = {"t_end": 12.0, "t": np.linspace(0.0, 12.0, 5), "outputs": ALL}
    return ensemble.Problem(system, x, v, **given | other)  # type: ignore[arg-type]


def solved(asked: ensemble.Problem) -> ensemble.Result:
    return ensemble.solve(asked, ensemble.plan(asked))


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("system", [OSCILLATOR, CHAIN], ids=["oscillator", "chain"])
def test_members_are_what_they_would_be_alone(system: System) -> None:
    x, v = states(system, 150)
    asked = problem(system, x, v, dofs=np.array([system.n - 1]))
    result = solved(asked)
    names = {field.name for field in fields(time_history.Result)} - {
        "t", "dof", "error_statement", "error_tolerance", "error_digits",
    }  # fmt: skip
    absent = ("derivative_", "error_derivative_", "parameter")  # ensembles have no derivatives
    names = {name for name in names if not name.startswith(absent)}
    for i in (0, 1, 17, 149):
        alone_problem = asked.member(i)
        alone = time_history.solve(alone_problem, time_history.plan(alone_problem))
        for name in names:
            expected, found = getattr(alone, name), getattr(result, name)
            if expected is None:
                assert found is None
                continue
            for dim in ("impact", "contact"):
                if name.removeprefix("error_").startswith(f"{dim}_"):
                    start = getattr(result, f"{dim}_offset")[i]
                    found = found[start : start + getattr(result, f"{dim}_count")[i]]
                    break
            else:
                found = found[i]
            np.testing.assert_array_equal(found, expected, err_msg=name)
    assert result.impact_time is not None
    assert result.impact_count is not None
    assert result.impact_count.sum() == result.impact_time.size == result.count_impacts.sum()
    assert result.impact_time.size > 200


def test_a_member_outside_of_the_limits_is_an_entry_of_its_own() -> None:
    x, v = states(OSCILLATOR, 40)
    right = solved(problem(OSCILLATOR, x, v))
    x[0], x[17] = 2.0, -3.0
    result = solved(problem(OSCILLATOR, x, v))
    assert np.flatnonzero(result.status).tolist() == [0, 17]
    assert (result.status[[0, 17]] == 1).all()
    assert [text.partition(":")[0] for text in result.error_failures] == ["member 0", "member 17"]
    assert "outside of its limits" in result.error_failures[0]
    assert result.x is not None
    assert right.x is not None
    assert np.isnan(result.x[[0, 17]]).all()
    assert np.isnan(result.error_condition[17])
    others = np.setdiff1d(np.arange(40), [0, 17])
    np.testing.assert_array_equal(result.x[others], right.x[others])
    assert result.impact_count is not None
    assert right.impact_count is not None
    assert (result.impact_count[[0, 17]] == 0).all()
    np.testing.assert_array_equal(result.impact_count[others], right.impact_count[others])


def test_an_ensemble_may_be_wrong_throughout() -> None:
    result = solved(problem(OSCILLATOR, np.full((3, 1), 2.0), np.zeros((3, 1))))
    assert result.status.tolist() == [1, 1, 1]
    assert result.impact_time is not None
    assert result.impact_time.size == 0
    assert result.count_impacts.tolist() == [0, 0, 0]


def test_members_that_cannot_start_are_told_apart_from_all() -> None:
    """Of a piece all may be out of range; of the whole it is the fault of the request."""
    x, v = np.zeros((6, 1)), np.full((6, 1), 1.5)
    x[:4] = [[2.0], [1e200], [-3.0], [1e-200]]
    asked = problem(OSCILLATOR, x, v)
    plan = ensemble.plan(asked)
    pieces = [asked.piece(start, start + 1) for start in range(6)]
    joined = ensemble.join(asked, plan, [ensemble.solve(piece, plan) for piece in pieces])
    assert joined.status.tolist() == [1, 1, 1, 1, 0, 0]
    assert solved(asked).status.tolist() == joined.status.tolist()
    assert asked.start is not None
    assert asked.start.row == 4
    assert solved(problem(OSCILLATOR, x[:3], v[:3])).status.tolist() == [1, 1, 1]
    free = asked.piece(1, 2)
    with pytest.raises(ModelError, match=r"initial.x: no state is in range; of the first, the"):
        ensemble.plan(free)


def test_the_first_member_inside_the_limits_is_found_among_many() -> None:
    """By the same comparison as of one motion, to the last bit."""
    x = 1.0 + np.array([2, 3, 1, 0, 50, 40, -30])[:, np.newaxis] * 2.0**-52
    many = np.concatenate([np.full((10_000, 1), 2.0), x])
    at = problem(OSCILLATOR, many, np.zeros_like(many)).start
    assert at is not None
    assert (at.row, at.inside) == (10_000, True)
    for row in x:
        one = time_history.first_start(OSCILLATOR.constraints, row[np.newaxis], np.zeros((1, 1)))
        assert one is not None
        try:
            time_history.Problem(OSCILLATOR, time_history.State(row, np.zeros(1)), 1.0)
        except ModelError:
            assert not one.inside
        else:
            assert one.inside


def test_errors_of_members_are_given_up_when_asked() -> None:
    asked = problem(OSCILLATOR, np.full((5000, 1), 2.0), np.zeros((5000, 1)))
    calls = 0

    def tick(_done: int, _total: int) -> None:
        nonlocal calls
        calls += 1
        if calls > 2:
            raise Cancelled

    with pytest.raises(Cancelled):
        ensemble.solve(asked, ensemble.plan(asked), tick)


def test_a_motion_that_cannot_be_followed_is_reported_with_the_member(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refusing(*_: Any) -> None:
        raise PlanError("this one cannot be followed")

    monkeypatch.setattr(rigid_motions.Run, "finish", refusing)
    ball = presets.bouncing_ball([Constraint((0,), (1.0,), 0.0, None, 0.5)])
    result = solved(problem(ball, np.array([[1e3], [0.1], [900.0]]), np.zeros((3, 1))))
    assert result.status.tolist() == [0, 2, 0]  # the second one comes to rest
    assert result.error_failures == ["member 1: this one cannot be followed"]


@pytest.mark.needs("compiled kernels")
def test_pieces_make_the_whole() -> None:
    x, v = states(CHAIN, 50)
    x[5], x[40:50] = 3.0, 3.0
    asked = problem(CHAIN, x, v)
    plan = ensemble.plan(asked)
    pieces = ensemble.split(asked, plan, 0.004)
    assert len(pieces) > 3
    assert sum(piece.size for piece in pieces) == 50
    assert len({ensemble.content(piece) for piece in pieces}) == len(pieces)
    joined = ensemble.join(asked, plan, [ensemble.solve(piece, plan) for piece in pieces])
    whole = ensemble.solve(asked, plan)
    for field in fields(ensemble.Result):
        expected = getattr(whole, field.name)
        if isinstance(expected, np.ndarray):
            np.testing.assert_array_equal(getattr(joined, field.name), expected, err_msg=field.name)
        else:
            assert getattr(joined, field.name) == expected


def test_a_longer_ensemble_shares_the_pieces_of_a_shorter_one() -> None:
    x, v = states(CHAIN, 90)
    short, long = problem(CHAIN, x[:60], v[:60]), problem(CHAIN, x, v)
    marks = [
        {ensemble.content(p) for p in ensemble.split(asked, ensemble.plan(asked), 0.02)}
        for asked in (short, long)
    ]
    assert len(marks[0] - marks[1]) <= 1  # the last one of the shorter is cut off


def test_one_spectrum_is_planned_for_all() -> None:
    x, v = states(CHAIN, 90)
    plan = ensemble.plan(problem(CHAIN, x, v))
    counts = {step.stage: step.count for step in plan.steps}
    assert counts == {Stage.SPECTRUM: 1, Stage.FREE_MOTION: 90, Stage.HISTORY: 90}
    assert any("89 of 90 members" in skip.what for skip in plan.skips)
    ten = ensemble.plan(problem(CHAIN, x[:10], v[:10]))
    assert 8.0 < plan.flops / ten.flops < 9.1


def test_it_stops_when_it_is_told_to() -> None:
    x, v = states(CHAIN, 400)
    asked = problem(CHAIN, x, v, t_end=400.0, t=None, outputs=frozenset({"impacts"}))

    def stop(done: int, total: int) -> None:
        raise Cancelled

    before = threading.active_count()
    with pytest.raises(Cancelled):
        ensemble.solve(asked, ensemble.plan(asked), stop)
    assert threading.active_count() == before


@pytest.mark.parametrize(
    ("x", "v", "pointer", "code"),
    [
        (np.zeros((2, 3)), np.zeros((2, 1)), ("initial", "x"), "wrong_length"),
        (np.zeros((2, 1)), np.zeros((3, 1)), ("initial", "v"), "wrong_length"),
        (np.zeros((0, 1)), np.zeros((0, 1)), ("initial", "v"), "wrong_length"),
        (np.full((2, 1), np.nan), np.zeros((2, 1)), ("initial", "x"), "not_finite"),
    ],
)
def test_wrong_states_name_the_field(
    x: Floats, v: Floats, pointer: tuple[str, ...], code: str
) -> None:
    with pytest.raises(ModelError) as caught:
        problem(OSCILLATOR, x, v)
    assert (caught.value.pointer, caught.value.code) == (pointer, code)


def test_what_all_members_share_is_checked_once() -> None:
    x, v = states(OSCILLATOR, 2)
    x[0] = 9.0
    with pytest.raises(ModelError) as caught:
        problem(OSCILLATOR, x, v, t_end=-1.0)
    assert caught.value.pointer == ("t_end",)
