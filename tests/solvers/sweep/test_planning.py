"""Grids are cut at positions that do not depend on their ends, the most expensive axis slowest."""

from __future__ import annotations

import itertools
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vibroimpact_solvers import impact_modes, sweep
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.plan import Stage
from vibroimpact_solvers.rates import SWEEP

ONE = SymmetricMatrix.diagonal([1.0])
SYSTEM = System(ONE, ONE, (Constraint.at(0, 0.2),))


def at(index: tuple[int, ...]) -> impact_modes.Problem:
    return impact_modes.Problem(SYSTEM, np.linspace(1.0, 2.0, 50))


def stepped(first: int, places: int, step: float = 0.05, name: str = "k") -> sweep.Axis:
    """Return an axis of multiples of a step."""
    values = np.array([float(Decimal(repr(step)) * k) for k in range(first, first + places)])
    return sweep.Axis(name, name, values, stage=Stage.SPECTRUM, offset=first)


def grid(*axes: sweep.Axis) -> sweep.Problem:
    return sweep.Problem("impact-modes", axes, at, SYSTEM)


def pieces(problem: sweep.Problem, seconds: float = 2e-3) -> list[sweep.Problem]:
    return sweep.split(problem, sweep.plan(problem), seconds)


def covered(problem: sweep.Problem, parts: list[sweep.Problem]) -> np.ndarray:
    times = np.zeros(problem.shape, dtype=int)
    for part in parts:
        times[tuple(slice(start, stop) for start, stop in part.spans)] += 1
    return times


@given(
    st.lists(st.integers(1, 9), min_size=1, max_size=3),
    st.lists(st.sampled_from([Stage.SPECTRUM, Stage.RESPONSE, Stage.IMPULSE, None]), min_size=3),
    st.floats(1e-5, 1.0),
    st.integers(-40, 40),
)
@settings(deadline=None, max_examples=60)
def test_pieces_cover_every_point_once(
    sizes: list[int], stages: list[Stage | None], seconds: float, offset: int
) -> None:
    axes = [
        sweep.Axis(f"a{i}", f"a{i}", np.arange(float(size)), stage=stage, offset=offset)
        for i, (size, stage) in enumerate(zip(sizes, stages, strict=False))
    ]
    problem = grid(*axes)
    parts = pieces(problem, seconds)
    assert (covered(problem, parts) == 1).all()
    for part in parts:
        for axis, span in zip(axes, part.spans, strict=True):
            assert axis.stage is not None or span == (0, axis.values.size)


def test_a_longer_and_a_shifted_sweep_have_the_pieces_of_this_one() -> None:
    names = {sweep.content(piece) for piece in pieces(grid(stepped(8, 64)))}
    longer = {sweep.content(piece) for piece in pieces(grid(stepped(8, 200)))}
    shifted = {sweep.content(piece) for piece in pieces(grid(stepped(24, 64)))}
    assert len(names) >= 8
    assert len(names & longer) >= len(names) - 1  # the last piece may be cut by the end
    assert len(names & shifted) >= len(names) * 48 // 64 - 2


def test_pieces_are_shared_wherever_a_sweep_begins() -> None:
    names = {sweep.content(piece) for piece in pieces(grid(stepped(8, 64)))}
    for first in (5, 11, 15):
        shifted = {sweep.content(piece) for piece in pieces(grid(stepped(first, 64)))}
        # Other ends cut one piece each.
        assert len(names & shifted) >= len(names) * 56 // 64 - 2


def test_axes_of_other_values_share_no_piece() -> None:
    names = {sweep.content(piece) for piece in pieces(grid(stepped(8, 64)))}
    others = {sweep.content(piece) for piece in pieces(grid(stepped(8, 64, step=0.06)))}
    assert names.isdisjoint(others)
    renamed = {sweep.content(piece) for piece in pieces(grid(stepped(8, 64, name="K")))}
    assert names.isdisjoint(renamed)


def test_the_most_expensive_axis_varies_slowest() -> None:
    stages = {"gap": Stage.IMPULSE, "e": None, "K": Stage.SPECTRUM, "w": Stage.RESPONSE}
    axes = [sweep.Axis(n, n, np.arange(2.0), stage=stage) for n, stage in stages.items()]
    problem = grid(*axes)
    assert [axes[place].name for place in problem.order] == ["K", "w", "gap", "e"]
    points = list(problem.points())
    assert points[:3] == [(0, 0, 0, 0), (1, 0, 0, 0), (0, 0, 0, 1)]
    assert len(points) == 8
    assert problem.count(Stage.SPECTRUM) == 2
    assert problem.count(Stage.RESPONSE) == 4
    assert problem.count(Stage.EXISTENCE) == 8


def test_pieces_follow_one_another_as_their_points_do() -> None:
    slow, fast = stepped(0, 4), sweep.Axis("g", "g", np.arange(64.0), stage=Stage.IMPULSE)
    parts = pieces(grid(fast, slow), 2e-3)
    assert len(parts) > 4
    starts = [(part.spans[1][0], part.spans[0][0]) for part in parts]
    assert starts == sorted(starts)
    assert all(a != b for a, b in itertools.pairwise(starts))


def test_axes_are_told_apart_by_their_names() -> None:
    with pytest.raises(ModelError) as caught:
        grid(stepped(0, 3), stepped(0, 3))
    assert (caught.value.pointer, caught.value.code) == (("axes", 1, "name"), "duplicate_name")


def test_there_must_be_a_row_for_the_kind() -> None:
    with pytest.raises(ModelError) as caught:
        sweep.Problem("no-such-kind", (stepped(0, 3),), at, SYSTEM)
    assert caught.value.pointer == ("kind",)


def test_a_sweep_costs_what_it_takes_to_make_its_points() -> None:
    idle = sweep.Axis("i", "i", np.arange(5.0), stage=None, why="it changes nothing")
    plan = sweep.plan(grid(stepped(1, 4), stepped(1, 3, name="m"), idle))
    assert plan.points == 12  # those that differ by the idle axis alone are one
    alone = impact_modes.plan(at((0, 0, 0))).seconds
    assert plan.seconds > 12 * SWEEP.point
    assert plan.seconds < SWEEP.start + 12 * (SWEEP.point + max(1.0, SWEEP.begun) * alone)
