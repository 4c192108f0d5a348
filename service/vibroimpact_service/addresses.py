"""Addresses in settings: whether they can be one, which is found before anything is opened.

Messages never quote an address: it may hold a password. Whether there is anything at an address is
not asked here.
"""

from __future__ import annotations

import importlib.util
import os
import re
import socket
import ssl
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

_SCHEDULER: Final = re.compile(r"tls://(\[[0-9A-Fa-f:.]+\]|[^/:@\[\]\s]+):(\d{1,5})/?")
_SCHEME: Final = re.compile(r"([A-Za-z][A-Za-z0-9+.-]+):/")
_ENDPOINTS: Final = ("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL")
_READ_ONLY: Final = ("http", "https")
"""Protocols of stores that nothing can be written to."""


class AddressError(ValueError):
    """What is wrong with an address."""


def faults(settings: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield names of settings whose addresses are wrong, and what is wrong with each.

    Parameters
    ----------
    settings : mapping
        Name -> value; those that are empty stand for the default.
    """
    for name, check in _CHECKS.items():
        value = settings.get(name)
        if not value:
            continue
        try:
            check(value)
        except AddressError as error:
            yield name, str(error)


def database(url: str) -> None:
    """Check the SQLAlchemy URL of a database; see `AddressError`."""
    from sqlalchemy.engine import make_url
    from sqlalchemy.exc import ArgumentError, NoSuchModuleError

    try:
        address = make_url(url)
    except (ArgumentError, ValueError):
        raise AddressError(
            "is no URL such as postgresql://user@host/name or sqlite:////folder/records.sqlite; "
            "special characters of passwords are written as %40 for @"
        ) from None
    backend = address.get_backend_name()
    if backend not in ("sqlite", "postgresql", "postgres"):
        raise AddressError("must begin with postgresql:// or sqlite:///")
    if address.drivername in ("postgresql", "postgres"):
        address = address.set(drivername="postgresql+psycopg")
    try:
        driver = address.get_dialect().import_dbapi()
    except NoSuchModuleError:
        raise AddressError("names a driver that SQLAlchemy does not know") from None
    except ImportError as error:
        message = f"needs {error.name}: pip install 'vibroimpact[service,postgresql]'"
        raise AddressError(message) from None
    if driver.__name__ == "psycopg":
        _check_options(address.query)


def _check_options(query: Mapping[str, Any]) -> None:
    from psycopg import ProgrammingError, conninfo

    try:
        conninfo.make_conninfo(**dict(query))
    except ProgrammingError:
        raise AddressError("has an option behind ? that PostgreSQL does not know") from None


def store(url: str) -> None:
    """Check the URL, for fsspec, of a store, or its folder; see `AddressError`."""
    from fsspec.registry import known_implementations

    match = _SCHEME.match(url)
    if match is None:
        return
    scheme = match.group(1).lower()
    if not url[match.end() :].startswith("/"):
        raise AddressError(f"is neither a folder nor a URL: {scheme}:// has two slashes")
    known = known_implementations.get(scheme)
    if known is None or scheme in _READ_ONLY:
        raise AddressError(f"{scheme} is no protocol of a store: s3://bucket/folder, or a folder")
    library = known["class"].partition(".")[0]
    if importlib.util.find_spec(library) is None:
        raise AddressError(f"needs {library}: pip install 'vibroimpact[s3]' for s3")
    if scheme == "s3":
        if not urlsplit(url).netloc:
            raise AddressError("names no bucket: s3://bucket/folder")
        for name in _ENDPOINTS:
            if os.environ.get(name):
                _check_web(os.environ[name], f"is in a bucket of {name}, which")


def scheduler(address: str) -> None:
    """Check the address of a scheduler; see `AddressError`."""
    match = _SCHEDULER.fullmatch(address)
    if match is None or not 0 < int(match.group(2)) < 2**16:
        raise AddressError("must be tls://host:port, as the scheduler prints it")


def issuer(url: str) -> None:
    """Check the address of an issuer of tokens; see `AddressError`."""
    _check_web(url)


def limits_storage(url: str) -> None:
    """Check where requests are counted; see `AddressError`."""
    if url == "memory://":
        return
    from limits.errors import ConfigurationError
    from limits.storage import storage_from_string

    try:
        storage_from_string(f"async+{url}")
    except ConfigurationError as error:
        reason = "needs a library" if "prerequisite" in str(error) else "is of an unknown kind"
        library = re.search(r"'(\w+)' prerequisite", str(error))
        message = f"{reason}{': pip install ' + library.group(1) if library else ''}"
        raise AddressError(f"{message}; memory:// and redis://host:port are usual") from None
    except Exception:  # of the library of that kind
        raise AddressError("is no URL such as redis://host:port") from None


def authorities(file: Path) -> None:
    """Check a file of certificate authorities; see `AddressError`."""
    try:
        ssl.create_default_context(cafile=str(file))
    except ssl.SSLError:
        raise AddressError(f"{file} holds no certificates") from None
    except OSError as error:
        raise AddressError(f"{file}: {error.strerror}") from None


def certificates(files: Mapping[str, Path | None]) -> Iterator[tuple[str, str]]:
    """Yield what is wrong with authority, certificate and key of a scheduler; as `faults`.

    Parameters
    ----------
    files : mapping
        ``tls_ca``, ``tls_cert`` and ``tls_key`` -> file.
    """
    lacking = [name for name, file in files.items() if file is None or not file.is_file()]
    for name in lacking:
        file = files[name]
        yield (
            name,
            (
                f"there is no file {file}"
                if file
                else "is not set, nor --tls: scheduler and workers "
                "need the three files of `vibroimpact certificates`"
            ),
        )
    if lacking:
        return
    try:
        authorities(files["tls_ca"])  # type: ignore[arg-type]
    except AddressError as error:
        yield "tls_ca", str(error)
    try:
        own = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        own.load_cert_chain(str(files["tls_cert"]), str(files["tls_key"]))
    except OSError as error:  # those of SSL among them
        reason = "" if isinstance(error, ssl.SSLError) else f": {error.strerror}"
        yield "tls_cert", f"{files['tls_cert']} and TLS_KEY are no certificate and its key{reason}"


def listening(host: str) -> None:
    """Check the name or number of an address of this machine; see `AddressError`."""
    try:
        socket.getaddrinfo(host, None, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (OSError, UnicodeError):
        raise AddressError(f"there is no address {host}") from None


def _check_web(url: str, what: str = "") -> None:
    try:
        parts = urlsplit(url)
        there = parts.scheme in ("http", "https") and parts.hostname and parts.port != 0
    except ValueError:
        there = False
    if not there:
        raise AddressError(f"{what} must be an address https://host".strip())


_CHECKS: Final[dict[str, Callable[[Any], None]]] = {
    "database": database,
    "store": store,
    "scheduler": scheduler,
    "oidc_issuer": issuer,
    "limits_storage": limits_storage,
    "webhook_ca": authorities,
}
"""Name of a setting -> what checks it."""
