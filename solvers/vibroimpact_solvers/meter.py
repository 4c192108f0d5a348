"""The meter of a computation, which every loop looks at.

A caller gives a tick, which may raise `Cancelled`: it stands for a stop signal and for limits of
time and memory. Loops deep inside a computation look at it by `look`, without being handed it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextvars import ContextVar
from functools import wraps
from typing import Final, TypeVar

from vibroimpact_solvers.plan import Plan, Tick

_Problem = TypeVar("_Problem")
_Result = TypeVar("_Result")

_SECONDS: Final = 0.004  # between two looks: loops may look as often as they like
_METER: ContextVar[Meter | None] = ContextVar("meter", default=None)


class Meter:
    """A tick that can be looked at without having got on.

    Parameters
    ----------
    tick : callable
    """

    def __init__(self, tick: Tick) -> None:
        self._tick, self._place, self._looked = tick, (0, 1), time.monotonic()

    def __call__(self, done: int, total: int) -> None:
        """Report progress."""
        self._place, self._looked = (done, total), time.monotonic()
        self._tick(done, total)

    def look(self) -> None:
        """Call the tick with the last progress, unless that was just now."""
        now = time.monotonic()
        if now - self._looked >= _SECONDS:
            self._looked = now
            self._tick(*self._place)


def look() -> None:
    """Look at the meter of the computation that runs in this thread; it may raise `Cancelled`."""
    meter = _METER.get()
    if meter is not None:
        meter.look()


def metered(
    solve: Callable[[_Problem, Plan, Tick | None], _Result],
) -> Callable[..., _Result]:
    """Let the tick of a computation be what `look` looks at, while it runs.

    A computation within another one that is given no tick is looked after by that of the other.
    """

    @wraps(solve)
    def solved(problem: _Problem, plan: Plan, tick: Tick | None = None) -> _Result:
        if tick is None:
            return solve(problem, plan, None)
        meter = Meter(tick)
        before = _METER.set(meter)
        try:
            return solve(problem, plan, meter)
        finally:
            _METER.reset(before)

    return solved
