"""Addresses in settings that cannot be one are found before anything is opened."""

from __future__ import annotations

from pathlib import Path

import pytest

from vibroimpact_service.jobs import certificates
from vibroimpact_service.settings import (
    SettingsInvalidError,
    check_certificates,
    check_listening,
    read,
)

WRONG = [
    ("database", "nonsense-s3cret", "no URL"),
    ("database", "postgresql://ann:s3cret@host:port/x", "no URL"),
    ("database", "mysql://ann:s3cret@host/x", "must begin"),
    ("database", "postgresql+nothing://ann:s3cret@host/x", "driver"),
    ("database", "postgresql://ann:s3cret@host/x?s3cret=1", "option"),
    ("store", "nothing://bucket/x", "no protocol"),
    ("store", "https://host/x", "no protocol"),
    ("store", "s3://", "no bucket"),
    ("store", "s3:/bucket/x", "two slashes"),
    ("scheduler", "127.0.0.1:8786", "tls://host:port"),
    ("scheduler", "tcp://127.0.0.1:8786", "tls://host:port"),
    ("scheduler", "tls://", "tls://host:port"),
    ("scheduler", "tls://host", "tls://host:port"),
    ("scheduler", "tls://host:port", "tls://host:port"),
    ("scheduler", "tls://host:70000", "tls://host:port"),
    ("oidc_issuer", "nonsense", "https://host"),
    ("oidc_issuer", "https://[host", "https://host"),
    ("limits_storage", "nothing://ann:s3cret@host", "unknown kind"),
    ("webhook_ca", "/nowhere.pem", "/nowhere.pem: No such file"),
    ("webhook_ca", __file__, "holds no certificates"),
]


@pytest.mark.parametrize(("name", "value", "words"), WRONG)
def test_wrong_ones_are_named_and_not_quoted(
    monkeypatch: pytest.MonkeyPatch, name: str, value: str, words: str
) -> None:
    monkeypatch.setenv(f"VIBROIMPACT_{name.upper()}", value)
    with pytest.raises(SettingsInvalidError) as caught:
        read()
    assert str(caught.value).startswith(f"VIBROIMPACT_{name.upper()}: ")
    assert words in str(caught.value)
    assert "s3cret" not in str(caught.value)


def test_all_wrong_ones_are_named_at_once() -> None:
    with pytest.raises(SettingsInvalidError) as caught:
        read(database="nonsense", store="nothing://x")
    assert "VIBROIMPACT_DATABASE: " in str(caught.value)
    assert "; VIBROIMPACT_STORE: " in str(caught.value)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("database", "sqlite:////tmp/x.sqlite"),
        ("database", "postgresql://ann:p%40ss@host:5432/x?sslmode=require"),
        ("database", "postgres://host/x"),
        ("database", "postgresql+psycopg://host/x"),
        ("database", ""),
        ("store", "s3://bucket/folder"),
        ("store", "folder/of:a/name"),
        ("store", "/folder"),
        ("scheduler", "tls://host:8786"),
        ("scheduler", "tls://[::1]:8786"),
        ("oidc_issuer", "https://login.example/realms/x"),
        ("limits_storage", "memory://"),
    ],
)
def test_right_ones_pass(name: str, value: str) -> None:
    assert getattr(read(**{name: value}), name) == value


@pytest.mark.parametrize("name", ["AWS_ENDPOINT_URL", "AWS_ENDPOINT_URL_S3"])
def test_the_server_of_a_bucket_is_an_address_too(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setenv(name, "minio:9000")
    with pytest.raises(SettingsInvalidError, match=f"VIBROIMPACT_STORE: .*{name}"):
        read(store="s3://bucket/x")
    monkeypatch.setenv(name, "http://minio:9000")
    read(store="s3://bucket/x")


def test_certificates_of_a_scheduler(tmp_path: Path) -> None:
    ca, cert, key = certificates.write(tmp_path / "tls", days=2)
    check_certificates(read(tls_ca=ca, tls_cert=cert, tls_key=key))
    with pytest.raises(SettingsInvalidError, match=r"VIBROIMPACT_TLS_KEY: is not set.*three files"):
        check_certificates(read(tls_ca=ca, tls_cert=cert))
    with pytest.raises(SettingsInvalidError, match="VIBROIMPACT_TLS_KEY: there is no file"):
        check_certificates(read(tls_ca=ca, tls_cert=cert, tls_key=tmp_path / "no"))
    _, _, other = certificates.write(tmp_path / "other", days=2)
    with pytest.raises(SettingsInvalidError, match=r"VIBROIMPACT_TLS_CERT: .* its key"):
        check_certificates(read(tls_ca=ca, tls_cert=cert, tls_key=other))


def test_addresses_to_listen_on() -> None:
    check_listening(read(host="127.0.0.1"))
    check_listening(read(metrics_host="300.1.1.1"))  # there is no port for metrics
    with pytest.raises(SettingsInvalidError, match="VIBROIMPACT_METRICS_HOST: there is no"):
        check_listening(read(metrics_host="300.1.1.1", metrics_port=0))
