"""Plans ensembles: how often each step is done, what is skipped, and the pieces of a job."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import replace

from vibroimpact_solvers import time_history
from vibroimpact_solvers.ensemble.problem import KIND, Problem
from vibroimpact_solvers.plan import BYTES_PER_SECOND, OVERHEAD_SECONDS, Plan, Skip, Stage, Step


def plan(problem: Problem) -> Plan:
    """Decide how the motions are computed and what is left out: alike for all members.

    Raises
    ------
    ModelError
        Where numbers of all members are out of range.
    """
    if problem.start is None:
        time_history.refuse_all(problem.member)
    of_one = time_history.plan(time_history.of_mean_speed(problem.pattern, problem.v))
    return Plan(KIND, tuple(_steps(problem, of_one)), tuple(_skips(problem, of_one)))


def split(problem: Problem, plan: Plan, seconds_each: float) -> list[Problem]:
    """Cut an ensemble into pieces of about the given cost each."""
    own = [step for step in plan.steps if step.stage is not Stage.SPECTRUM]
    work = sum(step.rate(KIND).each * step.flops for step in own)
    written = sum(step.bytes for step in own) / BYTES_PER_SECOND
    # What a piece begins with does not go by its members, whose number must not matter.
    each = (work + written) / problem.size + OVERHEAD_SECONDS
    # Counts that are powers of two, from the first member on: a longer ensemble that begins
    # alike has the same pieces.
    count = 1
    while 2 * count * each <= seconds_each and count < problem.size:
        count *= 2
    return [
        problem.piece(start, min(start + count, problem.size))
        for start in range(0, problem.size, count)
    ]


def content(problem: Problem) -> bytes:
    """Return a digest of the piece: its initial states, bit for bit."""
    text = hashlib.sha256(f"{problem.first}:{problem.x.shape}".encode())
    for values in (problem.x, problem.v):
        text.update(values.tobytes())
    return text.digest()


def _steps(problem: Problem, of_one: Plan) -> Iterator[Step]:
    for step in of_one.steps:
        if step.stage is Stage.SPECTRUM:
            yield replace(step, reason=f"{step.reason}; one for all members")
            continue
        yield replace(
            step,
            reason=f"{step.reason}; members in parallel",
            flops=step.flops * problem.size,
            bytes=step.bytes * problem.size,
            count=problem.size,
            # Which walls are reached is known of a member of the mean speed alone.
            bounded=step.bounded and not problem.system.constraints,
        )


def _skips(problem: Problem, of_one: Plan) -> Iterator[Skip]:
    yield Skip(
        f"spectrum at {problem.size - 1} of {problem.size} members",
        "initial states invalidate later stages only",
    )
    # The walls that the energy of one member reaches are not those of the others.
    yield from (skip for skip in of_one.skips if not skip.what.startswith("constraint "))
