"""Whether keys are needed, and that nobody listens to strangers by accident."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient
from typer.testing import CliRunner

from vibroimpact_service import cli
from vibroimpact_service.access.authenticator import ExposedError, keys_needed, loopback
from vibroimpact_service.access.commands import app as commands
from vibroimpact_service.app import create_app
from vibroimpact_service.settings import Settings


@pytest.mark.parametrize("host", ["127.0.0.1", "127.8.9.1", "::1", "localhost"])
def test_a_loopback_address_needs_no_keys(tmp_path: Path, host: str) -> None:
    assert loopback(host)
    assert not keys_needed(Settings(data=tmp_path, host=host))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "10.1.2.3", "example.org", ""])
def test_another_address_without_keys_is_refused(tmp_path: Path, host: str) -> None:
    with pytest.raises(ExposedError, match="vibroimpact keys create"):
        keys_needed(Settings(data=tmp_path, host=host))
    assert not keys_needed(Settings(data=tmp_path, host=host, access="open"))
    assert keys_needed(Settings(data=tmp_path, host=host, access="keys"))
    issuer = "https://issuer.example"
    assert keys_needed(Settings(data=tmp_path, host=host, oidc_issuer=issuer))


def test_serve_says_why_it_does_not_start(tmp_path: Path) -> None:
    run = CliRunner().invoke(cli.app, ["serve", "--host", "0.0.0.0", "--data", str(tmp_path)])
    assert run.exit_code == 2
    assert "VIBROIMPACT_ACCESS=open" in run.output


def test_the_application_does_not_start_either(tmp_path: Path, queue: Any) -> None:
    application = create_app(Settings(data=tmp_path, host="0.0.0.0"), queue)
    with pytest.raises(ExposedError), TestClient(application):
        pytest.fail("it started")


def test_the_command_line_makes_lists_and_revokes_keys(tmp_path: Path, queue: Any) -> None:
    run = CliRunner()
    data = ["--data", str(tmp_path)]
    made = run.invoke(commands, ["create", "ann", "--label", "laptop", "--scope", "read", *data])
    assert made.exit_code == 0
    header = {"Authorization": f"Bearer {made.output.strip()}"}
    settings = Settings(data=tmp_path, host="0.0.0.0")
    assert keys_needed(settings)
    listed = run.invoke(commands, ["list", *data]).output
    name, state, owner, scopes, _, label = listed.split()
    assert (state, owner, scopes, label) == ("valid", "ann", "read", "laptop")
    with TestClient(create_app(settings, queue)) as http:
        assert http.get("/v1/jobs", headers=header).status_code == 200
        assert run.invoke(commands, ["revoke", name, *data]).exit_code == 0
        assert http.get("/v1/jobs", headers=header).status_code == 401
    assert "revoked" in run.invoke(commands, ["list", *data]).output
    acts = run.invoke(commands, ["audit", *data]).output.splitlines()
    assert ["key revoked" in acts[0], "key created" in acts[1]] == [True, True]
    assert run.invoke(commands, ["revoke", "0" * 12, *data]).exit_code == 1
    assert run.invoke(commands, ["create", "a b", *data]).exit_code == 2
    # A revoked key still shows that keys are meant.
    assert keys_needed(settings)


def test_only_names_of_this_machine_are_answered_without_keys(tmp_path: Path, queue: Any) -> None:
    with TestClient(create_app(Settings(data=tmp_path), queue)) as http:
        for name in ("localhost", "127.0.0.1:8000", "[::1]:80", "LOCALHOST"):
            assert http.get("/v1/health/live", headers={"Host": name}).status_code == 200
        for name in ("evil.example", "localhost.evil.example", "127.0.0.1.evil", "", "a:b"):
            answer = http.get("/v1/health/live", headers={"Host": name})
            assert answer.status_code == 421
            assert answer.json()["code"] == "misdirected"
    chosen = Settings(data=tmp_path, hosts=("vibro.example",))
    with TestClient(create_app(chosen, queue), base_url="http://vibro.example") as http:
        assert http.get("/v1/health/live").status_code == 200
        assert http.get("/v1/health/live", headers={"Host": "localhost"}).status_code == 421
