"""Estimated time of a plan on one core: measured rates for the operations of its steps.

`rates` has the constants, which ``python -m benchmarks.prices --calibrate`` writes. They are no
bounds: about half of the honest requests take between half and twice as long (the table is in
`docs/service/operation.md`), and what takes much longer is ended by the meter of the computation.
"""

from __future__ import annotations

from typing import Final

from vibroimpact_solvers.plan import Plan, Stage, Step
from vibroimpact_solvers.rates import RATES, SWEEP, Rate

BYTES_PER_SECOND: Final = 5.0e8
OVERHEAD_SECONDS: Final = 1e-4
_OF_A_KIND: Final = ("constrained structure", "partial")
"""Methods for natural modes that only one kind uses; the others take the same for all."""
_UNMEASURED: Final = Rate(0.0, 1e-9)
"""Of methods that no request of the calibration uses."""


def rate(kind: str, step: Step) -> Rate:
    """Return the rate of a step of a kind of computation."""
    return RATES.get(name(kind, step), _UNMEASURED)


def name(kind: str, step: Step) -> str:
    """Return the name of a method in the table of rates."""
    if step.stage is Stage.SPECTRUM and step.method not in _OF_A_KIND:
        return f"{step.stage.name.lower()}, {step.method}"
    # What sweeps of impact modes share are responses, which are a part of the impulses elsewhere.
    shared = step.stage is Stage.RESPONSE and kind == "impact-modes"
    return f"{kind}: {(Stage.IMPULSE if shared else step.stage).name.lower()}, {step.method}"


def step_seconds(kind: str, step: Step) -> float:
    """Return the estimated time of a step of a kind of computation."""
    if step.flops == 0.0:  # what it computes is known
        return 0.0
    own = rate(kind, step)
    return own.start + own.each * step.flops


def seconds(plan: Plan) -> float:
    """Return the estimated time of a plan on one core."""
    written = plan.bytes / BYTES_PER_SECOND
    kind = plan.of or plan.kind
    own = RATES.get(kind, _UNMEASURED).start
    if not plan.of:
        work = sum(step_seconds(plan.kind, step) for step in plan.steps)
        return OVERHEAD_SECONDS + own + work + written
    methods = {name(kind, step): rate(kind, step) for step in plan.steps}
    begun = own + sum(method.start for method in methods.values())
    work = sum(rate(kind, step).each * step.flops for step in plan.steps)
    points = plan.points * (SWEEP.point + SWEEP.begun * begun)
    return OVERHEAD_SECONDS + SWEEP.start + points + SWEEP.work * work + written
