"""Messages to users' own servers when their jobs end, signed according to Standard Webhooks."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import hmac
import http.client
import ipaddress
import json
import re
import socket
import ssl
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, Final
from urllib.parse import urlsplit

import sqlalchemy as sa
import structlog
from sqlalchemy.engine import Connection

from vibroimpact_service.jobs.database import now
from vibroimpact_service.jobs.record_access import RecordAccess
from vibroimpact_service.jobs.sealing import SealedError, Sealing
from vibroimpact_service.jobs.tables import FINAL, JobRow, jobs, row, webhooks
from vibroimpact_service.settings import Settings

log = structlog.get_logger("vibroimpact.webhooks")

_POLL_SECONDS: Final = 1.0
_AT_ONCE: Final = 16
_PER_ORIGIN: Final = 4
"""Messages on their way to the same receiver at once."""
_SECONDS: Final = 10.0
_STATUS_LINE: Final = re.compile(rb"HTTP/1\.[01] (\d{3})")
_DELAYS: Final = (5.0, 30.0, 120.0, 600.0, 3600.0, 4 * 3600.0, 12 * 3600.0)
"""Pauses between attempts; after the last one the message is given up."""

_NUMBER: Final = re.compile(r"\d+|0x[0-9a-f]*")
_TRANSLATED: Final = (
    ipaddress.IPv6Network("::/96"),  # IPv4-compatible
    ipaddress.IPv6Network("64:ff9b::/96"),  # NAT64
)
_LOCAL_NAT64: Final = ipaddress.IPv6Network("64:ff9b:1::/48")
_PUBLIC: Final = ipaddress.IPv6Network("2000::/3")
"""All public addresses of IPv6; `is_global` is true of much else, site-local ones among it."""
_KEPT: Final[tuple[ipaddress.IPv4Network | ipaddress.IPv6Network, ...]] = (
    ipaddress.IPv4Network("192.0.0.0/24"),  # protocols
    ipaddress.IPv4Network("192.88.99.0/24"),  # tunnels
    ipaddress.IPv6Network("2001::/23"),  # protocols
    ipaddress.IPv6Network("3fff::/20"),  # documentation
)
"""What is kept for protocols, in which `is_global` differs between versions of Python."""
_ISATAP: Final = (0x00005EFE, 0x02005EFE)
"""What stands before the IPv4 address of a tunnel, in whatever network it is."""


class RefusedError(ValueError):
    """Nothing is sent to the address: it is not https, or lies in a private network."""


def _uncounted(_outcome: str) -> None:
    """Keep no account of attempts."""


class Webhooks:
    """Sends the messages that are due. Each is sent by one replica at a time.

    Each has some seconds in all, whatever its receiver does, and few go to one receiver at a
    time: a slow one holds up no others. A message stays in the records until it is delivered, so
    it outlives the process. It can arrive twice, where a replica ends between sending and
    recording it: receivers recognise it by ``webhook-id``, which is the id of the job.

    Parameters
    ----------
    settings : Settings
    records : RecordAccess
    sealing : Sealing
    counted : callable
        ``(outcome) -> None``: called after each attempt; see `jobs.metrics.OUTCOMES`.
    """

    def __init__(
        self,
        settings: Settings,
        records: RecordAccess,
        sealing: Sealing,
        counted: Callable[[str], None] = _uncounted,
    ) -> None:
        self._sealing, self._counted = sealing, counted
        self._private = settings.webhook_private
        self._trust = ssl.create_default_context(
            cafile=None if settings.webhook_ca is None else str(settings.webhook_ca)
        )
        self._records = records
        self._sending: dict[asyncio.Task[None], str] = {}
        self._resolving = ThreadPoolExecutor(_AT_ONCE, "resolve")

    async def loop(self) -> None:
        """Send messages until cancelled."""
        try:
            while True:
                await asyncio.sleep(_POLL_SECONDS)
                try:
                    while await self._begin():
                        await asyncio.sleep(0)
                except ConnectionError as error:
                    log.warning("messages have to wait", error=str(error))
                except Exception:
                    log.exception("sending failed")
        finally:
            for task in self._sending:
                task.cancel()
            self._resolving.shutdown(wait=False, cancel_futures=True)

    async def _begin(self) -> bool:
        """Begin to send messages that are due; whether there were any."""
        room = _AT_ONCE - len(self._sending)
        busy = [origin for origin, n in Counter(self._sending.values()).items() if n >= _PER_ORIGIN]
        if room <= 0 or not await self._records.read(_any_due, busy):
            return False
        due = await self._records.write(_take, busy, room)
        for job, url, secret, attempts in due:
            task = asyncio.create_task(self._deliver(job, url, secret, attempts))
            self._sending[task] = _origin(url)
            task.add_done_callback(self._sending.pop)
        return bool(due)

    async def _deliver(self, job: JobRow, url: str, secret: str, attempts: int) -> None:
        body, status, outcome = json.dumps(_message(job)).encode(), 0, "failed"
        try:
            head = headers(job.id, self._sealing.open(job.id, secret), body)
            status = await send(url, head, body, self._trust, self._private, self._resolving)
        except RefusedError as error:
            log.warning("message refused", job=job.id, error=str(error))
            status, outcome = http.client.GONE, "refused"
        except SealedError as error:
            # Another replica may have the key.
            log.warning("message cannot be signed", job=job.id, error=str(error))
            outcome = "unsigned"
        except (OSError, ValueError) as error:
            log.info("message not delivered", job=job.id, error=type(error).__name__)
        delivered, last = 200 <= status < 300, attempts > len(_DELAYS)
        if delivered:
            outcome = "delivered"
        elif outcome != "refused" and (last or status == http.client.GONE):
            outcome = "given_up"
        self._counted(outcome)
        if delivered or last or status == http.client.GONE:
            try:
                await self._records.write(_delete, job.id)
            except ConnectionError as error:
                log.warning("message will be sent again", job=job.id, error=str(error))


def _origin(url: str) -> str:
    """Return the beginning of an address that all addresses at the same server have."""
    return url[: len("https://") + len(urlsplit(url).netloc)]


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
        Where it is not https, or its host is an address in a private network or in a spelling
        that resolvers read in different ways.
    """
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port or 443
        if host is not None and ":" not in host:
            host = host.encode("idna").decode().lower()  # digits have other forms too
    except ValueError:
        raise RefusedError("it is not an address") from None
    if parts.scheme != "https" or not host:
        raise RefusedError("it must be an https address")
    if parts.username is not None or parts.password is not None or parts.fragment:
        raise RefusedError("it must not hold a user name, a password or a fragment")
    try:
        literal = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        last = host.rstrip(".").rpartition(".")[2]
        # 2130706433, 127.1, 0x7f.1 and 127.0.0.1. are 127.0.0.1 for some resolvers.
        if _NUMBER.fullmatch(last):
            raise RefusedError("its host is a number, or an address that is not whole") from None
        if last == "localhost" and not private:
            raise RefusedError("its host is this machine") from None
        return host, port
    _check_address(literal, private)
    return host, port


