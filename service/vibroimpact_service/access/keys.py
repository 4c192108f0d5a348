"""API keys: their form, and the hash that is stored in place of the secret."""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets

_TEXT = re.compile(r"vik_([0-9a-f]{12})_([A-Za-z0-9_-]{43})")


def make() -> tuple[str, str, str]:
    """Return a new key.

    Returns
    -------
    id : str
        Public part, by which the key is listed and revoked.
    text : str
        The whole key, shown once; scanners for leaked secrets recognise its prefix.
    hash : str
        Hash of the secret part, which alone is stored.
    """
    name, secret = secrets.token_hex(6), secrets.token_urlsafe(32)
    return name, f"vik_{name}_{secret}", digest(secret)


def parse(text: str) -> tuple[str, str] | None:
    """Return (id, secret) of a key, or None if the text is not a key."""
    match = _TEXT.fullmatch(text)
    return None if match is None else (match[1], match[2])


def digest(secret: str) -> str:
    """Return the hash of a secret.

    A secret holds 256 random bits: a plain hash cannot be inverted by trying, and a slow hash
    would only cost time.
    """
    return hashlib.sha256(secret.encode()).hexdigest()


def same(secret: str, kept: str) -> bool:
    """Whether a secret has the stored hash."""
    return hmac.compare_digest(digest(secret), kept)
