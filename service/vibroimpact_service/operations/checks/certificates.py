"""Checks of the certificates with which services, scheduler and workers authenticate."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import serialization

from vibroimpact_service.operations.checks.check import Check, failed, ok, warning
from vibroimpact_service.settings import Settings

_NAME: Final = "certificates"
_SOON: Final = timedelta(days=30)
_NEW: Final = "make new ones for all machines: vibroimpact certificates"


def certificates(settings: Settings) -> list[Check]:
    """Check the files that settings name."""
    given = (settings.tls_ca, settings.tls_cert, settings.tls_key)
    if settings.scheduler is None and given == (None, None, None):
        return []
    ca, cert, key = given
    if ca is None or cert is None or key is None:
        seen = "VIBROIMPACT_TLS_CA, _TLS_CERT and _TLS_KEY are not all set"
        return [failed(_NAME, seen, "set them to the files of  vibroimpact certificates")]
    try:
        return _files(ca, cert, key)
    except OSError as error:
        seen = f"{error.filename}: {error.strerror}"
        return [failed(_NAME, seen, "give it to the service's user")]


def _files(ca: Path, cert: Path, key: Path) -> list[Check]:
    files = ca.read_bytes(), cert.read_bytes(), key.read_bytes()
    try:
        authority, own = (x509.load_pem_x509_certificate(pem) for pem in files[:2])
        secret = serialization.load_pem_private_key(files[2], None)
    except (ValueError, TypeError) as error:
        return [failed(_NAME, f"a file is damaged: {error}", _NEW)]
    form = serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo
    if secret.public_key().public_bytes(*form) != own.public_key().public_bytes(*form):
        return [failed(_NAME, f"{key} is not the key of {cert}", "use files made together")]
    try:
        own.verify_directly_issued_by(authority)
    except (ValueError, TypeError, InvalidSignature):
        return [failed(_NAME, f"{ca} did not sign {cert}", "use files made together")]
    checks = [_dates(authority, own)]
    if key.stat().st_mode & 0o077:
        checks.append(warning(_NAME, f"{key} is open to other users", f"chmod 600 {key}"))
    return checks


def _dates(authority: x509.Certificate, own: x509.Certificate) -> Check:
    now = datetime.now(UTC)
    begin = max(each.not_valid_before_utc for each in (authority, own))
    end = min(each.not_valid_after_utc for each in (authority, own))
    if now < begin:
        return failed(_NAME, f"not valid before {begin:%Y-%m-%d %H:%M} UTC", "check the clock")
    if now > end:
        return failed(_NAME, f"expired on {end:%Y-%m-%d}", _NEW)
    seen = f"valid until {end:%Y-%m-%d}"
    return ok(_NAME, seen) if end - now > _SOON else warning(_NAME, seen, _NEW)
