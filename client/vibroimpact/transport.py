"""One request and its answer: addresses, timeouts, retries, and problems as exceptions."""

from __future__ import annotations

import random
import time
import uuid
from collections.abc import Mapping
from typing import Any

# httpx2 is the maintained successor of httpx, with the same interface.
import httpx2

from vibroimpact.errors import ConnectionFailed, from_problem

_AGAIN = frozenset({408, 429, 500, 502, 503, 504})
_TRIES = 4
_LONGEST_PAUSE = 120.0


class Transport:
    """Speaks HTTP to one service.

    Parameters
    ----------
    url : str
        Address of the service.
    timeout : float
        Longest wait for an answer, in seconds.
    transport : httpx2.BaseTransport, optional
        Where requests go instead of the network; for tests.
    """

    def __init__(
        self, url: str, timeout: float, transport: httpx2.BaseTransport | None = None
    ) -> None:
        limits = httpx2.Timeout(timeout, connect=5.0)
        self._http = httpx2.Client(base_url=url, timeout=limits, transport=transport)
        self.url = url

    def request(
        self,
        method: str,
        path: str,
        *,
        json: Any = None,
        params: Mapping[str, str] | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> httpx2.Response:
        """Send a request, again where that is safe, and return a good answer.

        Raises
        ------
        ConnectionFailed
            Where nobody answers.
        ServerError
            Where the answer is a problem.
        """
        sent = dict(headers or {})
        if method == "POST":
            # The same for all tries, so that the service does it once.
            sent.setdefault("Idempotency-Key", uuid.uuid4().hex)
        for turn in range(_TRIES):
            last = turn == _TRIES - 1
            try:
                answer = self._http.request(method, path, json=json, params=params, headers=sent)
            except httpx2.TransportError as error:
                if last:
                    message = f"no answer from {self.url}: {error}"
                    raise ConnectionFailed(message) from error
                time.sleep(_pause(turn, None))
                continue
            if answer.status_code not in _AGAIN or last or not _retryable(answer):
                break
            time.sleep(_pause(turn, answer.headers.get("Retry-After")))
        if answer.status_code >= 400:
            raise from_problem(_problem(answer))
        return answer

    def close(self) -> None:
        """Close the connections."""
        self._http.close()


def _pause(turn: int, asked: str | None) -> float:
    if asked is not None and asked.isdigit():
        return min(float(asked), _LONGEST_PAUSE)
    return min(8.0, 0.5 * 2.0**turn) * random.uniform(0.5, 1.0)


def _problem(answer: httpx2.Response) -> dict[str, Any]:
    try:
        problem = answer.json()
    except ValueError:
        problem = None
    if not isinstance(problem, dict):
        problem = {"detail": answer.text[:200]}
    return {"status": answer.status_code} | problem


def _retryable(answer: httpx2.Response) -> bool:
    return bool(_problem(answer).get("retryable", True))
