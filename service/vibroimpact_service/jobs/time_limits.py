"""Time limits of transactions on a database server, kept by the server and by this process.

The server ends what waits, computes or idles too long. Where the network, or a proxy, swallows
everything without closing a connection, nothing comes from the server: this process then cuts it.
The server may lose the alarm by which it ends an idle transaction (seen in PostgreSQL 15.20, once
in hundreds of cut connections): its rows would stay locked, and its jobs queued, for ever. Any
other process of the service has the server end it.
"""

from __future__ import annotations

import os
import socket
import threading
import time
from contextlib import suppress
from functools import cache
from typing import Any, Final

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine
from sqlalchemy.exc import InvalidatePoolError

_IDLE_SECONDS: Final = 4
"""A process that stands still within a transaction keeps the others from their rows so long."""
_LOCK_SECONDS: Final = 6
_STATEMENT_SECONDS: Final = 8
_TRANSACTION_SECONDS: Final = 10.0
_PING_SECONDS: Final = 3.0
_CHECK_SECONDS: Final = 0.25
NAME: Final = "vibroimpact"
"""Name of the connections of the service, as the server lists them."""

_SERVER: Final = {
    "idle_in_transaction_session_timeout": _IDLE_SECONDS,
    "lock_timeout": _LOCK_SECONDS,
    "statement_timeout": _STATEMENT_SECONDS,
}
SERVER_LIMITS: Final = " ".join(f"-c {name}={seconds}s" for name, seconds in _SERVER.items())
"""Options of a connection that set the limits that the server keeps."""


def remove_limits(connection: Connection) -> None:
    """Let a transaction take as long as it needs."""
    for name in _SERVER:
        connection.execute(sa.text(f"SET LOCAL {name} = 0"))
    connection.execute(sa.text(f"SET LOCAL application_name = '{NAME} without limits'"))
    _limited.pop(connection.connection.dbapi_connection, None)


def end_forgotten(connection: Connection, seconds: float = 2.0 * _IDLE_SECONDS) -> int:
    """End the transactions of the service that have idled for some seconds; return their number."""
    if connection.dialect.name == "sqlite":
        return 0
    query = """
        SELECT pg_terminate_backend(pid) FROM pg_stat_activity
        WHERE state LIKE 'idle in transaction%' AND application_name = :name
        AND datname = current_database() AND usename = current_user
        AND state_change < clock_timestamp() - make_interval(secs => :seconds)
    """
    values = {"name": NAME, "seconds": seconds}
    return len(connection.execute(sa.text(query), values).all())


def limit_time(engine: Engine) -> None:
    """Cut connections of an engine that are in use for too long, and those that do not answer."""
    _start()

    @sa.event.listens_for(engine, "checkout")
    def begin(connection: Any, record: Any, _proxy: Any) -> None:
        if not record.info.pop("fresh", False):
            _limit(connection, _PING_SECONDS)
            try:
                _ping(connection)
            except connection.Error as error:
                _limited.pop(connection, None)
                raise InvalidatePoolError from error
        _limit(connection, _TRANSACTION_SECONDS)

    @sa.event.listens_for(engine, "connect")
    def connect(_connection: Any, record: Any) -> None:
        record.info["fresh"] = True

    for event in ("checkin", "invalidate", "close"):
        sa.event.listen(engine, event, lambda connection, *_: _limited.pop(connection, None))


def _ping(connection: Any) -> None:
    connection.autocommit = True  # one message instead of three
    connection.execute("")
    connection.autocommit = False


_limited: Final[dict[Any, float]] = {}
"""Connections in use, and when they are cut."""


def _limit(connection: Any, seconds: float) -> None:
    _limited[connection] = time.monotonic() + seconds


@cache
def _start() -> None:
    threading.Thread(target=_cut_late, name="time-limits", daemon=True).start()


def _cut_late() -> None:
    while True:
        time.sleep(_CHECK_SECONDS)
        now = time.monotonic()
        for connection, end in list(_limited.items()):
            if end < now and _limited.pop(connection, None) is not None:
                # The thread that waits for the server sees the end of the connection.
                with suppress(OSError, connection.Error), _socket(connection) as plain:
                    plain.shutdown(socket.SHUT_RDWR)


def _socket(connection: Any) -> socket.socket:
    return socket.socket(fileno=os.dup(connection.fileno()))