def _check_address(address: ipaddress.IPv4Address | ipaddress.IPv6Address, private: bool) -> None:
    if private:
        return
    local = address.version == 6 and address in _LOCAL_NAT64
    reached = [address] if isinstance(address, ipaddress.IPv4Address) else _reached(address)
    if local or address.is_multicast or not all(_is_public(each) for each in reached):
        raise RefusedError("its host lies in a private network")


def _is_public(address: ipaddress.IPv4Address | ipaddress.IPv6Address) -> bool:
    """Whether an address is none that is private, local, reserved or kept for protocols."""
    if any(address.version == kept.version and address in kept for kept in _KEPT):
        return False
    return address.is_global and (address.version == 4 or address in _PUBLIC)


def _reached(
    address: ipaddress.IPv6Address,
) -> list[ipaddress.IPv4Address | ipaddress.IPv6Address]:
    """Return where packets to an address go: translators and tunnels take them to IPv4."""
    if address.ipv4_mapped is not None:
        return [address.ipv4_mapped]
    if address.sixtofour is not None:
        return [address.sixtofour]
    if address.teredo is not None:
        return list(address.teredo)
    inner = ipaddress.IPv4Address(int(address) & 0xFFFFFFFF)
    if any(address in network for network in _TRANSLATED):
        return [inner]
    if int(address) >> 32 & 0xFFFFFFFF in _ISATAP:
        return [address, inner]
    return [address]


