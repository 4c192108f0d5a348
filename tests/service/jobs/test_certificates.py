"""Certificates: made once, signed by their authority, the key for its owner alone."""

from __future__ import annotations

import ssl
from pathlib import Path

import pytest
from cryptography import x509

from vibroimpact_service.jobs import certificates


def test_files_are_written_once(tmp_path: Path) -> None:
    authority, certificate, key = certificates.write(tmp_path / "tls", days=3)
    assert key.stat().st_mode & 0o777 == 0o600
    before = key.read_bytes()
    with pytest.raises(FileExistsError):
        certificates.write(tmp_path / "tls", days=3)
    assert key.read_bytes() == before
    signed = x509.load_pem_x509_certificate(certificate.read_bytes())
    signed.verify_directly_issued_by(x509.load_pem_x509_certificate(authority.read_bytes()))
    assert (signed.not_valid_after_utc - signed.not_valid_before_utc).days == 3


@pytest.mark.parametrize("stranger", [False, True])
def test_only_processes_of_the_cluster_can_talk(tmp_path: Path, stranger: bool) -> None:
    ours = certificates.write(tmp_path / "ours", days=3)
    theirs = certificates.write(tmp_path / "theirs", days=3) if stranger else ours
    server, client = (ssl.SSLContext(p) for p in (ssl.PROTOCOL_TLS_SERVER, ssl.PROTOCOL_TLS_CLIENT))
    for context, (authority, certificate, key) in ((server, ours), (client, theirs)):
        context.check_hostname = False
        context.load_verify_locations(authority)
        context.load_cert_chain(certificate, key)
        context.verify_mode = ssl.CERT_REQUIRED
    left, right = ssl.MemoryBIO(), ssl.MemoryBIO()
    ends = [
        client.wrap_bio(left, right),
        server.wrap_bio(right, left, server_side=True),
    ]
    done: set[int] = set()
    failed = False
    for _ in range(10):
        for number, end in enumerate(ends):
            try:
                end.do_handshake()
                done.add(number)
            except ssl.SSLWantReadError:
                continue
            except ssl.SSLError:
                failed = True
    assert failed is stranger
    assert (done == {0, 1}) is not stranger
