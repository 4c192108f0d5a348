"""A plan: what is computed, how and why, and what is skipped and why.

A plan is an immutable value. `plan(problem)` of a computation makes all decisions and
`solve(problem, plan)` follows them, so that a plan shown beforehand agrees with the work done.

Examples
--------
>>> from vibroimpact_solvers.plan import Plan, Stage, Step
>>> plan = Plan("impact-modes", (Step(Stage.SPECTRUM, "dense", "full matrices", flops=14e6),))
>>> plan.step(Stage.SPECTRUM).method, plan.step(Stage.ENERGY), plan.flops
('dense', None, 14000000.0)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TypeVar

Tick = Callable[[int, int], None]
"""Called with (done, total) while a computation runs; may raise `Cancelled`."""

_Problem = TypeVar("_Problem")
_Result = TypeVar("_Result")


class Stage(StrEnum):
    """Stages of a computation; a change of one invalidates those after it."""

    SPECTRUM = "spectrum"
    RESPONSE = "response"
    IMPULSE = "impulse"
    EXISTENCE = "existence"
    BANDS = "bands"
    SHAPE = "shape"
    WAVEFORM = "waveform"
    ENERGY = "energy"
    HARMONICS = "harmonics"
    STABILITY = "stability"
    FREE_MOTION = "flight"  # the name in plan documents
    HISTORY = "history"
    SLOW_FLOW = "slow_flow"


@dataclass(frozen=True, slots=True)
class Step:
    """One step of a computation.

    Parameters
    ----------
    stage : Stage
        What it computes.
    method : str
        Name of the chosen method.
    reason : str
        A sentence saying why this method.
    flops, bytes : float
        Estimated floating-point operations and memory written, all repetitions together.
    count : int
        Number of repetitions.
    bounded : bool
        Whether `flops` and `bytes` are upper bounds; else they are what is expected of a number,
        such as that of the impacts, which only the computation tells.
    settings : object, optional
        Further decisions of the method: an immutable value of a type of its own.
    """

    stage: Stage
    method: str
    reason: str
    flops: float = 0.0
    bytes: float = 0.0
    count: int = 1
    bounded: bool = field(default=True, kw_only=True)
    settings: object = None


@dataclass(frozen=True, slots=True)
class Skip:
    """One part of the computation that is left out: `what`, and the sentence `why`."""

    what: str
    why: str


@dataclass(frozen=True, slots=True)
class Plan:
    """All decisions of one computation.

    Parameters
    ----------
    kind : str
    steps : tuple of Step
    skips : tuple of Skip
    points : int
        Number of problems that are derived from a common one, as in a sweep.
    of : str
        Kind of the computations at these points, whose steps they are; empty: its own.
    """

    kind: str
    steps: tuple[Step, ...]
    skips: tuple[Skip, ...] = ()
    points: int = 0
    of: str = ""

    def step(self, stage: Stage) -> Step | None:
        """Return the step of a stage, or None where the plan has none."""
        return next((step for step in self.steps if step.stage is stage), None)

    @property
    def bounded(self) -> bool:
        """Whether its operations and its memory are upper bounds."""
        return all(step.bounded for step in self.steps)

    @property
    def flops(self) -> float:
        """Estimated floating-point operations of all steps."""
        return sum(step.flops for step in self.steps)

    @property
    def bytes(self) -> float:
        """Estimated memory written by all steps."""
        return sum(step.bytes for step in self.steps)


def batches(total: int, size: int, tick: Tick | None) -> Iterator[tuple[int, int]]:
    """Yield the ranges of batches of at most `size`; report before each, and at the end."""
    for start in range(0, total, size):
        if tick is not None:
            tick(start, total)
        yield start, min(start + size, total)
    if tick is not None:
        tick(total, total)


def split_nothing(problem: _Problem, plan: Plan, seconds_each: float) -> list[_Problem]:
    """Return a problem that cannot be divided as its only piece."""
    return [problem]


def join_only(problem: object, plan: Plan, results: Sequence[_Result]) -> _Result:
    """Return the result of the only piece."""
    (result,) = results
    return result
