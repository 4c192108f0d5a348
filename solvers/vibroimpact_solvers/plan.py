"""A plan: what is computed, how and why, and what is skipped and why.

A plan is an immutable value. `plan(problem)` of a computation makes all decisions and
`solve(problem, plan)` follows them, so that a plan shown beforehand agrees with the work done.

Its time on one core is estimated by measured rates for the operations of its steps. `rates` has
them, which ``python -m benchmarks.prices --calibrate`` writes. They are no bounds: about half of
the honest requests take between half and twice as long (the table is in
`docs/service/operation.md`), and what takes much longer is ended by the meter of the computation.

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
from typing import Final, TypeVar

from vibroimpact_solvers.rates import RATES, SWEEP, Rate

BYTES_PER_SECOND: Final = 5.0e8
"""Bytes of results that are written in a second."""
OVERHEAD_SECONDS: Final = 1e-4
"""Time of the smallest computation."""
_OF_A_KIND: Final = ("constrained structure", "partial")
"""Methods for natural modes that only one kind uses; the others take the same for all."""
_UNMEASURED: Final = Rate(0.0, 1e-9)
"""Of methods that no request of the calibration uses."""

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
    DERIVATIVES = "derivatives"
    FREE_MOTION = "flight"  # the name in plan documents
    HISTORY = "history"
    SLOW_FLOW = "slow_flow"
    FIT = "fit"
    PROFILE = "profile"


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

    def rate(self, kind: str) -> Rate:
        """Return the rate of its operations in a computation of a kind."""
        return RATES.get(self.rate_name(kind), _UNMEASURED)

    def rate_name(self, kind: str) -> str:
        """Return the name of its method in the table of rates."""
        if self.stage is Stage.SPECTRUM and self.method not in _OF_A_KIND:
            return f"{self.stage.name.lower()}, {self.method}"
        # What sweeps of impact modes share are responses, a part of the impulses elsewhere.
        shared = self.stage is Stage.RESPONSE and kind == "impact-modes"
        return f"{kind}: {(Stage.IMPULSE if shared else self.stage).name.lower()}, {self.method}"

    def seconds(self, kind: str) -> float:
        """Return its estimated time on one core in a computation of a kind."""
        if self.flops == 0.0:  # what it computes is known
            return 0.0
        own = self.rate(kind)
        return own.start + own.each * self.flops


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

    @property
    def seconds(self) -> float:
        """Estimated time on one core."""
        written = self.bytes / BYTES_PER_SECOND
        kind = self.of or self.kind
        own = RATES.get(kind, _UNMEASURED).start
        if not self.of:
            work = sum(step.seconds(self.kind) for step in self.steps)
            return OVERHEAD_SECONDS + own + work + written
        methods = {step.rate_name(kind): step.rate(kind) for step in self.steps}
        begun = own + sum(method.start for method in methods.values())
        work = sum(step.rate(kind).each * step.flops for step in self.steps)
        points = self.points * (SWEEP.point + SWEEP.begun * begun)
        return OVERHEAD_SECONDS + SWEEP.start + points + SWEEP.work * work + written


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
