"""Messages to users' own servers when their jobs end, signed according to Standard Webhooks."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import hmac
import http.client
import ipaddress
import json
import socket
import ssl
import time
from typing import Any, Final
from urllib.parse import urlsplit

import sqlalchemy as sa
import structlog
from sqlalchemy.engine import Connection

from vibroimpact_service.jobs.database import now
from vibroimpact_service.jobs.record_access import RecordAccess
from vibroimpact_service.jobs.tables import FINAL, JobRow, jobs, row, webhooks
from vibroimpact_service.settings import Settings

log = structlog.get_logger("vibroimpact.webhooks")

_POLL_SECONDS: Final = 1.0
_AT_ONCE: Final = 16
_TIMEOUT: Final = 10.0
_DELAYS: Final = (5.0, 30.0, 120.0, 600.0, 3600.0, 4 * 3600.0, 12 * 3600.0)
"""Pauses between attempts; after the last one the message is given up."""


class RefusedError(ValueError):
    """Nothing is sent to the address: it is not https, or lies in a private network."""


class Webhooks:
    """Sends the messages that are due. Each is sent by one replica at a time.

    A message can arrive twice, where a replica dies between sending and recording it: receivers
    recognise it by ``webhook-id``, which is the id of the job.
    """

    def __init__(self, settings: Settings, records: RecordAccess) -> None:
        self._private = settings.webhook_private
        self._trust = ssl.create_default_context(
            cafile=None if settings.webhook_ca is None else str(settings.webhook_ca)
        )
        self._records = records

    async def loop(self) -> None:
        """Send messages until cancelled."""
        while True:
            await asyncio.sleep(_POLL_SECONDS)
            try:
                if await self._records.read(_any_due):
                    due = await self._records.write(_take)
                    await asyncio.gather(*(asyncio.to_thread(self._deliver, *each) for each in due))
            except ConnectionError as error:
                log.warning("messages have to wait", error=str(error))
            except Exception:
                log.exception("sending failed")

    def _deliver(self, job: JobRow, url: str, secret: str, attempts: int) -> None:
        body = json.dumps(_message(job)).encode()
        try:
            status = send(url, headers(job.id, secret, body), body, self._trust, self._private)
        except RefusedError as error:
            log.warning("message refused", job=job.id, error=str(error))
            self._records.write_now(_delete, job.id)
            return
        except (OSError, http.client.HTTPException) as error:
            log.info("message not delivered", job=job.id, error=type(error).__name__)
            status = 0
        if 200 <= status < 300 or status == http.client.GONE or attempts > len(_DELAYS):
            self._records.write_now(_delete, job.id)


def _message(job: JobRow) -> dict[str, Any]:
    finished = job.finished or 0.0
    return {
        "type": f"job.{job.state}",
        "timestamp": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(finished)),
        "data": {
            "id": job.id,
            "kind": job.kind,
            "state": job.state,
            "digest": job.result,
            "job": f"/v1/jobs/{job.id}",
            "error": job.error,
        },
    }


def headers(identity: str, secret: str, body: bytes, moment: int | None = None) -> dict[str, str]:
    """Return the headers that authenticate a message: HMAC-SHA256 of ``id.time.body``."""
    stamp = str(int(time.time()) if moment is None else moment)
    key = base64.b64decode(secret.removeprefix("whsec_"))
    content = b".".join((identity.encode(), stamp.encode(), body))
    signature = base64.b64encode(hmac.new(key, content, hashlib.sha256).digest()).decode()
    return {
        "content-type": "application/json",
        "user-agent": "vibroimpact",
        "webhook-id": identity,
        "webhook-timestamp": stamp,
        "webhook-signature": f"v1,{signature}",
    }


def check(url: str, *, private: bool = False) -> tuple[str, int]:
    """Return host and port of an address.

    Raises
    ------
    RefusedError
        Where it is not https, or its host is written as the address of a private network.
    """
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port or 443
    except ValueError:
        raise RefusedError("it is not an address") from None
    if parts.scheme != "https" or not host:
        raise RefusedError("it must be an https address")
    if parts.username is not None or parts.password is not None or parts.fragment:
        raise RefusedError("it must not hold a user name, a password or a fragment")
    try:
        literal = ipaddress.ip_address(host)
    except ValueError:
        return host, port
    _check_address(literal, private)
    return host, port


def _check_address(address: ipaddress.IPv4Address | ipaddress.IPv6Address, private: bool) -> None:
    mapped = getattr(address, "ipv4_mapped", None)
    # is_global is false of private, loopback, link-local, reserved and unspecified ones.
    if not private and (not (mapped or address).is_global or address.is_multicast):
        raise RefusedError("its host lies in a private network")


def send(url: str, head: dict[str, str], body: bytes, trust: ssl.SSLContext, private: bool) -> int:
    """Post a message and return the status; redirections are not followed.

    The connection goes to the very address that was checked: a name that is resolved a second
    time could stand for another address.

    Raises
    ------
    RefusedError
        Where nothing may be sent to the address of the host.
    """
    host, port = check(url, private=private)
    parts = urlsplit(url)
    resolved = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    address = str(resolved[0][4][0])
    _check_address(ipaddress.ip_address(address.partition("%")[0]), private)
    path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    with socket.create_connection((address, port), _TIMEOUT) as plain:
        connection = http.client.HTTPSConnection(host, port, timeout=_TIMEOUT, context=trust)
        connection.sock = trust.wrap_socket(plain, server_hostname=host)
        try:
            connection.request("POST", path, body, head)
            return connection.getresponse().status
        finally:
            connection.close()


def _due(connection: Connection) -> sa.Select[Any]:
    ended = jobs.c.state.in_(FINAL) & (webhooks.c.due <= now(connection))
    return (
        sa.select(jobs, webhooks.c.url, webhooks.c.secret, webhooks.c.attempts.label("tried"))
        .join(webhooks, webhooks.c.job == jobs.c.id)
        .where(ended)
    )


def _any_due(connection: Connection) -> bool:
    return connection.execute(_due(connection).limit(1)).first() is not None


def _take(connection: Connection) -> list[tuple[JobRow, str, str, int]]:
    """Return messages that are due, and postpone each to its next attempt."""
    query = _due(connection).limit(_AT_ONCE).with_for_update(skip_locked=True, of=webhooks)
    taken = []
    for due in connection.execute(query).all():
        job, tried = row(due), due.tried
        pause = _DELAYS[min(tried, len(_DELAYS) - 1)]
        later = {"attempts": tried + 1, "due": now(connection) + pause}
        connection.execute(webhooks.update().where(webhooks.c.job == job.id).values(**later))
        taken.append((job, due.url, due.secret, tried + 1))
    return taken


def _delete(connection: Connection, job: str) -> None:
    connection.execute(webhooks.delete().where(webhooks.c.job == job))
