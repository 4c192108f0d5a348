"""Keys and certificates with which services, scheduler and workers authenticate one another."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID
from distributed import Security

from vibroimpact_service.settings import Settings

FILES: Final = {"CA": "ca.pem", "CERT": "cert.pem", "KEY": "key.pem"}
"""End of the name of a setting ``VIBROIMPACT_TLS_…`` -> name of its file as `write` makes it."""
_AUTHORITY: Final = "vibroimpact authority"


def temporary() -> Security:
    """Return keys and certificates that exist only in the memory of this process."""
    return _security(*(pem.decode() for pem in _make(days=3650)))


def of_settings(settings: Settings) -> Security:
    """Return the keys and certificates that settings name.

    Raises
    ------
    ValueError
        Where they do not name all three files.
    """
    if settings.tls_ca is None or settings.tls_cert is None or settings.tls_key is None:
        raise ValueError("a scheduler needs VIBROIMPACT_TLS_CA, _TLS_CERT and _TLS_KEY")
    return _security(str(settings.tls_ca), str(settings.tls_cert), str(settings.tls_key))


def expiry(settings: Settings) -> dict[str, float]:
    """Return when the certificates that settings name expire, in seconds since 1970."""
    named = {"ca": settings.tls_ca, "cert": settings.tls_cert}
    return {
        name: x509.load_pem_x509_certificate(path.read_bytes()).not_valid_after_utc.timestamp()
        for name, path in named.items()
        if path is not None
    }


def write(folder: Path, days: int) -> list[Path]:
    """Write new ones; return the paths of authority, certificate and key.

    Raises
    ------
    FileExistsError
        Where one of the files exists already.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / name for name in FILES.values()]
    for path, pem in zip(paths, _make(days), strict=True):
        path.touch(0o600 if path.name == FILES["KEY"] else 0o644, exist_ok=False)
        path.write_bytes(pem)
    return paths


def _make(days: int) -> tuple[bytes, bytes, bytes]:
    """Return an authority's certificate, one that it signed, and the key of that; PEM.

    All processes use the same certificate. Anybody with its key can run code in the workers. The
    key of the authority is not kept: after a leak, all certificates are replaced.
    """
    authority, key = (ec.generate_private_key(ec.SECP256R1()) for _ in range(2))
    root = _sign(_AUTHORITY, authority, authority, days)
    own = _sign("vibroimpact", key, authority, days)
    secret = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    pem = serialization.Encoding.PEM
    return root.public_bytes(pem), own.public_bytes(pem), secret


def _sign(
    subject: str, key: ec.EllipticCurvePrivateKey, by: ec.EllipticCurvePrivateKey, days: int
) -> x509.Certificate:
    now = datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(_name(subject))
        .issuer_name(_name(_AUTHORITY))
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(minutes=5))
        .not_valid_after(now + timedelta(days=days))
        .add_extension(x509.BasicConstraints(ca=key is by, path_length=None), critical=True)
        .add_extension(x509.SubjectAlternativeName([x509.DNSName("vibroimpact")]), critical=False)
        .sign(by, hashes.SHA256())
    )


def _name(common: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common)])


def _security(authority: str, certificate: str, key: str) -> Security:
    own = {
        f"tls_{role}_{part}": value
        for role in ("client", "scheduler", "worker")
        for part, value in (("cert", certificate), ("key", key))
    }
    return Security(tls_ca_file=authority, require_encryption=True, **own)
