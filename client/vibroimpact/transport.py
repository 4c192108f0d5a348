"""Sends what `conversations` yields, blocking or asynchronously; retries are decided there."""

from __future__ import annotations

import asyncio
import time
from typing import Any

# httpx2 is the maintained successor of httpx, with the same interface.
import httpx2

from vibroimpact import conversations
from vibroimpact.conversations import Conversation, NoAnswer, Outcome, Pause, Reply, Send

_CONNECT_SECONDS = 5.0


def _settings(url: str, timeout: float, key: str | None) -> dict[str, Any]:
    headers = {} if key is None else {"Authorization": f"Bearer {key}"}
    limits = httpx2.Timeout(timeout, connect=_CONNECT_SECONDS)
    return {"base_url": url, "timeout": limits, "headers": headers}


def _no_answer(url: str, step: Send, error: Exception) -> NoAnswer:
    """Return what a conversation receives after a network error; raise if nothing was sent."""
    if isinstance(error, httpx2.TransportError):
        return NoAnswer(url, error)
    # The request cannot be written as JSON, so that nothing was sent.
    raise conversations.not_finite(step["json"]) or error from None


class Transport:
    """Blocking HTTP connection to one service; `transport` replaces the network in tests."""

    def __init__(
        self,
        url: str,
        timeout: float,
        transport: httpx2.BaseTransport | None = None,
        key: str | None = None,
    ) -> None:
        self._http = httpx2.Client(transport=transport, **_settings(url, timeout, key))
        self.url = url

    def hold(self, conversation: Conversation[Outcome]) -> Outcome:
        """Carry out a conversation and return its outcome."""
        reply: Reply = None
        try:
            while True:
                step = conversation.send(reply)
                if isinstance(step, Pause):
                    time.sleep(step.seconds)
                    reply = None
                    continue
                try:
                    reply = self._http.request(**step)
                except (httpx2.TransportError, ValueError) as error:
                    reply = _no_answer(self.url, step, error)
        except StopIteration as end:
            outcome: Outcome = end.value
            return outcome

    def close(self) -> None:
        """Close the connections."""
        self._http.close()


class AsyncTransport:
    """Asynchronous HTTP connection to one service; see `Transport`."""

    def __init__(
        self,
        url: str,
        timeout: float,
        transport: httpx2.AsyncBaseTransport | None = None,
        key: str | None = None,
    ) -> None:
        self._http = httpx2.AsyncClient(transport=transport, **_settings(url, timeout, key))
        self.url = url

    async def hold(self, conversation: Conversation[Outcome]) -> Outcome:
        """Carry out a conversation and return its outcome."""
        reply: Reply = None
        try:
            while True:
                step = conversation.send(reply)
                if isinstance(step, Pause):
                    await asyncio.sleep(step.seconds)
                    reply = None
                    continue
                try:
                    reply = await self._http.request(**step)
                except (httpx2.TransportError, ValueError) as error:
                    reply = _no_answer(self.url, step, error)
        except StopIteration as end:
            outcome: Outcome = end.value
            return outcome

    async def close(self) -> None:
        """Close the connections."""
        await self._http.aclose()
