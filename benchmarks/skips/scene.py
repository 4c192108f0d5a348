"""What a scene is, and how it is timed."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import ModuleType
from typing import Any
from unittest import mock

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.spectrum import Cache, methods


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

    def planned(self) -> object:
        """Do what the plan lists."""
        return solve(self.solver, self.problem())


def solve(solver: ModuleType, problem: Any) -> object:
    """Plan and solve, as the service does."""
    return solver.solve(problem, solver.plan(problem))


def forget_modes() -> None:
    """Empty the cache of natural modes; only inside `fresh`, which has its own."""
    vars(methods)["CACHE"] = Cache(2**30)


@contextmanager
def fresh() -> Iterator[None]:
    """Start from an empty cache of natural modes, in the body of a with statement."""
    spectrum.CACHE.clear()
    with mock.patch.object(methods, "CACHE", Cache(2**30)):
        yield


def timed(work: Callable[[], object], rounds: int = 3) -> float:
    """Return the least time of the processor, natural modes forgotten before each round."""
    times = []
    for _ in range(rounds + 1):
        with fresh():
            start = time.process_time()
            work()
            times.append(time.process_time() - start)
    return min(times[1:])
