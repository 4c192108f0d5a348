"""What a scene is, and how its work is counted and timed."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from benchmarks.counters import counting, fresh, numbers
from vibroimpact_solvers.plan import Plan

NUMBERS = "numbers of the result"


@dataclass(frozen=True, slots=True)
class Scene:
    """One thing that is requested, as the plan does it and without what the plan skips.

    Parameters
    ----------
    name : str
    solver : module
        Its ``plan`` and ``solve`` answer the problem.
    problem : callable
        Returns the problem, made anew: nothing is known of its structure.
    without : callable
        Does the same without the skip; it returns the result or nothing.
    states : tuple of str
        What the plan says that it skips, and this scene shows; empty where it saves something
        that it does not say.
    """

    name: str
    solver: ModuleType
    problem: Callable[[], Any]
    without: Callable[[], object]
    states: tuple[str, ...] = ()

    def plan(self) -> Plan:
        """Return the plan."""
        plan: Plan = self.solver.plan(self.problem())
        return plan

    def planned(self) -> object:
        """Do what the plan lists."""
        return solve(self.solver, self.problem())


def solve(solver: ModuleType, problem: Any) -> object:
    """Plan and solve, as the service does."""
    return solver.solve(problem, solver.plan(problem))


def counted(work: Callable[[], object]) -> Counter[str]:
    """Return what some work computes."""
    with counting() as counts:
        result = work()
    if held := numbers(result):
        counts[NUMBERS] = held
    return counts


def timed(work: Callable[[], object], rounds: int = 3) -> float:
    """Return the least time of the processor, natural modes forgotten before each round."""
    work()
    times = []
    for _ in range(rounds):
        with fresh():
            start = time.process_time()
            work()
            times.append(time.process_time() - start)
    return min(times)
