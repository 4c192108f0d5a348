"""Who stands at the door: whether keys are needed, and whose key or token is shown."""

from __future__ import annotations

import asyncio
import ipaddress
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

from sqlalchemy.engine import Connection, Engine, make_url

from vibroimpact_service import problems
from vibroimpact_service.access import keys, records
from vibroimpact_service.access.caller import LOCAL, Caller
from vibroimpact_service.access.tokens import IssuerUnavailableError, TokenError, Tokens
from vibroimpact_service.jobs.database import connect, failing, reader
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings

Value = TypeVar("Value")

_CHALLENGE = {"WWW-Authenticate": 'Bearer realm="vibroimpact"'}


class ExposedError(RuntimeError):
    """The service would listen to strangers without asking anybody who they are."""


def loopback(host: str) -> bool:
    """Whether only this machine can reach an address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def open_records(settings: Settings) -> Engine:
    """Return the database of the keys, with its tables brought up to date."""
    engine = connect(settings.database_url)
    with failing():
        records.prepare(engine)
    return engine


def keys_needed(settings: Settings) -> bool:
    """Decide whether callers need a key or token.

    Raises
    ------
    ExposedError
        Where the address can be reached from elsewhere, there are no keys, and the settings
        do not say that this is meant.
    """
    if settings.access == "open":
        return False
    if settings.access == "keys" or settings.oidc_issuer is not None or _any_keys(settings):
        return True
    if not loopback(settings.host):
        raise ExposedError(
            f"{settings.host} can be reached from other machines, and there are no API keys. "
            "Make one with  vibroimpact keys create  or, where anybody who reaches the port "
            "may compute, see and cancel everything, set  VIBROIMPACT_ACCESS=open ."
        )
    return False


def _any_keys(settings: Settings) -> bool:
    address = make_url(settings.database_url)
    if address.get_backend_name() == "sqlite" and not Path(address.database or "").exists():
        return False
    engine = connect(settings.database_url)
    try:
        with failing():
            return records.any_keys(reader(engine))
    finally:
        engine.dispose()


class Gate:
    """Recognises callers.

    Parameters
    ----------
    settings : Settings
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._engine: Engine | None = None
        self._tokens: Tokens | None = None
        self.closed = False
        """Whether callers need a key."""

    async def start(self) -> None:
        """Decide whether keys are needed, and open their records if so.

        Raises
        ------
        ExposedError
            As `keys_needed`.
        """
        settings = self._settings
        self.closed = await asyncio.to_thread(keys_needed, settings)
        if not self.closed:
            return
        self._engine = await asyncio.to_thread(open_records, settings)
        self._threads = ThreadPoolExecutor(4, "keys")
        if settings.oidc_issuer is not None:
            prefix = settings.oidc_scope_prefix
            self._tokens = Tokens(settings.oidc_issuer, settings.oidc_audience, prefix)

    async def close(self) -> None:
        """Close the records."""
        if self._engine is not None:
            self._threads.shutdown()
            self._engine.dispose()

    async def caller(self, authorization: str | None) -> Caller:
        """Return who sent a request with that header Authorization.

        Raises
        ------
        ProblemError
            401 where that cannot be told, 503 where it cannot be told now.
        """
        if not self.closed:
            return LOCAL
        if authorization is None:
            raise _stranger("This needs a key: Authorization: Bearer vik_….")
        scheme, _, text = authorization.strip().partition(" ")
        if scheme.lower() != "bearer":
            raise _stranger("Keys and tokens are sent as Authorization: Bearer ….")
        text = text.strip()
        key = keys.parse(text)
        if key is not None:
            return await self._of_key(*key)
        if self._tokens is None:
            raise _stranger("This is not a key of the service.")
        try:
            return await self._tokens.caller(text)
        except TokenError as error:
            raise _stranger(f"Not accepted: {error}.") from None
        except IssuerUnavailableError:
            detail = "The issuer of the token cannot be asked for its keys."
            headers = {"Retry-After": "10"}
            raise ProblemError(problems.UNAVAILABLE, detail, headers=headers) from None

    async def _of_key(self, name: str, secret: str) -> Caller:
        # Asked anew each time: a revoked key is worthless at once, on every replica.
        found = await self.read(lambda connection: records.find(connection, name))
        if found is None or not keys.same(secret, found.hash) or not found.valid:
            raise _stranger("The key is unknown, revoked or expired.")
        return Caller(found.owner, f"key-{found.id}", found.scopes, found.allowance)

    async def read(self, query: Callable[[Connection], Value]) -> Value:
        """Return what a query of the records of keys returns."""
        return await self._run(query, writing=False)

    async def write(self, change: Callable[[Connection], Value]) -> Value:
        """Change the records of keys."""
        return await self._run(change, writing=True)

    async def _run(self, operation: Callable[[Connection], Value], *, writing: bool) -> Value:
        engine = self._engine
        if engine is None:
            detail = "The service runs without keys; start it with VIBROIMPACT_ACCESS=keys."
            raise ProblemError(problems.NOT_FOUND, detail)

        def run() -> Value:
            with failing():
                if writing:
                    with engine.begin() as connection:
                        return operation(connection)
                with reader(engine).connect() as connection:
                    return operation(connection)

        return await asyncio.get_running_loop().run_in_executor(self._threads, run)


def _stranger(detail: str) -> ProblemError:
    return ProblemError(problems.UNAUTHENTICATED, detail, headers=_CHALLENGE)
