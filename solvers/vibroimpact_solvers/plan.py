"""A plan: what will be computed, how and why, and what is skipped and why.

A plan is an immutable value. `plan(problem)` of a computation takes all decisions;
`solve(problem, plan)` follows them and takes none, so that a plan shown beforehand
cannot disagree with the work done afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Stage(StrEnum):
    """Stages of a computation, in the order in which they spoil one another."""

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
    FLIGHT = "flight"
    HISTORY = "history"
    SLOW_FLOW = "slow_flow"


@dataclass(frozen=True, slots=True)
class Step:
    """One thing that will be done.

    Parameters
    ----------
    stage : Stage
        What it yields.
    method : str
        Name of the method chosen.
    reason : str
        A sentence saying why this method.
    flops, bytes : float
        Estimated floating-point operations and memory written, all times together.
    count : int
        How often it is done; in sweeps, at how many members for what each member needs.
    """

    stage: Stage
    method: str
    reason: str
    flops: float = 0.0
    bytes: float = 0.0
    count: int = 1


@dataclass(frozen=True, slots=True)
class Skip:
    """One thing that will not be done: `what`, and the sentence `why`."""

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
        Problems that have to be made of a common one before they are solved, as in a sweep.
    """

    kind: str
    steps: tuple[Step, ...]
    skips: tuple[Skip, ...] = ()
    points: int = 0

    def step(self, stage: Stage) -> Step | None:
        """Return the step of a stage, or None where the plan has none."""
        return next((step for step in self.steps if step.stage is stage), None)

    @property
    def flops(self) -> float:
        """Estimated floating-point operations of all steps."""
        return sum(step.flops for step in self.steps)

    @property
    def bytes(self) -> float:
        """Estimated memory written by all steps."""
        return sum(step.bytes for step in self.steps)
