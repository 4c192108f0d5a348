"""HTTP load: clients in a process of their own, each with one connection.

``python -m benchmarks.service.load`` reads a `Load` as JSON from its standard input, puts it on a
server and writes the `Outcome` to its standard output.
"""

from __future__ import annotations

import asyncio
import itertools
import json
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Final

import numpy as np
import uvloop

from benchmarks.service.requests import Request

_PATIENCE: Final = 60.0  # seconds for one answer
_LARGEST: Final = 2**26  # bytes of an answer


@dataclass(frozen=True, slots=True)
class Load:
    """Clients and what they send.

    Parameters
    ----------
    url : str
    requests : tuple of Request
        Each client sends them one after the other, and begins anew.
    clients : int
    seconds : float
        After which no client sends a new request.
    first : int
        The first number of a request; the others follow it.
    jobs : int
        Where it is not zero: the requests submit jobs, and each client waits for so many of
        them before it submits the next ones. An answer is then a job that has succeeded.
    """

    url: str
    requests: tuple[Request, ...]
    clients: int = 1
    seconds: float = 2.0
    first: int = 1
    jobs: int = 0


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a load brought.

    Parameters
    ----------
    statuses : mapping
        Numbers of answers by their status.
    errors : int
        Connections that broke, and jobs that failed.
    seconds, p50, p99 : float
        From the first request to the last answer, and from each request to its answer.
    sent : int
        How many numbers were used.
    """

    statuses: Mapping[str, int]
    errors: int
    seconds: float
    p50: float
    p99: float
    sent: int

    @property
    def answers(self) -> int:
        """Number of all answers."""
        return sum(self.statuses.values())

    def proper(self) -> Outcome:
        """Return the outcome itself, whose answers must have the status 200 or 304.

        Raises
        ------
        RuntimeError
        """
        if self.errors or not self.statuses.keys() <= {"200", "304"}:
            raise RuntimeError(f"statuses {dict(self.statuses)}, errors {self.errors}")
        return self


def run(load: Load) -> Outcome:
    """Put a load on a server, from a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.service.load"],
        input=json.dumps(asdict(load)),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(done.stderr[-2000:])
    return Outcome(**json.loads(done.stdout))


class _Connection:
    """A connection that takes one request after the other."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer

    @classmethod
    async def to(cls, url: str) -> _Connection:
        """Connect to a server."""
        host, _, port = url.removeprefix("http://").partition(":")
        return cls(*await asyncio.open_connection(host, int(port), limit=_LARGEST))

    async def ask(self, request: bytes) -> tuple[int, bytes]:
        """Return status and body of the answer."""
        self._writer.write(request)
        async with asyncio.timeout(_PATIENCE):
            head = (await self._reader.readuntil(b"\r\n\r\n")).lower()
            status = int(head[9:12])
            if status == 304:
                return status, b""
            if b"transfer-encoding: chunked" in head:
                return status, await self._reader.readuntil(b"0\r\n\r\n")
            _, _, length = head.partition(b"\r\ncontent-length:")
            return status, await self._reader.readexactly(int(length.split(b"\r\n", 1)[0] or 0))


class _Clients:
    """All clients of a load, and what they have seen."""

    def __init__(self, load: Load) -> None:
        self._load = load
        self._numbers: Iterator[int] = itertools.count(load.first)
        self._statuses: Counter[str] = Counter()
        self._latencies: list[float] = []
        self._errors = 0

    async def outcome(self) -> Outcome:
        """Run the clients until their time is over."""
        started = time.perf_counter()
        self._end = started + self._load.seconds
        await asyncio.gather(*(self._client(place) for place in range(self._load.clients)))
        spent = time.perf_counter() - started
        p50, p99 = map(float, np.percentile(self._latencies or [0.0], [50, 99]))
        sent = next(self._numbers) - self._load.first
        return Outcome(dict(self._statuses), self._errors, spent, p50, p99, sent)

    async def _client(self, place: int) -> None:
        requests = self._load.requests
        turns = itertools.cycle(
            [*requests[place % len(requests) :], *requests[: place % len(requests)]]
        )
        connection = await _Connection.to(self._load.url)
        while time.perf_counter() < self._end:
            try:
                if self._load.jobs:
                    await self._jobs(connection, turns)
                else:
                    await self._answer(connection, next(turns))
            except (OSError, EOFError):
                self._errors += 1
                connection = await _Connection.to(self._load.url)

    async def _answer(self, connection: _Connection, request: Request) -> bytes:
        encoded = request.encoded(next(self._numbers))
        started = time.perf_counter()
        status, body = await connection.ask(encoded)
        self._latencies.append(time.perf_counter() - started)
        self._statuses[str(status)] += 1
        return body

    async def _jobs(self, connection: _Connection, turns: Iterator[Request]) -> None:
        """Submit some jobs, then wait for each."""
        submitted = []
        for request in itertools.islice(turns, self._load.jobs):
            encoded = request.encoded(next(self._numbers))
            started = time.perf_counter()
            status, body = await connection.ask(encoded)
            if status == 201:
                submitted.append((json.loads(body)["id"], started))
            else:
                self._statuses[str(status)] += 1
        for job, started in submitted:
            look = Request("GET", f"/v1/jobs/{job}?wait=20").encoded(0)
            final = False
            while not final:
                _, body = await connection.ask(look)
                document = json.loads(body)
                final = document["final"]
            self._latencies.append(time.perf_counter() - started)
            if document["state"] == "succeeded":
                self._statuses["200"] += 1
            else:
                self._errors += 1


def main() -> None:
    """Run the load that is described on the standard input."""
    document = json.load(sys.stdin)
    requests = tuple(Request(**request) for request in document.pop("requests"))
    load = Load(requests=requests, **document)
    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        outcome = runner.run(_Clients(load).outcome())
    json.dump(asdict(outcome), sys.stdout)


if __name__ == "__main__":
    main()
