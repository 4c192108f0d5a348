"""Tokens of an OpenID Connect issuer that runs in this process."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import jwt
import pytest
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from starlette.testclient import TestClient

from vibroimpact_service.access.tokens import Tokens
from vibroimpact_service.app import create_app
from vibroimpact_service.settings import Settings


class Issuer:
    """An issuer on a loopback port: says what its keys are, and signs."""

    def __init__(self) -> None:
        self.keys = {"one": rsa.generate_private_key(public_exponent=65537, key_size=2048)}
        self.asked = 0
        issuer = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                issuer.asked += self.path == "/jwks"
                text = json.dumps(issuer.document(self.path)).encode()
                self.send_response(200)
                self.send_header("Content-Length", str(len(text)))
                self.end_headers()
                self.wfile.write(text)

            def log_message(self, *_: Any) -> None:
                """Say nothing."""

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_address[1]}"
        self.thread = threading.Thread(target=self.server.serve_forever, daemon=True)
        self.thread.start()

    def document(self, path: str) -> Any:
        if path == "/.well-known/openid-configuration":
            return {"issuer": self.url, "jwks_uri": f"{self.url}/jwks"}
        algorithm = jwt.algorithms.RSAAlgorithm
        shown = [
            {**algorithm.to_jwk(key.public_key(), as_dict=True), "kid": name, "alg": "RS256"}
            for name, key in self.keys.items()
        ]
        return {"keys": [*shown, {"kty": "none", "kid": "odd"}]}

    def token(self, key: Any = None, kid: str = "one", alg: str = "RS256", **claims: Any) -> str:
        now = int(time.time())
        whole = {
            "iss": self.url, "aud": "vibroimpact", "sub": "ann", "iat": now, "exp": now + 300,
            "scope": "openid vibroimpact:read vibroimpact:submit",
        }  # fmt: skip
        whole = {name: value for name, value in (whole | claims).items() if value is not None}
        return jwt.encode(whole, key or self.keys["one"], alg, headers={"kid": kid})


@pytest.fixture(scope="module")
def issuer() -> Iterator[Issuer]:
    found = Issuer()
    yield found
    found.server.shutdown()
    found.server.server_close()
    found.thread.join()


@pytest.fixture
def served(settings: Settings, queue: Any, issuer: Issuer) -> Iterator[TestClient]:
    chosen = settings.model_copy(update={"oidc_issuer": issuer.url})
    with TestClient(create_app(chosen, queue)) as client:
        yield client


def status(http: TestClient, token: str, method: str = "GET") -> int:
    headers = {"Authorization": f"Bearer {token}"}
    return http.request(method, "/v1/jobs", headers=headers).status_code


def test_a_good_token_is_its_subject(
    served: TestClient, issuer: Issuer, request_body: dict[str, Any]
) -> None:
    asked = issuer.asked
    for _ in range(3):
        assert status(served, issuer.token()) == 200
    assert issuer.asked == asked + 1
    job = {"kind": "impact-modes", "request": request_body}
    ann = {"Authorization": f"Bearer {issuer.token()}"}
    bob = {"Authorization": f"Bearer {issuer.token(sub='bob')}"}
    made = served.post("/v1/jobs", json=job, headers=ann)
    assert made.status_code == 201
    assert served.get(made.headers["location"], headers=ann).status_code == 200
    assert served.get(made.headers["location"], headers=bob).status_code == 404


def test_scopes_are_those_of_the_token(served: TestClient, issuer: Issuer) -> None:
    assert status(served, issuer.token(scope="read submit")) == 403
    assert status(served, issuer.token(scope=None)) == 403
    assert status(served, issuer.token(scope="vibroimpact:read")) == 200
    assert status(served, issuer.token(scope=None, scp=["vibroimpact:read"])) == 200
    assert status(served, issuer.token(scope="vibroimpact:read"), "POST") == 403
    assert status(served, issuer.token(scope=7)) == 403


def test_bad_tokens_are_refused(served: TestClient, issuer: Issuer) -> None:
    other = rsa.generate_private_key(public_exponent=65537, key_size=2048)
    curve = ec.generate_private_key(ec.SECP256R1())
    public = issuer.keys["one"].public_key()
    bad = [
        issuer.token(key=other),
        issuer.token(key=curve, alg="ES256"),
        issuer.token(kid="unknown"),
        issuer.token(exp=int(time.time()) - 120),
        issuer.token(exp=None),
        issuer.token(sub=None),
        issuer.token(sub="ann\ud800"),
        issuer.token(kid="\udfff"),
        issuer.token(aud="another"),
        issuer.token(aud=None),
        issuer.token(iss="https://elsewhere.example"),
        issuer.token(nbf=int(time.time()) + 600),
        issuer.token()[:-4] + "AAAA",
        jwt.encode({"sub": "ann"}, key="", algorithm="none", headers={"kid": "one"}),
        jwt.encode(
            {"sub": "ann"}, key=str(public.public_numbers().n), algorithm="HS256",
            headers={"kid": "one"},
        ),
    ]  # fmt: skip
    for token in bad:
        assert status(served, token) == 401, token


def test_unknown_key_ids_do_not_press_the_issuer(served: TestClient, issuer: Issuer) -> None:
    assert status(served, issuer.token()) == 200
    asked = issuer.asked
    for number in range(20):
        assert status(served, issuer.token(kid=f"k{number}")) == 401
    assert issuer.asked == asked


@pytest.mark.needs("a server")
def test_an_issuer_who_is_away_is_no_fault_of_the_token(settings: Settings, queue: Any) -> None:
    chosen = settings.model_copy(update={"oidc_issuer": "http://127.0.0.1:9"})
    token = jwt.encode({"sub": "a"}, "s" * 32, headers={"kid": "one"})
    with TestClient(create_app(chosen, queue)) as http:
        answer = http.get("/v1/jobs", headers={"Authorization": f"Bearer {token}"})
    assert answer.status_code == 503
    assert answer.headers["retry-after"]


def test_an_issuer_without_https_is_none() -> None:
    with pytest.raises(ValueError, match="https"):
        Tokens("http://issuer.example", "vibroimpact", "")
