"""Bounds how many requests begin in one turn of the event loop."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Final

AT_ONCE: Final = 16
"""Requests that begin in one turn: each takes up to a millisecond or two of the loop."""


class Pacing:
    """Lets a few requests begin in one turn of the event loop, the others later in their order.

    When hundreds of connections have a request at the same moment, the loop would serve all of
    them before it looks at its timers and at what else is ready: events, heartbeats, health.

    Parameters
    ----------
    at_once : int
        Requests that begin in one turn.
    """

    def __init__(self, at_once: int = AT_ONCE) -> None:
        self._at_once = at_once
        self._left = at_once
        self._waiting: deque[asyncio.Future[None]] = deque()
        self._loop: asyncio.AbstractEventLoop | None = None

    async def begin(self) -> None:
        """Wait for a turn in which another request may begin."""
        loop = asyncio.get_running_loop()
        if loop is not self._loop:  # one after the other may run the application, as tests do
            self._loop, self._left = loop, self._at_once
            self._waiting.clear()
        if self._left == self._at_once:
            loop.call_soon(self._next_turn, loop)
        if self._left > 0:
            self._left -= 1
            return
        turn = loop.create_future()
        self._waiting.append(turn)
        await turn

    def _next_turn(self, loop: asyncio.AbstractEventLoop) -> None:
        """Let the next requests begin."""
        self._left = self._at_once
        while self._waiting and self._left > 0:
            turn = self._waiting.popleft()
            if not turn.done():  # its request was not given up
                turn.set_result(None)
                self._left -= 1
        if self._left < self._at_once:
            loop.call_soon(self._next_turn, loop)
