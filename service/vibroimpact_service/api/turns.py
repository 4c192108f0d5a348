"""Lets few requests begin in one turn of the event loop, so that nothing else waits for many."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Final

from starlette.types import ASGIApp, Receive, Scope, Send

AT_ONCE: Final = 16
"""Requests that begin in one turn: each takes up to a millisecond or two of the loop."""


class Turns:
    """A layer around an application.

    When hundreds of connections have a request at the same moment, the loop would serve all of
    them before it looks at its clocks and at what else is ready: events, heartbeats, health.
    Requests beyond the first few wait for later turns, in their order.

    Parameters
    ----------
    app : ASGI application
    at_once : int
        Requests that begin in one turn.
    """

    def __init__(self, app: ASGIApp, at_once: int = AT_ONCE) -> None:
        self._app, self._at_once = app, at_once
        self._room = at_once
        self._waiting: deque[asyncio.Future[None]] = deque()
        self._loop: asyncio.AbstractEventLoop | None = None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request in its turn."""
        if scope["type"] == "http":
            await self._begin()
        await self._app(scope, receive, send)

    async def _begin(self) -> None:
        loop = asyncio.get_running_loop()
        if loop is not self._loop:  # one after the other may run the application, as tests do
            self._loop, self._room = loop, self._at_once
            self._waiting.clear()
        if self._room == self._at_once:
            loop.call_soon(self._next_turn, loop)
        if self._room > 0:
            self._room -= 1
            return
        turn = loop.create_future()
        self._waiting.append(turn)
        await turn

    def _next_turn(self, loop: asyncio.AbstractEventLoop) -> None:
        """Let the next ones begin."""
        self._room = self._at_once
        while self._waiting and self._room > 0:
            turn = self._waiting.popleft()
            if not turn.done():  # nobody gave it up
                turn.set_result(None)
                self._room -= 1
        if self._room < self._at_once:
            loop.call_soon(self._next_turn, loop)
