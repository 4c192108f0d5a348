"""Results of every form put together: tables of differing length, scalars, points without any."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Annotated, Any

import numpy as np
import pytest

from vibroimpact_solvers import sweep
from vibroimpact_solvers.arrays import Booleans, Floats, Integers, Quantity
from vibroimpact_solvers.errors import STATUSES, Cancelled, ConvergenceError, ModelError
from vibroimpact_solvers.model import SymmetricMatrix, System
from vibroimpact_solvers.plan import Plan, Stage, Step
from vibroimpact_solvers.sweep.kinds import KINDS, Rule, SweptKind

ONE = SymmetricMatrix.diagonal([1.0])
SYSTEM = System(ONE, ONE, ())


@dataclass(frozen=True)
class Result:
    """Bounces of a ball: the higher it starts the more there are; times until an end."""

    t: Annotated[Floats, Quantity(("time",), "time", "time", True)]
    x: Annotated[Floats, Quantity(("time",), "length", "height")]
    rests: Annotated[Booleans, Quantity((), "1", "does it rest", flags=("no", "yes"))]
    reason: Annotated[Integers, Quantity((), "1", "why", flags=("low", "high"))]
    impact_time: Annotated[
        Floats, Quantity(("impact",), "time", "time of impact", path="impacts/time")
    ]
    impact_side: Annotated[
        Integers, Quantity(("impact",), "1", "wall", path="impacts/side", flags=("floor", "roof"))
    ]
    count_impacts: Annotated[int, Quantity((), "1", "number of impacts", path="count/impacts")]
    error_statement: Annotated[str, Quantity((), "1", "statement", path="error/statement")] = (
        "exact"
    )


@dataclass(frozen=True)
class Problem:
    height: float
    end: float
    colour: float


class Bounces(ModuleType):
    """A solver with one step; heights above 9 do not converge."""

    Result = Result

    def __init__(self) -> None:
        super().__init__("bounces")
        self.solved: list[Problem] = []

    def plan(self, problem: Problem) -> Plan:
        return Plan("bounces", (Step(Stage.FREE_MOTION, "exact", "it flies", 1e6, 100.0),))

    def solve(self, problem: Problem, plan: Plan, tick: Callable[[int, int], None]) -> Result:
        tick(0, 1)
        self.solved.append(problem)
        if problem.height > 9.0:
            raise ConvergenceError("it does not come down")
        count = int(problem.height)
        t = np.linspace(0.0, problem.end, 3)
        return Result(
            t,
            problem.height - t,
            np.bool_(count == 0),
            np.int64(count > 3),
            problem.height + 0.1 * np.arange(count),
            np.arange(count) % 2,
            count,
        )


HEIGHTS = np.array([3.0, 0.0, 10.0, 2.0, -1.0])
ENDS = np.array([1.0, 2.0])
COLOURS = np.array([1.0, 2.0, 3.0])


@pytest.fixture
def solver(monkeypatch: pytest.MonkeyPatch) -> Bounces:
    solver = Bounces()
    rules = (
        Rule("height", Stage.FREE_MOTION),
        Rule("end", Stage.WAVEFORM, changes=("t",)),
        Rule("colour", None, "colours do not bounce"),
    )
    row = SweptKind(solver, rules, ragged=frozenset({"impact"}))
    monkeypatch.setattr(sweep.problem, "KINDS", {**KINDS, "bounces": row})
    return solver


def problem() -> sweep.Problem:
    def at(index: tuple[int, ...]) -> Problem:
        height, end, colour = HEIGHTS[index[0]], ENDS[index[2]], COLOURS[index[1]]
        if height < 0.0:
            raise ModelError(("height",), "it is below the floor", code="out_of_range")
        return Problem(height, end, colour)

    axes = (
        sweep.Axis("height", "height", HEIGHTS, "length", stage=Stage.FREE_MOTION),
        sweep.Axis("colour", "colour", COLOURS, stage=None, why="colours do not bounce"),
        sweep.Axis("end", "end", ENDS, "time", stage=Stage.WAVEFORM, changes=("t",)),
    )
    return sweep.Problem("bounces", axes, at, SYSTEM)


def solved() -> sweep.Result:
    whole = problem()
    return sweep.solve(whole, sweep.plan(whole))


def rows(result: sweep.Result, index: tuple[int, ...]) -> Floats:
    start = int(result.arrays["impact_offset"][index])
    return result.arrays["impact_time"][start : start + int(result.arrays["impact_count"][index])]


def test_rows_of_tables_stand_one_after_the_other_in_the_order_of_points(solver: Bounces) -> None:
    result = solved()
    counts = result.arrays["impact_count"]
    assert counts.shape == (5, 3, 2)
    np.testing.assert_array_equal(counts[:, 0, 0], [3, 0, 0, 2, 0])
    assert result.arrays["impact_time"].size == counts.sum() == 30
    assert result.meanings["impact_count"].rows_of == "impact"
    assert result.meanings["impact_time"].dims == ("impact",)
    assert result.meanings["impact_time"].path == "impacts/time"
    np.testing.assert_array_equal(rows(result, (0, 2, 1)), [3.0, 3.1, 3.2])
    np.testing.assert_array_equal(rows(result, (3, 0, 0)), [2.0, 2.1])
    flat = result.arrays["impact_offset"].ravel()
    np.testing.assert_array_equal(flat, np.cumsum(counts.ravel()) - counts.ravel())


def test_an_axis_that_invalidates_nothing_is_computed_once_and_spread(solver: Bounces) -> None:
    result = solved()
    assert len(solver.solved) == 8  # 4 heights that are possible, 2 ends
    assert {p.colour for p in solver.solved} == {1.0}
    assert result.arrays["x"].shape == (5, 3, 2, 3)
    np.testing.assert_array_equal(result.arrays["x"][0, 0], result.arrays["x"][0, 2])
    skips = {skip.what: skip.why for skip in sweep.plan(problem()).skips}
    expected = "colours do not bounce: one result holds for all 3 values"
    assert skips["computing again along colour"] == expected


def test_coordinates_have_the_axes_that_move_them(solver: Bounces) -> None:
    result = solved()
    assert result.meanings["t"].dims == ("end", "time")
    np.testing.assert_array_equal(result.arrays["t"], [[0.0, 0.5, 1.0], [0.0, 1.0, 2.0]])


def test_scalars_stand_at_every_point(solver: Bounces) -> None:
    result = solved()
    assert result.meanings["count_impacts"].dims == ("height", "colour", "end")
    assert result.meanings["count_impacts"].path == "count/impacts"
    assert result.arrays["count_impacts"][3, 1, 1] == 2
    assert result.plain["error/statement"] == "exact"


def test_points_without_a_result_say_why(solver: Bounces) -> None:
    result = solved()
    status = np.array(STATUSES)[result.arrays["status"]]
    assert (status[2] == "no_convergence").all()
    assert (status[4] == "invalid").all()
    assert (status[[0, 1, 3]] == "ok").all()
    assert np.isnan(result.arrays["x"][[2, 4]]).all()
    assert not result.arrays["rests"][[2, 4]].any()
    assert (result.arrays["reason"][[2, 4]] == 2).all()
    assert result.meanings["reason"].flags == ("low", "high", "failed")
    assert (result.arrays["count_impacts"][[2, 4]] == -1).all()
    assert (
        "height = 10, colour = 1, end = 1: it does not come down" in result.plain["error/failures"]
    )


@pytest.mark.parametrize("seconds", [1e-9, 5e-3, 1.2e-2, 1e9])
def test_pieces_give_the_whole_to_the_last_bit(solver: Bounces, seconds: float) -> None:
    whole = problem()
    plan = sweep.plan(whole)
    pieces = sweep.split(whole, plan, seconds)
    joined = sweep.join(whole, plan, [sweep.solve(piece, plan) for piece in pieces])
    once = solved()
    assert list(joined.arrays) == list(once.arrays)
    for name, values in once.arrays.items():
        np.testing.assert_array_equal(joined.arrays[name], values)
        assert joined.arrays[name].dtype == values.dtype
    assert joined.meanings == once.meanings
    assert joined.plain == once.plain


def test_results_of_other_sizes_are_refused(solver: Bounces) -> None:
    def at(index: tuple[int, ...]) -> Problem:
        return Problem(1.0, 1.0 + index[0], 1.0)

    axis = sweep.Axis("end", "end", ENDS, stage=Stage.WAVEFORM)  # does not say that t changes
    whole = sweep.Problem("bounces", (axis,), at, SYSTEM)
    with pytest.raises(ModelError) as caught:
        sweep.solve(whole, sweep.plan(whole))
    assert (caught.value.pointer, caught.value.code) == (("axes",), "shapes_differ")


def test_it_stops_where_it_is_told_to(solver: Bounces) -> None:
    told: list[Any] = []

    def tick(done: int, total: int) -> None:
        told.append((done, total))
        if done == 3:
            raise Cancelled

    whole = problem()
    with pytest.raises(Cancelled):
        sweep.solve(whole, sweep.plan(whole), tick)
    assert len(solver.solved) == 3
    assert told[-1] == (3, 10)


def test_a_sweep_without_any_possible_point_is_none(solver: Bounces) -> None:
    def at(index: tuple[int, ...]) -> Problem:
        raise ModelError(("height",), "it is below the floor", code="out_of_range")

    axis = sweep.Axis("end", "end", ENDS, stage=Stage.WAVEFORM)
    with pytest.raises(ModelError, match="below the floor"):
        sweep.plan(sweep.Problem("bounces", (axis,), at, SYSTEM))
