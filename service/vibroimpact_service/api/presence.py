"""Work that ends when the caller has gone."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable
from typing import Any, Final, TypeVar

from starlette.requests import ClientDisconnect, Request

Value = TypeVar("Value")

_UNWATCHED_SECONDS: Final = 0.02
"""Time in which most work is done; until then nobody looks whether the caller is there."""


async def while_connected(request: Request, work: Awaitable[Value]) -> Value:
    """Return what an awaitable returns; the body of the request was read before.

    Raises
    ------
    ClientDisconnect
        Where the caller went away first; the awaitable is cancelled then.
    """
    task = asyncio.current_task()
    assert task is not None
    watch = _Watch(request, task)
    timer = asyncio.get_running_loop().call_later(_UNWATCHED_SECONDS, watch.begin)
    try:
        return await work
    except asyncio.CancelledError:
        if watch.has_left and task.uncancel() == 0:
            raise ClientDisconnect from None
        raise
    finally:
        timer.cancel()
        watch.end()


class _Watch:
    """Cancels a task when the caller of its request has gone."""

    def __init__(self, request: Request, task: asyncio.Task[Any]) -> None:
        self._request, self._task = request, task
        self._watching: asyncio.Task[None] | None = None
        self.has_left = False

    def begin(self) -> None:
        """Look from now on."""
        self._watching = asyncio.ensure_future(self._watch())

    def end(self) -> None:
        """Look no more."""
        if self._watching is not None:
            self._watching.cancel()

    async def _watch(self) -> None:
        while (await self._request.receive())["type"] != "http.disconnect":
            continue
        self.has_left = True
        self._task.cancel()
