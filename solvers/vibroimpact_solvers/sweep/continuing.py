"""Continued sweeps: along the first axis each point starts where the last ended.

A line of points along the first axis is a chain; the chains of a sweep do not depend on one
another. A point without a result is left out: the next one starts where the last result ended.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import groupby
from typing import Any, Final

from vibroimpact_solvers.errors import SolverError, attempt
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.plan import Stage
from vibroimpact_solvers.sweep.kinds import Outcome
from vibroimpact_solvers.sweep.problem import Index, Problem

_BATCH: Final = 4096
"""Chains that are computed side by side."""


def outcomes(problem: Problem, report: Callable[[], None]) -> Iterator[tuple[Index, Outcome]]:
    """Yield the result of each point of a continued sweep, or the error that it has instead."""
    continued = problem.swept_kind.continued
    assert continued is not None
    for chains in _batches(problem):
        ends: list[Any] = [None] * len(chains)
        for place in range(problem.shape[0]):
            indices = [(place, *others) for others in chains]
            points = []
            for index, end in zip(indices, ends, strict=True):
                look()
                points.append(attempt(problem.started, index, end))
            possible = [k for k, each in enumerate(points) if not isinstance(each, SolverError)]
            solved = continued.solve_each(
                [points[k] for k in possible], [ends[k] for k in possible], report
            )
            for k, (outcome, end) in zip(possible, solved, strict=True):
                points[k] = outcome
                ends[k] = ends[k] if end is None else end
            yield from zip(indices, points, strict=True)


def _batches(problem: Problem) -> Iterator[list[Index]]:
    """Yield positions of chains on the other axes; those with the same natural modes together."""
    _, *others = problem.shape
    firsts = problem.combinations([range(1), *map(range, others)])
    for _, same_modes in groupby(firsts, problem.positions(Stage.SPECTRUM)):
        chains = [index[1:] for index in same_modes]
        for begin in range(0, len(chains), _BATCH):
            yield chains[begin : begin + _BATCH]
