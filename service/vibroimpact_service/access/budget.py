"""Rate limits and computing quotas of callers, and the headers that state what is left.

Attempts without a valid key are counted by address.
"""

from __future__ import annotations

import math
import time
from typing import Final

from limits import RateLimitItemPerHour, RateLimitItemPerMinute
from limits.aio.storage import SlidingWindowCounterSupport, Storage
from limits.aio.strategies import SlidingWindowCounterRateLimiter
from limits.limits import RateLimitItem
from limits.storage import storage_from_string

from vibroimpact_service import problems
from vibroimpact_service.access.caller import Caller
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings
from vibroimpact_solvers.plan import Plan

_MILLI: Final = 1000
_UNLIMITED: Final = 2**53
"""A limit that no difference passes: what was used is charged whether or not it is left."""
_COMPUTING: Final = RateLimitItemPerHour(1, 1, "compute")
"""What the milliseconds of a caller are counted as, whatever limit the caller has."""
_HOUR: Final = float(_COMPUTING.get_expiry())
_FAILED_KEYS: Final = RateLimitItemPerMinute(60, 1, "failures")


class Budget:
    """Counts requests and planned computing of callers over sliding windows.

    Parameters
    ----------
    settings : Settings
        With the longest computation, and where to count: in this process, or in a Redis that
        replicas share.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        storage = storage_from_string(f"async+{settings.limits_storage}")
        assert isinstance(storage, Storage)
        assert isinstance(storage, SlidingWindowCounterSupport)
        self._storage: SlidingWindowCounterSupport = storage
        self._windows = SlidingWindowCounterRateLimiter(storage)

    async def count(self, caller: Caller) -> dict[str, str]:
        """Count a request; return the headers that state what is left.

        Raises
        ------
        ProblemError
            429 if there were too many.
        """
        most = caller.requests_per_minute
        if most is None:
            return {}
        window = RateLimitItemPerMinute(most, 1, "requests")
        admitted = await self._windows.hit(window, caller.name)
        headers, wait, _ = await self._headers("requests", "requests", window, most, caller.name, 1)
        if admitted:
            return headers
        headers["Retry-After"] = str(wait)
        detail = f"More than {most} requests in a minute; ask again in {wait} s."
        raise ProblemError(problems.TOO_MANY, detail, headers=headers)

    async def spend(self, caller: Caller, plan: Plan, seconds: float) -> dict[str, str]:
        """Hold the planned cost of a computation; return the headers that state what is left.

        `settle` charges what it took instead, when it has ended.

        Raises
        ------
        ProblemError
            413 if it is more than one computation may cost, 429 if it is more than is left.
        """
        cost = (
            f"The plan costs about {seconds:.3g} s, {plan.flops:.3g} flops "
            f"and {plan.bytes:.3g} bytes"
        )
        longest = self._settings.max_job_seconds
        if seconds > longest:
            detail = f"{cost}; a single computation may cost {longest:g} s."
            raise ProblemError(problems.TOO_COSTLY, detail)
        most = caller.seconds_per_hour
        if most is None:
            return {}
        if seconds > most:
            detail = f"{cost}; this key has {most:g} s per hour."
            raise ProblemError(problems.TOO_COSTLY, detail)
        limit, milliseconds = max(1, round(_MILLI * most)), _milliseconds(seconds)
        admitted = await self._add(caller.name, milliseconds, limit)
        headers, wait, left = await self._headers(
            "compute", "ms", _COMPUTING, limit, caller.name, milliseconds
        )
        if admitted:
            return headers
        headers["Retry-After"] = str(wait)
        detail = (
            f"{cost}; {left / _MILLI:g} s are left of {most:g} s per hour. Ask again in {wait} s."
        )
        raise ProblemError(problems.QUOTA_SPENT, detail, headers=headers)

    async def settle(self, account: str, held: float, used: float, age: float = 0.0) -> None:
        """Charge what a computation took in place of what `spend` held for it.

        Parameters
        ----------
        account : str
            Name of the caller.
        held, used : float
            Planned time, and processor time of the computation, seconds; either may be 0.
        age : float
            Seconds since it was held: at least so much of it counts as remains of the hour, and no
            more than that is given back.
        """
        counted = max(0.0, 1.0 - age / _HOUR)
        difference = _milliseconds(used) - int(_milliseconds(held) * counted)
        if difference:
            await self._add(account, difference, _UNLIMITED)

    async def _add(self, account: str, milliseconds: int, limit: int) -> bool:
        """Count computing; whether it fits the limit, without which it is not counted."""
        key, length = _COMPUTING.key_for(account), _COMPUTING.get_expiry()
        return await self._storage.acquire_sliding_window_entry(key, limit, length, milliseconds)

    async def count_failed_key(self, address: str) -> None:
        """Count a request without a valid key from an address.

        Raises
        ------
        ProblemError
            429 if there were too many.
        """
        if not await self._windows.hit(_FAILED_KEYS, address):
            stats = await self._windows.get_window_stats(_FAILED_KEYS, address)
            wait = _whole(stats.reset_time - time.time())
            detail = f"Too many requests without a valid key; ask again in {wait} s."
            raise ProblemError(problems.TOO_MANY, detail, headers={"Retry-After": str(wait)})

    async def _headers(
        self, name: str, unit: str, window: RateLimitItem, most: int, caller: str, cost: int
    ) -> tuple[dict[str, str], int, int]:
        """Return the headers RateLimit, the seconds until a cost fits, and what is left."""
        length = window.get_expiry()
        counts = await self._storage.get_sliding_window(window.key_for(caller), length)
        before, before_left, here, here_left = counts
        left = max(0, most - math.floor(before * before_left / length + here))
        wait = _wait(cost, most, length, before, before_left, here, here_left - length)
        headers = {
            "RateLimit": f'"{name}";r={left};t={wait}',
            "RateLimit-Policy": f'"{name}";q={most};w={length};qu="{unit}"',
        }
        return headers, wait, left


def _milliseconds(seconds: float) -> int:
    return math.ceil(_MILLI * seconds)


def _wait(
    cost: int, most: int, length: float, before: float, before_left: float, here: float, rest: float
) -> int:
    """Return the seconds until a cost fits a sliding window.

    The count of the previous window fades linearly; that of this window begins to fade when
    it ends, in `rest` seconds.
    """
    excess = before * before_left / length + here + cost - most
    if excess <= 0:
        return _whole(rest)
    if before * before_left / length >= excess:
        return _whole(excess * length / before)
    fading = length * (1.0 - (most - cost) / here) if here else 0.0
    return _whole(rest + max(0.0, fading))


def _whole(seconds: float) -> int:
    return max(1, math.ceil(seconds - 1e-6))
