"""What a computation of a thread costs its caller: the estimate is held, the use is charged."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import dataclass
from typing import TypeVar

from vibroimpact_service import problems
from vibroimpact_service.documents import limits, planning
from vibroimpact_service.documents.planning import Planned
from vibroimpact_service.documents.requests import Request
from vibroimpact_service.problems import ProblemError
from vibroimpact_solvers import meter
from vibroimpact_solvers.meter import StopSignal
from vibroimpact_solvers.plan import Plan

Value = TypeVar("Value")


async def _nothing(*_: object) -> None:
    """Charge nothing."""


@dataclass(frozen=True, slots=True)
class Admission:
    """Whether the caller may have a computation done.

    Parameters
    ----------
    charge : callable
        ``await charge(plan, seconds)`` charges a planned computation to the caller, and raises
        `ProblemError` where it costs too much.
    free : bool
        Whether `charge` does nothing for what is computed at once.
    settle : callable
        ``await settle(held, used)`` charges the processor time that a computation took in place
        of the time that `charge` held for it, seconds.
    account : str, optional
        Where jobs are charged what they used; absent: nowhere.
    """

    charge: Callable[[Plan, float], Awaitable[None]] = _nothing
    free: bool = False
    settle: Callable[[float, float], Coroutine[None, None, None]] = _nothing
    account: str | None = None


class Charge:
    """What is held for one computation, until the thread that computes it has ended.

    Parameters
    ----------
    admission : Admission
    held : float
        What was charged for it, seconds.
    goes_on : bool
        Whether a worker computes what does not succeed here: for that the estimate stays held.
    """

    def __init__(self, admission: Admission, held: float, *, goes_on: bool = False) -> None:
        self._admission, self._held, self._goes_on = admission, held, goes_on
        self._loop = asyncio.get_running_loop()
        self._begun = self._settled = False
        self._under_way: set[asyncio.Task[None]] = set()

    def measured(self, work: Callable[[StopSignal], Value]) -> Callable[[StopSignal], Value]:
        """Return the same work, whose processor time is charged when it ends, however it does."""

        def measured(signal: StopSignal) -> Value:
            self._begun, began, held = True, meter.processor_time(), self._held * self._goes_on
            try:
                value = work(signal)
                held = 0.0
                return value
            finally:
                used = meter.processor_time() - began + held
                if not self._loop.is_closed():
                    self._loop.call_soon_threadsafe(self._settle, used)

        return measured

    def give_back(self) -> None:
        """Charge nothing where the work did not begin: another computation has its result."""
        if not self._begun:
            self._settle(0.0)

    def _settle(self, used: float) -> None:
        if self._settled:
            return
        self._settled = True
        settling: asyncio.Task[None] = asyncio.ensure_future(self._settled_by(used))
        self._under_way.add(settling)
        settling.add_done_callback(self._under_way.discard)

    async def _settled_by(self, used: float) -> None:
        await self._admission.settle(self._held, used)


async def admit(request: Request, admission: Admission, planned: Planned) -> None:
    """Charge a planned computation to the caller.

    Raises
    ------
    ProblemError
        413 with the field that makes it long; 429 as of the admission.
    """
    try:
        await admission.charge(planned.plan, planned.seconds)
    except ProblemError as error:
        if error.type is not problems.TOO_COSTLY:
            raise
        where = planning.costly(request.kind, request.document)
        raise limits.too_costly(where, "too_costly", error.detail) from None
