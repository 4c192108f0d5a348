"""HTTP connections with limits on the size of headers and on slow or stalled peers.

uvicorn has none of them, and a service may be reached without a proxy that has: what is promised
of such peers (docs/service/promises.md) is kept here.
"""

from __future__ import annotations

import asyncio
from asyncio.events import TimerHandle
from http import HTTPStatus
from typing import Any, Final

from uvicorn.config import Config
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol
from uvicorn.server import ServerState

from vibroimpact_service import problems
from vibroimpact_service.problems import ProblemError, Type
from vibroimpact_service.settings import Settings

_LINGER_SECONDS: Final = 1.0
_PROBE_SECONDS: Final = 0.25
_CONTINUE: Final = b"HTTP/1.1 100 Continue\r\n\r\n"
"""What a caller discards who is still there (RFC 9110, 15.2.1), and answers by a reset if not."""


class Connection(HttpToolsProtocol):
    """uvicorn's connection with limits against slow, endless or dead peers.

    uvicorn itself sets no time limit and no size limit for a header section, and no time limit
    for a peer that does not read its answer.
    """

    limits: Settings
    """Set by `connection`."""

    def __init__(
        self, config: Config, server_state: ServerState, app_state: dict[str, Any],
        _loop: asyncio.AbstractEventLoop | None = None,
    ) -> None:  # fmt: skip
        super().__init__(config, server_state, app_state, _loop)
        self._header_bytes = 0
        self._in_header, self._refused = True, False
        self._header_timer: TimerHandle | None = None
        self._stalled_timer: TimerHandle | None = None
        self._half_closed = False
        self._probe_timer: TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Accept a peer, unless there are too many."""
        super().connection_made(transport)
        if len(self.connections) > self.limits.max_connections:
            self._refuse(problems.UNAVAILABLE, "There are too many connections.")
            return
        self._await_header()

    def connection_lost(self, exc: Exception | None) -> None:
        """Cancel the timers."""
        self._stop(self._header_timer)
        self._stop(self._stalled_timer)
        self._stop(self._probe_timer)
        self._header_timer = self._stalled_timer = self._probe_timer = None
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Parse what arrived."""
        if self._refused or self.transport.is_closing():
            return
        if self._in_header:
            if self._header_timer is None:
                self._await_header()
            # Includes the rest of the previous section; pieces have at most 256 KiB.
            self._header_bytes += len(data)
        super().data_received(data)
        if self._in_header and self._header_bytes > self.limits.max_header_bytes:
            self._refuse_header()

    def eof_received(self) -> bool:  # type: ignore[override]
        """Close the connection, unless the peer has sent a whole request and may wait for its end.

        Whoever ends only its own side gets its answer. Who hung up sends the same, and is told
        apart by what it does with an interim answer.
        """
        cycle = self.cycle
        if self._refused or cycle is None or cycle.response_complete or cycle.more_body:
            return False
        if cycle.response_started and cycle.scope["method"] == "GET":
            return False  # an event stream would not end before it writes again
        self._half_closed = True
        self._probe()
        return True

    def on_response_complete(self) -> None:
        """Go on with the next request, or close where there can be none."""
        super().on_response_complete()
        if self._half_closed and self.cycle.response_complete:
            self.transport.close()

    def on_message_begin(self) -> None:
        """Begin a request."""
        self._in_header, self._header_bytes = True, 0
        super().on_message_begin()

    def on_headers_complete(self) -> None:
        """Pass the request on, unless its header section is too large."""
        self._in_header, self._header_bytes = False, 0
        self._stop(self._header_timer)
        self._header_timer = None
        size = len(self.url) + sum(len(name) + len(value) for name, value in self.headers)
        if size > self.limits.max_header_bytes:
            self._refuse_header()  # it came in one piece with its end
        elif not self._addressed():
            detail = "Host must stand once, and the address must be a path of that host."
            self._refuse(problems.BAD_REQUEST, detail)
        if not self._refused:
            super().on_headers_complete()

    def on_message_complete(self) -> None:
        """End a request; the next bytes belong to a header section."""
        if not self._refused:
            super().on_message_complete()
        self._in_header, self._header_bytes = True, 0

    def pause_writing(self) -> None:
        """Wait for the peer to read, for a limited time."""
        super().pause_writing()
        self._stop(self._stalled_timer)
        self._stalled_timer = self.loop.call_later(self.limits.body_seconds, self._stalled)

    def resume_writing(self) -> None:
        """Continue to send."""
        self._stop(self._stalled_timer)
        self._stalled_timer = None
        super().resume_writing()

    def send_400_response(self, msg: str) -> None:
        """Answer bytes that are not HTTP."""
        self._refuse(problems.BAD_REQUEST, "The bytes are not an HTTP/1.1 request.")

    def _addressed(self) -> bool:
        """Whether the request names one host: two readers could take two hosts for different ones.

        An absolute address would replace the Host field (RFC 9112, 3.2.2), which is checked.
        """
        hosts = [value for name, value in self.headers if name == b"host"]
        if len(hosts) != 1 and (hosts or self.parser.get_http_version() != "1.0"):
            return False
        if self.url.startswith(b"/") or self.url == b"*":
            return True
        scheme, _, rest = self.url.partition(b"://")
        authority = rest.partition(b"/")[0].partition(b"?")[0]
        return scheme.lower() in (b"http", b"https") and authority.lower() in map(
            bytes.lower, hosts
        )

    def _refuse_header(self) -> None:
        detail = f"The header is longer than {self.limits.max_header_bytes} bytes."
        self._refuse(problems.HEADER_TOO_LARGE, detail)

    def _await_header(self) -> None:
        self._header_timer = self.loop.call_later(self.limits.header_seconds, self._too_slow)

    def _too_slow(self) -> None:
        detail = f"The header took longer than {self.limits.header_seconds:g} s."
        self._refuse(problems.TIMEOUT, detail)

    def _probe(self) -> None:
        """Find out, by writing, whether a peer that sends no more still reads."""
        cycle = self.cycle
        if cycle.response_started or cycle.scope["http_version"] == "1.0":
            return
        self.transport.write(_CONTINUE)
        self._probe_timer = self.loop.call_later(_PROBE_SECONDS, self._probe)

    def _stalled(self) -> None:
        if self.transport is not None:
            self.transport.abort()

    def _refuse(self, type_: Type, detail: str) -> None:
        """Answer with a problem and close; further bytes of the peer are ignored."""
        if self._refused or self.transport.is_closing():
            return
        self._refused = True
        cycle = self.cycle
        under_way = cycle is not None and not cycle.response_complete
        if cycle is not None and under_way and not cycle.response_started and not self.pipeline:
            # The fault is in the body of this request: its handler gets no more of it.
            cycle.disconnected, under_way = True, False
            cycle.message_event.set()
        if not under_way:
            text = ProblemError(type_, detail).document("connection").model_dump_json().encode()
            head = (
                f"HTTP/1.1 {type_.status} {HTTPStatus(type_.status).phrase}\r\n"
                f"content-type: {problems.MEDIA_TYPE}\r\ncontent-length: {len(text)}\r\n"
                "cache-control: no-store\r\nconnection: close\r\n"
            )
            if type_.retryable:
                head += "retry-after: 1\r\n"
            self.transport.write(head.encode() + b"\r\n" + text)
        # If closed at once, with bytes of the peer unread, the answer would be lost.
        self.transport.write_eof()
        self._stop(self._stalled_timer)
        self._stalled_timer = self.loop.call_later(_LINGER_SECONDS, self._stalled)

    @staticmethod
    def _stop(timer: TimerHandle | None) -> None:
        if timer is not None:
            timer.cancel()


def connection(settings: Settings) -> type[Connection]:
    """Return the connection class of a service with these settings."""
    return type("BoundedConnection", (Connection,), {"limits": settings})
