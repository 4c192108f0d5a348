"""Sends what `conversations` yields, blocking or asynchronously, as often as it is allowed to."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Final

# httpx2 is the maintained successor of httpx, with the same interface.
import httpx2

from vibroimpact import conversations
from vibroimpact.cache import Cache
from vibroimpact.conversations import Conversation, GiveUp, NoAnswer, Outcome, Pause, Reply, Send

RETRIES: Final = 3
"""Repetitions of a request after temporary failures."""
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


def _plain(step: Send) -> dict[str, Any]:
    return {name: value for name, value in step.items() if name != "to"}


@contextmanager
def _unfinished(path: Path) -> Iterator[BinaryIO]:
    """Open a file that takes the place of another one when it has been written completely."""
    part = path.with_name(f"{path.name}.part")
    with part.open("wb") as file:
        yield file
    part.replace(path)


class Transport:
    """Blocking HTTP connection to one service; `transport` replaces the network in tests."""

    def __init__(
        self,
        url: str,
        timeout: float,
        transport: httpx2.BaseTransport | None = None,
        key: str | None = None,
        retries: int = RETRIES,
        cache: Cache | None = None,
    ) -> None:
        self._http = httpx2.Client(transport=transport, **_settings(url, timeout, key))
        self.url, self.cache, self._retries = url, cache, retries

    def hold(self, conversation: Conversation[Outcome]) -> Outcome:
        """Carry out a conversation and return its outcome."""
        reply: Reply = None
        try:
            while True:
                step = conversation.send(reply)
                if isinstance(step, Pause):
                    reply = GiveUp() if step.attempt > self._retries else None
                    if reply is None:
                        time.sleep(step.seconds)
                    continue
                try:
                    reply = self._send(step)
                except (httpx2.TransportError, ValueError) as error:
                    reply = _no_answer(self.url, step, error)
        except StopIteration as end:
            outcome: Outcome = end.value
            return outcome

    def _send(self, step: Send) -> httpx2.Response:
        if "to" not in step:
            return self._http.request(**_plain(step))
        with self._http.stream(**_plain(step)) as response:
            if not response.is_success:
                response.read()
                return response
            with _unfinished(step["to"]) as file:
                for piece in response.iter_bytes():
                    file.write(piece)
            return response

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
        retries: int = RETRIES,
        cache: Cache | None = None,
    ) -> None:
        self._http = httpx2.AsyncClient(transport=transport, **_settings(url, timeout, key))
        self.url, self.cache, self._retries = url, cache, retries

    async def hold(self, conversation: Conversation[Outcome]) -> Outcome:
        """Carry out a conversation and return its outcome."""
        reply: Reply = None
        try:
            while True:
                step = conversation.send(reply)
                if isinstance(step, Pause):
                    reply = GiveUp() if step.attempt > self._retries else None
                    if reply is None:
                        await asyncio.sleep(step.seconds)
                    continue
                try:
                    reply = await self._send(step)
                except (httpx2.TransportError, ValueError) as error:
                    reply = _no_answer(self.url, step, error)
        except StopIteration as end:
            outcome: Outcome = end.value
            return outcome

    async def _send(self, step: Send) -> httpx2.Response:
        if "to" not in step:
            return await self._http.request(**_plain(step))
        async with self._http.stream(**_plain(step)) as response:
            if not response.is_success:
                await response.aread()
                return response
            with _unfinished(step["to"]) as file:
                async for piece in response.aiter_bytes():
                    file.write(piece)
            return response

    async def close(self) -> None:
        """Close the connections."""
        await self._http.aclose()
