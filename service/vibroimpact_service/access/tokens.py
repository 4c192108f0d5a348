"""Bearer tokens of an OpenID Connect issuer: signature, claims and the caller they name."""

from __future__ import annotations

import asyncio
import hashlib
import json
import time
import urllib.parse
import urllib.request
from typing import Any, Final

import jwt

from vibroimpact_service.access.caller import Caller, Scope

ALGORITHMS: Final = ("RS256", "RS384", "RS512", "PS256", "ES256", "ES384", "EdDSA")
"""Signature algorithms with a public key; with a shared secret or none, anybody could sign."""

_LEEWAY_SECONDS: Final = 30.0
_FRESH_SECONDS: Final = 3600.0
_PAUSE_SECONDS: Final = 10.0  # invented key ids must not cause a request to the issuer each
_FETCH_SECONDS: Final = 5.0
_MOST_BYTES: Final = 2**20
_LONGEST: Final = 8192


class TokenError(ValueError):
    """A token that is not valid for this service."""


class IssuerUnavailableError(ConnectionError):
    """The issuer's keys cannot be fetched."""


class Tokens:
    """Verifies the tokens of one issuer.

    Parameters
    ----------
    issuer : str
        Address of the issuer, as in the claim ``iss``.
    audience : str
        Required value of the claim ``aud``.
    prefix : str
        Prefix of this service's scopes in the claim ``scope`` (or ``scp``).
    """

    def __init__(self, issuer: str, audience: str, prefix: str) -> None:
        address = urllib.parse.urlsplit(issuer)
        if address.scheme != "https" and address.hostname not in ("127.0.0.1", "localhost", "::1"):
            raise ValueError("the OpenID Connect issuer must be an https address")
        self._issuer, self._audience, self._prefix = issuer, audience, prefix
        self._keys: dict[str, jwt.PyJWK] = {}
        self._fetched = self._tried = -_FRESH_SECONDS
        self._lock = asyncio.Lock()

    async def caller(self, text: str) -> Caller:
        """Return the caller that a token names.

        Raises
        ------
        TokenError
            If it is not a valid token of this issuer for this service, or has expired.
        IssuerUnavailableError
            If the issuer's keys cannot be fetched.
        """
        if len(text) > _LONGEST:
            raise TokenError("the token is too long")
        try:
            name = str(jwt.get_unverified_header(text).get("kid", ""))
            key = await self._key(name)
            claims: dict[str, Any] = jwt.decode(
                text,
                key,
                algorithms=list(ALGORITHMS),
                audience=self._audience,
                issuer=self._issuer,
                leeway=_LEEWAY_SECONDS,
                options={"require": ["exp", "iss", "aud", "sub"]},
            )
            # A surrogate without its other half cannot be encoded: no issuer names such a subject.
            subject = f"{self._issuer} {claims['sub']}".encode()
        except jwt.ExpiredSignatureError:
            raise TokenError("the token has expired") from None
        except (jwt.InvalidTokenError, ValueError, RecursionError):
            raise TokenError("the token is not one of the issuer for this service") from None
        owner = "oidc-" + hashlib.sha256(subject).hexdigest()[:40]
        return Caller(owner, owner, self._scopes(claims))

    def _scopes(self, claims: dict[str, Any]) -> frozenset[Scope]:
        given = claims.get("scope", claims.get("scp", ""))
        names = given.split() if isinstance(given, str) else given
        if not isinstance(names, list):
            return frozenset()
        known = {self._prefix + scope.value: scope for scope in Scope}
        return frozenset(known[name] for name in names if isinstance(name, str) and name in known)

    async def _key(self, name: str) -> jwt.PyJWK:
        async with self._lock:
            clock = time.monotonic()
            stale = name not in self._keys or clock - self._fetched > _FRESH_SECONDS
            if stale and clock - self._tried > _PAUSE_SECONDS:
                self._tried = clock
                try:
                    self._keys = await asyncio.to_thread(self._fetch)
                    self._fetched = clock
                except (OSError, ValueError) as error:
                    if name not in self._keys:
                        raise IssuerUnavailableError("the issuer cannot be reached") from error
        if name not in self._keys:
            raise TokenError("the token is signed by an unknown key")
        return self._keys[name]

    def _fetch(self) -> dict[str, jwt.PyJWK]:
        about = _get(self._issuer.rstrip("/") + "/.well-known/openid-configuration")
        if about.get("issuer") != self._issuer:
            raise ValueError("the issuer states a different name")
        keys = {}
        for each in _get(str(about["jwks_uri"]))["keys"]:
            try:
                keys[str(each.get("kid", ""))] = jwt.PyJWK(each)
            except jwt.PyJWTError:
                continue  # the set may contain keys of unknown types
        return keys


def _get(url: str) -> Any:
    if not url.startswith(("https://", "http://")):
        raise ValueError("not a web address")
    with urllib.request.urlopen(url, timeout=_FETCH_SECONDS) as answer:
        return json.loads(answer.read(_MOST_BYTES))
