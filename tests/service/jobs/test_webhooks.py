"""Messages at the end of jobs: what is signed, where none goes, and that one arrives."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import hashlib
import hmac
import http.server
import json
import socket
import ssl
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec

from vibroimpact_service.jobs import claims, records, sealing, webhooks
from vibroimpact_service.jobs.database import open_database
from vibroimpact_service.jobs.record_access import RecordAccess
from vibroimpact_service.jobs.records import NewJob
from vibroimpact_service.jobs.tables import webhooks as table
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
        "https://[64:ff9b::10.0.0.1]/",
        "https://[64:ff9b::7f00:1]/",
        "https://[64:ff9b:1::1.1.1.1]/",
        "https://[2002:7f00:1::]/",
        "https://[2002:a00:1::1]/",
        "https://[::127.0.0.1]/",
        "https://[::a9fe:a9fe]/",
        "https://[2001:0:7f00:1::1]/",
        "https://[2a00:1450:4001:80b:0:5efe:10.0.0.1]/",
        "https://[fe80::1%25eth0]/",
        "https://[fec0::1]/",
        "https://[feff::1]/",
        "https://[4000::1]/",
        "https://[fc00::1]/",
        "https://[3fff::1]/",
        "https://[2001:db8::1]/",
        "https://[2001:2::1]/",
        "https://[::2]/",
        "https://192.0.0.9/",
        "https://192.88.99.1/",
        "https://100.64.0.1/",
        "https://240.0.0.1/",
        "https://255.255.255.255/",
        "https://2130706433/",
        "https://0x7f000001/",
        "https://017700000001/",
        "https://127.1/",
        "https://0x7f.1/",
        "https://1.1.1/",
        "https://127.0.0.1./",
        "https://127.0.0.0x1/",
        "https://\uff11\uff12\uff17.0.0.1/",
        "https://\u2488\u2488.1/",
        "https://localhost/",
        "https://a.LOCALHOST./",
        "https://user:secret@example.org/",
        "https:///path",
        "https://example.org:99999/",
        "ftp://example.org/",
    ],
)
def test_refused_addresses(url: str) -> None:
    with pytest.raises(webhooks.RefusedError):
        webhooks.check(url)


@pytest.mark.parametrize(
    "url",
    [
        "https://1.1.1.1/",
        "https://[2606:4700::1111]:8443/",
        "https://[64:ff9b::1.1.1.1]/",
        "https://hooks.example.org/x?y=1",
        "https://4.example/",
        "https://b\u00fccher.example/",
    ],
)
def test_accepted_addresses(url: str) -> None:
    assert webhooks.check(url)[1] in (443, 8443)


@pytest.mark.parametrize(
    "address",
    ["127.0.0.1", "64:ff9b::7f00:1", "2002:7f00:1::", "::10.0.0.1", "fe80::1%lo", "fec0::1"],
)
def test_names_that_stand_for_private_addresses_are_refused(
    monkeypatch: pytest.MonkeyPatch, address: str
) -> None:
    resolved = [(0, 0, 0, "", (address, 443))]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: resolved)
    trust = ssl.create_default_context()
    with pytest.raises(webhooks.RefusedError, match="private"):
        asyncio.run(webhooks.send("https://hooks.example:443/", {}, b"", trust, False))


class Receiver:
    """An https server on this machine."""

    def __init__(self, folder: Path) -> None:
        key = ec.generate_private_key(ec.SECP256R1())
        self.authority = folder / "authority.pem"
        name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, folder.name)])
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
        self.drips = False
        self.closing = threading.Event()
        receiver = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                length = int(self.headers["content-length"])
                receiver.got.append((dict(self.headers.items()), self.rfile.read(length)))
                while receiver.drips and not receiver.closing.wait(0.1):
                    with contextlib.suppress(OSError):
                        self.wfile.write(b"x")
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
        self.closing.set()
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
    counted: list[str] = []
    hooks = webhooks.Webhooks(settings, access, sealing.of_settings(settings), counted.append)
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
        async with asyncio.timeout(60):
            while len(counted) < 2:
                await asyncio.sleep(0.05)
        sending.cancel()
        await asyncio.gather(sending, return_exceptions=True)

    asyncio.run(scenario())
    access.close()
    assert counted == ["failed", "delivered"]
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


def test_a_receiver_that_drips_holds_up_no_others(
    url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for folder in ("dripping", "good"):
        (tmp_path / folder).mkdir()
    dripping, good = Receiver(tmp_path / "dripping"), Receiver(tmp_path / "good")
    dripping.drips = True
    authorities = tmp_path / "authorities.pem"
    authorities.write_bytes(dripping.authority.read_bytes() + good.authority.read_bytes())
    settings = Settings(data=tmp_path, webhook_private=True, webhook_ca=authorities)
    access = RecordAccess(open_database(url))
    monkeypatch.setattr(webhooks, "_SECONDS", 3600.0)  # none to the other one ends in this test
    hooks = webhooks.Webhooks(settings, access, sealing.of_settings(settings))
    names = [f"drip{i}" for i in range(40)]
    for new in (
        *(job(name, (dripping.url, SECRET)) for name in names),
        job("one", (good.url, SECRET)),
    ):
        access.write_now(records.insert, new)

    async def scenario() -> None:
        access.write_now(claims.claim, "me", "bulk", 50, 1000.0)
        access.write_now(claims.succeed, "me", [*names, "one"], False)
        sending = asyncio.create_task(hooks.loop())
        while not good.got or not dripping.got:
            await asyncio.sleep(0.05)
        sending.cancel()
        # At once, whatever the receiver does, which goes on for as long as this test.
        await asyncio.gather(sending, return_exceptions=True)

    def waiting(connection: sa.Connection) -> int:
        return int(connection.execute(sa.select(sa.func.count()).select_from(table)).scalar_one())

    try:
        asyncio.run(scenario())
        # What was on its way when the process stopped is still to be sent.
        assert access.read_now(waiting) >= len(names)

        trust = ssl.create_default_context(cafile=str(authorities))
        monkeypatch.setattr(webhooks, "_SECONDS", 1.0)
        head = webhooks.headers("drip0", SECRET, b"{}")
        with pytest.raises(TimeoutError):  # or it would be read for ever
            asyncio.run(webhooks.send(dripping.url, head, b"{}", trust, True))
    finally:
        access.close()
        dripping.close()
        good.close()
