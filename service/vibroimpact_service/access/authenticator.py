"""Authentication: whether keys are required, and whose key or token a request carries."""

from __future__ import annotations

import asyncio
import ipaddress
from dataclasses import replace
from pathlib import Path

from sqlalchemy.engine import make_url

from vibroimpact_service import problems
from vibroimpact_service.access import keys, records
from vibroimpact_service.access.caller import LOCAL, Caller, Scope
from vibroimpact_service.access.tokens import IssuerUnavailableError, TokenError, Tokens
from vibroimpact_service.jobs.database import connect, failing, reader
from vibroimpact_service.jobs.record_access import RecordAccess
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings

_CHALLENGE = {"WWW-Authenticate": 'Bearer realm="vibroimpact"'}


class ExposedError(RuntimeError):
    """The service would be open to other machines without authentication."""


def loopback(host: str) -> bool:
    """Whether an address can be reached from this machine only."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def keys_needed(settings: Settings) -> bool:
    """Decide whether requests need a key or token.

    Raises
    ------
    ExposedError
        If the address can be reached from elsewhere, there are no keys, and the settings do
        not permit open access.
    """
    if settings.access == "open":
        return False
    if settings.access == "keys" or settings.oidc_issuer is not None or any_keys(settings):
        return True
    if not loopback(settings.host):
        raise ExposedError(
            f"{settings.host} can be reached from other machines, and there are no API keys. "
            "Make one with  vibroimpact keys create  or, where anybody who reaches the port "
            "may compute, see and cancel everything, set  VIBROIMPACT_ACCESS=open ."
        )
    return False


def any_keys(settings: Settings) -> bool:
    """Whether a key was ever made; changes nothing.

    Raises
    ------
    RecordsUnavailableError
        Where the database cannot be reached.
    """
    address = make_url(settings.database_url)
    if address.get_backend_name() == "sqlite" and not Path(address.database or "").exists():
        return False
    engine = connect(settings.database_url)
    try:
        with failing():
            return records.any_keys(reader(engine))
    finally:
        engine.dispose()


class Authenticator:
    """Recognises callers by their keys and tokens."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._records: RecordAccess | None = None
        self._tokens: Tokens | None = None
        self.keys_required = False
        """Whether callers need a key; known once started."""

    async def start(self) -> None:
        """Decide whether keys are needed, and open their records if so.

        Raises
        ------
        ExposedError
            As `keys_needed`.
        """
        settings = self._settings
        self.keys_required = await asyncio.to_thread(keys_needed, settings)
        if not self.keys_required:
            return
        database = await asyncio.to_thread(records.open_keys, settings.database_url)
        self._records = RecordAccess(database)
        if settings.oidc_issuer is not None:
            prefix = settings.oidc_scope_prefix
            self._tokens = Tokens(settings.oidc_issuer, settings.oidc_audience, prefix)

    async def close(self) -> None:
        """Close the records."""
        if self._records is not None:
            await asyncio.to_thread(self._records.close)

    @property
    def records(self) -> RecordAccess:
        """The records of keys.

        Raises
        ------
        ProblemError
            404 where the service runs without keys.
        """
        if self._records is None:
            detail = "The service runs without keys; start it with VIBROIMPACT_ACCESS=keys."
            raise ProblemError(problems.NOT_FOUND, detail)
        return self._records

    async def caller(self, authorization: str | None) -> Caller:
        """Return the caller that an Authorization header names.

        Raises
        ------
        ProblemError
            401 if it names none, 503 if that cannot be decided now.
        """
        if not self.keys_required:
            return LOCAL
        if authorization is None:
            raise _unauthenticated("A key is required: Authorization: Bearer vik_….")
        scheme, _, text = authorization.strip().partition(" ")
        if scheme.lower() != "bearer":
            raise _unauthenticated("Keys and tokens are sent as Authorization: Bearer ….")
        text = text.strip()
        key = keys.parse(text)
        if key is not None:
            return self._limited(await self._of_key(*key))
        if self._tokens is None:
            raise _unauthenticated("This is not a key of the service.")
        try:
            return self._limited(await self._tokens.caller(text))
        except TokenError as error:
            raise _unauthenticated(f"Not accepted: {error}.") from None
        except IssuerUnavailableError:
            detail = "The keys of the token's issuer cannot be fetched."
            headers = {"Retry-After": "10"}
            raise ProblemError(problems.UNAVAILABLE, detail, headers=headers) from None

    def _limited(self, caller: Caller) -> Caller:
        """Return a caller with the limits of the settings where it has none of its own."""
        return replace(
            caller,
            requests_per_minute=caller.requests_per_minute or self._settings.requests_per_minute,
            seconds_per_hour=caller.seconds_per_hour or self._settings.seconds_per_hour,
        )

    async def _of_key(self, name: str, secret: str) -> Caller:
        # Read anew each time: a revoked key is refused at once, by every replica.
        row = await self.records.read(records.find, name)
        if row is None or not keys.same(secret, row.hash) or not row.valid:
            raise _unauthenticated("The key is unknown, revoked or expired.")
        scopes = frozenset(Scope(name) for name in row.scopes.split())
        limits = row.requests_per_minute, row.seconds_per_hour
        return Caller(row.owner, f"key-{row.id}", scopes, *limits)


def _unauthenticated(detail: str) -> ProblemError:
    return ProblemError(problems.UNAUTHENTICATED, detail, headers=_CHALLENGE)
