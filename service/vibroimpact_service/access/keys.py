"""API keys: how one is made, written and recognised; only its hash is kept."""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
from typing import NamedTuple

_TEXT = re.compile(r"vik_([0-9a-f]{12})_([A-Za-z0-9_-]{43})")


class Key(NamedTuple):
    """A key as it is shown once, to whoever it is made for.

    Parameters
    ----------
    id : str
        Public part, by which it is listed and revoked.
    text : str
        The whole key; the prefix lets scanners of leaked secrets recognise it.
    hash : str
        What is kept of it.
    """

    id: str
    text: str
    hash: str


def make() -> Key:
    """Return a new key."""
    name, secret = secrets.token_hex(6), secrets.token_urlsafe(32)
    return Key(name, f"vik_{name}_{secret}", digest(secret))


def parse(text: str) -> tuple[str, str] | None:
    """Return (id, secret) of a key, or None where the text is none."""
    match = _TEXT.fullmatch(text)
    return None if match is None else (match[1], match[2])


def digest(secret: str) -> str:
    """Return what is kept of a secret.

    It holds 256 random bits: a plain hash cannot be searched, a slow one would only cost time.
    """
    return hashlib.sha256(secret.encode()).hexdigest()


def same(secret: str, kept: str) -> bool:
    """Whether a secret is the one whose hash was kept."""
    return hmac.compare_digest(digest(secret), kept)
