"""Messages at the end of jobs: what is signed, where none goes, and that one arrives."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import hmac
import http.server
import json
import ssl
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec

from vibroimpact_service.jobs import claims, records, webhooks
from vibroimpact_service.jobs.database import open_database
from vibroimpact_service.jobs.record_access import RecordAccess
from vibroimpact_service.jobs.records import NewJob
from vibroimpact_service.settings import Settings

SECRET = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw"


def test_the_signature_is_that_of_the_standard() -> None:
    # The example of the Standard Webhooks reference implementations.
    body = b'{"test": 2432232314}'
    head = webhooks.headers("msg_p5jXN8AQM9LWM0D4loKWxJek", SECRET, body, 1614265330)
    assert head["webhook-signature"] == "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE="
    assert head["webhook-timestamp"] == "1614265330"


@pytest.mark.parametrize(
    "url",
    [
        "http://example.org/",
        "https://127.0.0.1/",
        "https://10.1.2.3/x",
        "https://169.254.169.254/latest/meta-data",
        "https://[::1]/",
        "https://[::ffff:10.0.0.1]/",
        "https://[fe80::1]/",
        "https://0.0.0.0/",
        "https://224.0.0.1/",
        "https://user:secret@example.org/",
        "https:///path",
        "https://example.org:99999/",
        "ftp://example.org/",
    ],
)
def test_refused_addresses(url: str) -> None:
    with pytest.raises(webhooks.RefusedError):
        webhooks.check(url)


def test_names_that_stand_for_private_addresses_are_refused() -> None:
    trust = ssl.create_default_context()
    with pytest.raises(webhooks.RefusedError, match="private"):
        webhooks.send("https://localhost:1/", {}, b"", trust, False)


class Receiver:
    """An https server on this machine."""

    def __init__(self, folder: Path) -> None:
        key = ec.generate_private_key(ec.SECP256R1())
        self.authority = folder / "authority.pem"
        name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "localhost")])
        import datetime

        moment = datetime.datetime.now(datetime.UTC)
        certificate = (
            x509.CertificateBuilder()
            .subject_name(name)
            .issuer_name(name)
            .public_key(key.public_key())
            .serial_number(1)
            .not_valid_before(moment - datetime.timedelta(hours=1))
            .not_valid_after(moment + datetime.timedelta(hours=1))
            .add_extension(x509.SubjectAlternativeName([x509.DNSName("localhost")]), False)
            .sign(key, hashes.SHA256())
        )
        pem = certificate.public_bytes(serialization.Encoding.PEM)
        self.authority.write_bytes(pem)
        private = folder / "private.pem"
        private.write_bytes(
            key.private_bytes(
                serialization.Encoding.PEM,
                serialization.PrivateFormat.PKCS8,
                serialization.NoEncryption(),
            )
        )
        self.got: list[tuple[dict[str, str], bytes]] = []
        self.statuses: list[int] = []
        receiver = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                length = int(self.headers["content-length"])
                receiver.got.append((dict(self.headers.items()), self.rfile.read(length)))
                self.send_response(receiver.statuses.pop(0) if receiver.statuses else 204)
                self.end_headers()

            def log_message(self, format: str, *args: Any) -> None:
                """Say nothing."""

        self.server = http.server.HTTPServer(("127.0.0.1", 0), Handler)
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(self.authority, private)
        self.server.socket = context.wrap_socket(self.server.socket, server_side=True)
        self.thread = threading.Thread(target=self.server.serve_forever)
        self.thread.start()

    @property
    def url(self) -> str:
        return f"https://localhost:{self.server.server_address[1]}/hook?x=1"

    def close(self) -> None:
        self.server.shutdown()
        self.thread.join()
        self.server.server_close()


@pytest.fixture
def receiver(tmp_path: Path) -> Iterator[Receiver]:
    server = Receiver(tmp_path)
    yield server
    server.close()


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    if request.param == "postgresql":
        made: str = request.getfixturevalue("postgresql")()
        return made
    return f"sqlite:///{tmp_path / 'records.sqlite'}"


def job(name: str, webhook: tuple[str, str] | None) -> NewJob:
    return NewJob(
        name, "ann", "squares", "r" * 64, name.ljust(64, "0"), 0, 5.0, False, webhook=webhook
    )


def test_a_message_arrives_once_the_job_ended(receiver: Receiver, url: str, tmp_path: Path) -> None:
    access = RecordAccess(open_database(url))
    settings = Settings(data=tmp_path, webhook_private=True, webhook_ca=receiver.authority)
    hooks = webhooks.Webhooks(settings, access)
    told = (receiver.url, SECRET)
    for new in (job("one", told), job("two", None), job("three", told)):
        access.write_now(records.insert, new)
    receiver.statuses = [500]  # the first attempt fails and is repeated

    async def scenario() -> None:
        sending = asyncio.create_task(hooks.loop())
        await asyncio.sleep(1.5)
        assert receiver.got == []  # no job ended yet
        held = access.write_now(claims.claim, "me", "bulk", 1, 9.0)
        assert [each.id for each in held] == ["one"]
        access.write_now(claims.succeed, "me", ["one"], False)
        async with asyncio.timeout(30):
            while len(receiver.got) < 2:
                await asyncio.sleep(0.05)
        sending.cancel()
        await asyncio.gather(sending, return_exceptions=True)

    asyncio.run(scenario())
    access.close()
    (_, first), (head, body) = receiver.got
    assert first == body
    document = json.loads(body)
    assert document["type"] == "job.succeeded"
    assert document["data"]["id"] == "one"
    content = f"one.{head['webhook-timestamp']}.".encode() + body
    key = base64.b64decode(SECRET.removeprefix("whsec_"))
    expected = base64.b64encode(hmac.new(key, content, hashlib.sha256).digest()).decode()
    assert head["webhook-signature"] == f"v1,{expected}"
    assert head["webhook-id"] == "one"
