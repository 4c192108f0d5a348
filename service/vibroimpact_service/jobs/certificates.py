"""Keys and certificates with which services, scheduler and workers authenticate one another."""

from __future__ import annotations

import os
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final, NamedTuple

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

AUTHORITY: Final = "ca.pem"
CERTIFICATE: Final = "cert.pem"
KEY: Final = "key.pem"
_AUTHORITY: Final = "vibroimpact authority"


class Material(NamedTuple):
    """An authority's certificate, one that it signed, and the key of that; PEM."""

    authority: bytes
    certificate: bytes
    key: bytes


def make(days: int) -> Material:
    """Return an authority and one certificate that it signed.

    All processes use the same certificate. Anybody with its key can run code in the workers. The
    key of the authority is not kept: after a leak, all certificates are replaced.
    """
    authority, key = (ec.generate_private_key(ec.SECP256R1()) for _ in range(2))
    root = _sign(_AUTHORITY, authority, _AUTHORITY, authority, days, True)
    own = _sign("vibroimpact", key, _AUTHORITY, authority, days, False)
    secret = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    pem = serialization.Encoding.PEM
    return Material(root.public_bytes(pem), own.public_bytes(pem), secret)


def write(folder: Path, days: int) -> tuple[Path, Path, Path]:
    """Write new material; return the paths of authority, certificate and key.

    Raises
    ------
    FileExistsError
        Where one of the files exists already.
    """
    folder.mkdir(parents=True, exist_ok=True)
    made = make(days)
    _write(folder / KEY, made.key, 0o600)
    _write(folder / AUTHORITY, made.authority, 0o644)
    _write(folder / CERTIFICATE, made.certificate, 0o644)
    return folder / AUTHORITY, folder / CERTIFICATE, folder / KEY


def _sign(
    subject: str,
    key: ec.EllipticCurvePrivateKey,
    issuer: str,
    by: ec.EllipticCurvePrivateKey,
    days: int,
    authority: bool,
) -> x509.Certificate:
    now = datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(_name(subject))
        .issuer_name(_name(issuer))
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(minutes=5))
        .not_valid_after(now + timedelta(days=days))
        .add_extension(x509.BasicConstraints(ca=authority, path_length=None), critical=True)
        .add_extension(x509.SubjectAlternativeName([x509.DNSName("vibroimpact")]), critical=False)
        .sign(by, hashes.SHA256())
    )


def _name(common: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common)])


def _write(path: Path, data: bytes, mode: int) -> None:
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    with os.fdopen(handle, "wb") as file:
        file.write(data)
