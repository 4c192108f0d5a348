"""Secrets of webhooks as they are recorded: encrypted with a key that the records do not hold."""

from __future__ import annotations

import base64
import hashlib
import os
import secrets
from pathlib import Path
from typing import Final

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from vibroimpact_service.settings import Settings
from vibroimpact_service.store import private

_PREFIX: Final = "whsec_"
_SEALED: Final = "aead_"
_FILE: Final = "webhook.key"
_NONCE_BYTES: Final = 12


class SealedError(ValueError):
    """A secret was sealed with another key, or for another job."""


class Sealing:
    """Seals the secrets of webhooks, each for its job.

    Parameters
    ----------
    material : bytes
        Secret from which the key is derived; processes that share records share it.
    """

    def __init__(self, material: bytes) -> None:
        kdf = HKDF(hashes.SHA256(), 32, salt=None, info=b"vibroimpact webhook secrets")
        self._cipher = AESGCM(kdf.derive(material))

    def seal(self, job: str, secret: str) -> str:
        """Return what is recorded of a secret; it fits the column that held the secret itself."""
        data = base64.b64decode(secret.removeprefix(_PREFIX))
        sealed = self._cipher.encrypt(_nonce(job), data, job.encode())
        return _SEALED + base64.b64encode(sealed).decode()

    def open(self, job: str, sealed: str) -> str:
        """Return the secret; one that an earlier version recorded is not sealed.

        Raises
        ------
        SealedError
            Where the key or the job is another one.
        """
        if not sealed.startswith(_SEALED):
            return sealed
        data = base64.b64decode(sealed.removeprefix(_SEALED))
        try:
            secret = self._cipher.decrypt(_nonce(job), data, job.encode())
        except InvalidTag:
            raise SealedError("it was sealed with another key") from None
        return _PREFIX + base64.b64encode(secret).decode()


def of_settings(settings: Settings) -> Sealing:
    """Return the sealing of a service.

    Its key comes from the setting ``webhook_key``, else from the private key that replicas share,
    else from a file in the data folder, which is made where it is missing.
    """
    if settings.webhook_key is not None:
        return Sealing(settings.webhook_key.get_secret_value().encode())
    if settings.tls_key is not None:
        return Sealing(settings.tls_key.read_bytes())
    return Sealing(_of_file(settings.data / _FILE))


def _of_file(path: Path) -> bytes:
    private.folder(path.parent)
    # Linked when it is whole: of two processes that begin, one gets the file of the other.
    new = path.with_name(f".{path.name}.{secrets.token_hex(8)}")
    if not path.exists():
        with open(new, "xb", opener=private.opener) as file:
            file.write(secrets.token_bytes(32))
            file.flush()
            os.fsync(file.fileno())
        try:
            path.hardlink_to(new)
        except FileExistsError:
            pass
        finally:
            new.unlink()
    return path.read_bytes()


def _nonce(job: str) -> bytes:
    """Return what is never used twice with a key: the ids of jobs are random, one secret each."""
    return hashlib.sha256(job.encode()).digest()[:_NONCE_BYTES]
