"""Connections of slow, endless and odd peers, over real sockets."""

from __future__ import annotations

import asyncio
import json
import re
import threading
import time
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
import uvicorn

from vibroimpact_service.app import create_app
from vibroimpact_service.connection import connection
from vibroimpact_service.documents import planning
from vibroimpact_service.settings import Settings

Talk = Callable[[int], Coroutine[Any, Any, None]]
GET = b"GET /v1/health/live HTTP/1.1\r\nHost: localhost\r\n"


@pytest.fixture
def serve(settings: Settings, queue: Any) -> Callable[..., None]:
    """Return the function that serves while somebody talks to a port."""

    def run(talk: Talk, **limits: Any) -> None:
        chosen = settings.model_copy(update={"hosts": ("localhost",), **limits})

        async def both() -> None:
            app, bounded = create_app(chosen, queue), connection(chosen)
            config = uvicorn.Config(app, port=0, http=bounded, log_config=None, ws="none")
            server = uvicorn.Server(config)
            serving = asyncio.create_task(server.serve())
            while not server.started:
                await asyncio.sleep(0.01)
            try:
                await asyncio.wait_for(talk(server.servers[0].sockets[0].getsockname()[1]), 60)
            finally:
                server.should_exit = True
                await serving

        asyncio.run(both())

    return run


async def said(reader: asyncio.StreamReader) -> tuple[int, dict[str, Any]]:
    """Return status and problem of an answer that ends with the connection."""
    text = await reader.read()
    head, _, body = text.partition(b"\r\n\r\n")
    assert b"application/problem+json" in head, text
    return int(head.split()[1]), json.loads(body)


def test_a_header_that_does_not_end_in_time(serve: Any) -> None:
    async def talk(port: int) -> None:
        for opening in (b"", b"GET /a", GET + b"A: "):
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(opening)
            for _ in range(3):
                await asyncio.sleep(0.1)
                writer.write(b"a" if opening else b"")
            status, problem = await said(reader)
            assert (status, problem["code"]) == (408, "timeout")
            writer.close()

    serve(talk, header_seconds=2.0)


def test_a_second_header_on_the_same_connection_is_timed_too(serve: Any) -> None:
    async def talk(port: int) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(GET + b"\r\n")
        head = await reader.readuntil(b"\r\n\r\n")
        length = re.search(rb"content-length: (\d+)", head, re.IGNORECASE)
        assert length is not None
        await reader.readexactly(int(length[1]))
        writer.write(b"GET /v1/he")
        status, _ = await said(reader)
        assert status == 408
        writer.close()

    serve(talk, header_seconds=2.0)


@pytest.mark.parametrize("pieces", [1, 50])
def test_a_header_that_is_too_long(serve: Any, pieces: int) -> None:
    async def talk(port: int) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        text = GET + b"".join(b"A%d: %s\r\n" % (i, b"x" * 100) for i in range(100)) + b"\r\n"
        size = len(text) // pieces + 1
        for start in range(0, len(text), size):
            writer.write(text[start : start + size])
            await asyncio.sleep(0.005)
        status, problem = await said(reader)
        assert (status, problem["code"]) == (431, "header_too_large")
        writer.close()

    serve(talk, max_header_bytes=4096)


def test_a_long_body_is_no_long_header(serve: Any) -> None:
    async def talk(port: int) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        body = b" " * 100_000 + b"{}"
        writer.write(
            b"POST /v1/systems HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
            b"Connection: close\r\nContent-Length: %d\r\n\r\n%s" % (len(body), body)
        )
        status, _ = await said(reader)
        assert status == 422
        writer.close()

    serve(talk, max_header_bytes=4096)


def _is_refused(serve: Any, text: bytes) -> None:
    """Check that what is sent is answered as a bad request."""

    async def talk(port: int) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(text)
        status, problem = await said(reader)
        assert (status, problem["code"]) == (400, "bad_request")
        writer.close()

    serve(talk)


@pytest.mark.parametrize(
    "text",
    [
        b"hello\r\n\r\n", b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", b"GET\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: -1\r\n\r\n",
        b"POST / HTTP/1.1\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost : localhost\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n",
        b"GET / HTTP/1.1\r\nA: \x00\r\n\r\n",
    ],
)  # fmt: skip
def test_what_is_not_http(serve: Any, text: bytes) -> None:
    _is_refused(serve, text)


@pytest.mark.parametrize(
    "text",
    [
        b"GET /v1/version HTTP/1.1\r\nHost: localhost\r\nHost: elsewhere.example\r\n\r\n",
        b"GET /v1/version HTTP/1.1\r\nHost: localhost\r\nhost: localhost\r\n\r\n",
        b"GET /v1/version HTTP/1.1\r\n\r\n",
        b"GET http://elsewhere.example/v1/version HTTP/1.1\r\nHost: localhost\r\n\r\n",
        b"GET ftp://localhost/v1/version HTTP/1.1\r\nHost: localhost\r\n\r\n",
        b"CONNECT elsewhere.example:443 HTTP/1.1\r\nHost: localhost\r\n\r\n",
    ],
)
def test_a_request_that_does_not_name_one_host(serve: Any, text: bytes) -> None:
    _is_refused(serve, text)


@pytest.mark.parametrize(
    "text",
    [
        b"GET http://LOCALHOST/v1/version HTTP/1.1\r\nHost: localhost\r\n",
        b"GET /v1/version?a=http://elsewhere.example/ HTTP/1.1\r\nHost: localhost\r\n",
    ],
)
def test_an_absolute_address_of_this_host(serve: Any, text: bytes) -> None:
    async def talk(port: int) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(text + b"Connection: close\r\n\r\n")
        assert (await reader.readline()).split()[1] == b"200"
        writer.close()

    serve(talk)