async def send(
    url: str,
    head: dict[str, str],
    body: bytes,
    trust: ssl.SSLContext,
    private: bool,
    threads: ThreadPoolExecutor | None = None,
) -> int:
    """Post a message within a time limit and return the status; redirections are not followed.

    The connection goes to the very address that was checked: a name that is resolved a second
    time could stand for another address. Names are resolved in `threads`.

    Raises
    ------
    RefusedError
        Where nothing may be sent to the address of the host.
    TimeoutError
        Where it took too long.
    """
    host, port = check(url, private=private)
    parts = urlsplit(url)
    path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    name = f"[{host}]" if ":" in host else host.encode("idna").decode()
    fields = {"host": f"{name}:{port}", **head, "content-length": len(body), "connection": "close"}
    lines = [f"POST {path} HTTP/1.1", *(f"{field}: {value}" for field, value in fields.items())]
    loop = asyncio.get_running_loop()
    async with asyncio.timeout(_SECONDS):
        resolve = partial(socket.getaddrinfo, host, port, type=socket.SOCK_STREAM)
        address = str((await loop.run_in_executor(threads, resolve))[0][4][0])
        _check_address(ipaddress.ip_address(address.partition("%")[0]), private)
        reader, writer = await asyncio.open_connection(
            address, port, ssl=trust, server_hostname=host
        )
        try:
            writer.write("\r\n".join([*lines, "", ""]).encode() + body)
            await writer.drain()
            return await _status(reader)
        finally:
            writer.transport.abort()


async def _status(reader: asyncio.StreamReader) -> int:
    """Return the first status that is final; 0 where there is none."""
    while line := await reader.readline():
        status = _STATUS_LINE.match(line)
        if status is not None and int(status[1]) >= 200:
            return int(status[1])
    return 0


def _due(connection: Connection, busy: Sequence[str]) -> sa.Select[Any]:
    """Return the messages that are due at receivers that are not busy."""
    ended = jobs.c.state.in_(FINAL) & (webhooks.c.due <= now(connection))
    free = (~webhooks.c.url.startswith(origin, autoescape=True) for origin in busy)
    return (
        sa.select(jobs, webhooks.c.url, webhooks.c.secret, webhooks.c.attempts.label("tried"))
        .join(webhooks, webhooks.c.job == jobs.c.id)
        .where(ended, *free)
    )


def _any_due(connection: Connection, busy: Sequence[str]) -> bool:
    return connection.execute(_due(connection, busy).limit(1)).first() is not None


def _take(
    connection: Connection, busy: Sequence[str], room: int
) -> list[tuple[JobRow, str, str, int]]:
    """Return messages that are due, few for each receiver; postpone each to its next attempt."""
    query = _due(connection, busy).order_by(webhooks.c.due).limit(room)
    taken: list[tuple[JobRow, str, str, int]] = []
    origins: Counter[str] = Counter()
    for due in connection.execute(query.with_for_update(skip_locked=True, of=webhooks)).all():
        job, tried, origin = row(due), due.tried, _origin(due.url)
        origins[origin] += 1
        if origins[origin] > _PER_ORIGIN:
            continue
        pause = _DELAYS[min(tried, len(_DELAYS) - 1)]
        later = {"attempts": tried + 1, "due": now(connection) + pause}
        connection.execute(webhooks.update().where(webhooks.c.job == job.id).values(**later))
        taken.append((job, due.url, due.secret, tried + 1))
    return taken


def _delete(connection: Connection, job: str) -> None:
    connection.execute(webhooks.delete().where(webhooks.c.job == job))
