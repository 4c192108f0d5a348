"""Plans of sweeps: how often each stage is computed, what is skipped, and the pieces of a job."""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

from vibroimpact_solvers.errors import ModelError, PlanError, SolverError
from vibroimpact_solvers.plan import BYTES_PER_SECOND, OVERHEAD_SECONDS, Plan, Skip, Stage, Step
from vibroimpact_solvers.rates import SWEEP
from vibroimpact_solvers.sweep.problem import KIND, Axis, Index, Problem, Span, rank

_TRIED: Final = 1000
"""Invalid points after which a sweep counts as having no plan."""
_SHARED: Final = 0.9
"""Part of the cost of impulses that is the response, where responses are shared."""


def plan(problem: Problem) -> Plan:
    """Choose how often each stage is computed.

    The methods are those of the first point that has a plan. Every point is solved by the plan
    that it has alone, so that its result does not depend on other points.
    """
    point, of_point = _first(problem)
    steps = tuple(_steps(problem, point, of_point))
    points = math.prod(axis.values.size for axis in problem.axes if axis.stage is not None)
    skips = tuple(_skips(problem, of_point))
    return Plan(KIND, steps, skips, points, of=problem.kind)


def _first(problem: Problem) -> tuple[Any, Plan]:
    """Return the problem and the plan of the first point that has one."""
    error: SolverError | None = None
    for index in itertools.islice(problem.points(), _TRIED):
        try:
            point = problem.problem(index)
            return point, problem.swept_kind.solver.plan(point)
        except SolverError as caught:
            error = error or caught
    if isinstance(error, ModelError | PlanError):
        raise error.under("base")
    assert error is not None
    raise error


def _steps(problem: Problem, point: Any, of_point: Plan) -> Iterator[Step]:
    swept, points = problem.swept_kind, math.prod(problem.shape)
    frequencies = 1 if swept.response_count is None else swept.response_count(point)
    for step in of_point.steps:
        if step.stage is Stage.FREE_MOTION and problem.follow is not None:
            step = _linked(problem, point, step)
        if step.stage is Stage.IMPULSE and swept.solve_many is not None:
            responses = problem.count(Stage.RESPONSE)
            yield replace(
                step,
                stage=Stage.RESPONSE,
                flops=_SHARED * step.flops * responses,
                bytes=0.0,
                count=responses * frequencies,
            )
            step = replace(
                step,
                reason="impulses from the responses and the walls",
                flops=(1.0 - _SHARED) * step.flops,
            )
        count = problem.count(step.stage)
        # One spectrum is kept at a time; results are kept at every point.
        kept = 1 if step.stage is Stage.SPECTRUM else points
        each = 1 if step.stage is Stage.SPECTRUM else frequencies
        yield replace(
            step,
            flops=step.flops * count,
            bytes=step.bytes * kept,
            count=count * each,
            bounded=step.bounded and points == 1,  # others are expected to be like the first
        )


def _linked(problem: Problem, point: Any, step: Step) -> Step:
    """Return the step of motions that start where others ended."""
    continued = problem.swept_kind.continued
    assert continued is not None
    motions = continued.motions(point)
    reason = f"{step.reason}; along {problem.axes[0].name} each point starts where the last ended"
    if motions > 1:
        reason += ", and where it ends is computed beside its outputs, which do not contain that"
    return replace(step, reason=reason, flops=step.flops * motions)


def _skips(problem: Problem, of_point: Plan) -> Iterator[Skip]:
    points = math.prod(problem.shape)
    for axis in problem.axes:
        if axis.stage is None:
            what = f"computing again along {axis.name}"
            yield Skip(what, f"{axis.why}: one result holds for all {axis.values.size} values")
    stages = dict.fromkeys(step.stage for step in of_point.steps)
    if problem.swept_kind.solve_many is not None and Stage.IMPULSE in stages:
        stages = dict.fromkeys((Stage.RESPONSE, *stages))
    for stage in sorted(stages, key=rank):
        count = problem.count(stage)
        later = [
            a.name for a in problem.axes if rank(a.stage) > rank(stage) and a.stage is not None
        ]
        if later and count < points:
            what = f"{stage} at {points - count} of {points} points"
            yield Skip(what, f"{', '.join(later)}: invalidates later stages only")
    yield from of_point.skips


def split(problem: Problem, plan: Plan, seconds_each: float) -> list[Problem]:
    """Cut a grid along its slowest axes into pieces of about the given cost.

    It is never cut along an axis on which each point starts where the last ended.

    Cuts lie at multiples of a power of two on the grid that all axes of one start and step
    share, wherever this one ends: pieces of a longer or a shifted sweep are the same.
    """
    shape = [1] * len(problem.axes)
    cuts: list[list[Span]] = [[(k, k + 1) for k in range(*span)] for span in problem.spans]
    for place in reversed(problem.order):
        axis = problem.axes[place]
        one = _seconds(problem, plan, shape)
        shape[place] = axis.values.size
        price = _seconds(problem, plan, shape)
        small = price <= seconds_each and place != problem.order[0]
        if axis.stage is None or problem.linked(place) or small:
            cuts[place] = [problem.spans[place]]
            continue
        shape[place] = min(2, axis.values.size)
        each = _seconds(problem, plan, shape) - one if shape[place] > 1 else one
        places = 1 << int(math.log2(max(seconds_each / max(each, 1e-9), 1.0)))
        cuts[place] = _cuts(axis, problem.spans[place], places)
        if price > seconds_each:
            break
    return [problem.piece(spans) for spans in problem.combinations(cuts)]


def content(piece: Problem) -> bytes:
    """Return the axes of a piece and their values, to the last bit."""
    text = hashlib.sha256()
    for axis, (start, stop) in zip(piece.axes, piece.spans, strict=True):
        text.update(f"|{axis.path}|{axis.name}|{stop - start}|".encode())
        text.update(axis.values[start:stop].tobytes())
    return text.digest()


def spans(problem: Problem, shapes: list[Index]) -> list[tuple[Span, ...]]:
    """Return the ranges of the pieces of `split`, from their shapes in that order."""
    at = [start for start, _ in problem.spans]
    pieces = []
    for shape in shapes:
        pieces.append(tuple((a, a + size) for a, size in zip(at, shape, strict=True)))
        for place in reversed(problem.order):
            at[place] += shape[place]
            if at[place] < problem.spans[place][1]:
                break
            at[place] = problem.spans[place][0]
    return pieces


def _cuts(axis: Axis, span: Span, places: int) -> list[Span]:
    start, stop = span
    first = start + places - (start + axis.offset) % places
    bounds = [start, *range(first, stop, places), stop]
    return list(itertools.pairwise(bounds))


def _seconds(problem: Problem, plan: Plan, shape: list[int]) -> float:
    """Return the planned time of a piece of a shape, cached spectra included."""
    piece = problem.piece(tuple((0, size) for size in shape))
    total = 0.0
    for step in plan.steps:
        share = piece.count(step.stage) / problem.count(step.stage)
        flops = step.flops * share
        if step.stage is Stage.SPECTRUM:
            # Workers with a cached spectrum must cut as those without it.
            flops = 14.0 * (step.bytes / 8.0) ** 1.5 * piece.count(step.stage)
        total += step.rate(problem.kind).each * flops
        total += step.bytes * share / BYTES_PER_SECOND
    active = (size for size, axis in zip(shape, problem.axes, strict=True) if axis.stage)
    begun = sum(step.rate(problem.kind).start for step in plan.steps)
    return total + (OVERHEAD_SECONDS + SWEEP.begun * begun) * math.prod(active)
