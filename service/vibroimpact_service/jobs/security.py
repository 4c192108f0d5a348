"""TLS between service, scheduler and workers, in the form that Dask takes."""

from __future__ import annotations

from distributed import Security

from vibroimpact_service.jobs import certificates
from vibroimpact_service.settings import Settings


def temporary() -> Security:
    """Return keys and certificates that exist only in the memory of this process."""
    made = certificates.make(days=3650)
    return _security(made.authority.decode(), made.certificate.decode(), made.key.decode())


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


def _security(authority: str, certificate: str, key: str) -> Security:
    own = {
        f"tls_{role}_{part}": value
        for role in ("client", "scheduler", "worker")
        for part, value in (("cert", certificate), ("key", key))
    }
    return Security(tls_ca_file=authority, require_encryption=True, **own)