@pytest.mark.parametrize("pause", [0.0, 0.1], ids=["at once", "later"])
def test_a_chunk_without_a_size(serve: Any, pause: float) -> None:
    async def talk(port: int) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(
            b"POST /v1/systems HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
            b'Transfer-Encoding: chunked\r\n\r\n5\r\n{"pre\r\n'
        )
        await asyncio.sleep(pause)
        writer.write(b"none\r\n{}\r\n0\r\n\r\n")
        status, problem = await said(reader)
        assert (status, problem["code"]) == (400, "bad_request")
        writer.close()

    serve(talk)


def test_a_body_that_does_not_come(serve: Any) -> None:
    async def talk(port: int) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(
            b"POST /v1/systems HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
            b'Content-Length: 100\r\n\r\n{"pre'
        )
        status, problem = await said(reader)
        assert (status, problem["code"]) == (408, "timeout")
        writer.close()

    serve(talk, body_seconds=0.3)


def test_a_peer_that_does_not_read_is_dropped(serve: Any) -> None:
    async def talk(port: int) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1024)
        for _ in range(400):  # some 70 kB each
            writer.write(b"GET /openapi.json HTTP/1.1\r\nHost: localhost\r\n\r\n")
        await asyncio.sleep(2.0)
        with pytest.raises((ConnectionError, asyncio.IncompleteReadError)):
            await reader.readexactly(2**30)
        writer.transport.abort()
        await asyncio.sleep(0.1)

    serve(talk, body_seconds=0.5)


def test_too_many_connections(serve: Any) -> None:
    async def talk(port: int) -> None:
        held = [await asyncio.open_connection("127.0.0.1", port) for _ in range(3)]
        await asyncio.sleep(0.1)
        reader, last = await asyncio.open_connection("127.0.0.1", port)
        status, problem = await said(reader)
        assert (status, problem["retryable"]) == (503, True)
        for _, writer in [*held, (reader, last)]:
            writer.close()
        await asyncio.sleep(0.1)
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(GET + b"\r\n")
        assert b"200" in await reader.readline()
        writer.close()

    serve(talk, max_connections=3)


@pytest.mark.parametrize("version", ["1.0", "1.1"])
def test_who_ends_only_its_own_side_is_answered(
    serve: Any, monkeypatch: pytest.MonkeyPatch, version: str
) -> None:
    begun, go = threading.Event(), threading.Event()
    plan = planning.plan

    def waiting(*given: Any) -> Any:
        begun.set()
        assert go.wait(20)
        return plan(*given)

    monkeypatch.setattr(planning, "plan", waiting)
    limited = {"preset": "chain", "n": 3, "constraints": [{"dof": 0, "gap": 0.2}]}
    body = json.dumps({"system": limited, "frequency": {"values": [1.0]}}).encode()

    async def talk(port: int) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(
            b"POST /v1/plan/impact-modes HTTP/%s\r\nHost: localhost\r\n"
            b"Content-Type: application/json\r\nContent-Length: %d\r\n\r\n%s"
            % (version.encode(), len(body), body)
        )
        assert await asyncio.to_thread(begun.wait, 10)
        writer.write_eof()
        await asyncio.sleep(0.6)
        go.set()
        text = await reader.read()  # to the end: the connection is closed after the answer
        interim, _, answer = text.rpartition(b"HTTP/1.1 200")
        assert json.loads(answer.partition(b"\r\n\r\n")[2])["kind"] == "impact-modes"
        assert set(interim.split(b"\r\n\r\n")) <= {b"HTTP/1.1 100 Continue", b""}
        assert (version == "1.0") == (interim == b"")  # which knows no interim answers
        writer.close()

    serve(talk)


def test_half_of_a_request_is_not_waited_for(serve: Any) -> None:
    async def talk(port: int) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(
            b"POST /v1/plan/impact-modes HTTP/1.1\r\nHost: localhost\r\n"
            b"Content-Type: application/json\r\nContent-Length: 100\r\n\r\n{"
        )
        await asyncio.sleep(0.1)
        writer.write_eof()
        async with asyncio.timeout(10):
            assert await reader.read() == b""
        writer.close()

    serve(talk)


@pytest.mark.parametrize("reset", [True, False], ids=["reset", "closed"])
@pytest.mark.parametrize("path", ["/v1/plan/impact-modes", "/v1/compute/impact-modes", "/v1/jobs"])
def test_a_plan_ends_when_its_caller_hangs_up(
    serve: Any, monkeypatch: pytest.MonkeyPatch, path: str, reset: bool
) -> None:
    stopped, begun = threading.Event(), threading.Event()

    def endless(*given: Any) -> None:
        begun.set()
        try:
            while True:
                time.sleep(0.005)
                given[-1](0, 1)
        finally:
            stopped.set()

    monkeypatch.setattr(planning, "plan", endless)
    limited = {"preset": "chain", "n": 3, "constraints": [{"dof": 0, "gap": 0.2}]}
    content: dict[str, Any] = {"system": limited, "frequency": {"values": [1.0]}}
    if path == "/v1/jobs":
        content = {"kind": "impact-modes", "request": content}
    body = json.dumps(content)

    async def talk(port: int) -> None:
        _, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(
            b"POST %s HTTP/1.1\r\nHost: localhost\r\n"
            b"Content-Type: application/json\r\nContent-Length: %d\r\n\r\n%s"
            % (path.encode(), len(body), body.encode())
        )
        assert await asyncio.to_thread(begun.wait, 10)
        assert not await asyncio.to_thread(stopped.wait, 0.2)
        if reset:
            writer.transport.abort()
        else:
            writer.close()
        assert await asyncio.to_thread(stopped.wait, 5)

    serve(talk)
