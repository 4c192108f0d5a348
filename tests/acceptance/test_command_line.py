"""The client's commands as users run them: files and pipes, JSON, plots, exit codes."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import pytest

from tests.acceptance.conftest import Service
from vibroimpact.cli.exits import CODES

REQUEST = {
    "system": {"preset": "chain", "n": 13, "constraints": [{"dof": 5, "gap": 0.2}]},
    "frequency": {"start": 0.6, "stop": 2.4, "num": 20},
}


class Shell:
    """Runs commands in a folder with a configuration of its own."""

    def __init__(
        self, folder: Path, url: str, run: Callable[..., subprocess.CompletedProcess[str]]
    ) -> None:
        self.folder, self.run = folder, run
        self.file = folder / "request.json"
        self.file.write_text(json.dumps(REQUEST))
        self.url = url

    def __call__(
        self, *arguments: str, text: str | None = None, url: str | None = ""
    ) -> subprocess.CompletedProcess[str]:
        environment = {k: v for k, v in os.environ.items() if not k.startswith("VIBROIMPACT_")}
        environment |= {"VIBROIMPACT_CONFIG": str(self.folder / "config.toml"), "COLUMNS": "200"}
        if url is not None:
            environment["VIBROIMPACT_URL"] = url or self.url
        return self.run(*arguments, text=text or "", environment=environment, folder=self.folder)


@pytest.fixture
def shell(
    service: Service, tmp_path: Path, commands: Callable[..., subprocess.CompletedProcess[str]]
) -> Shell:
    return Shell(tmp_path, service.url, commands)


def printed(done: subprocess.CompletedProcess[str]) -> Any:
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_kinds_may_be_spelled_as_in_python(shell: Shell) -> None:
    shell.file.write_text(json.dumps({"system": REQUEST["system"], "count": 3}))
    for kind in ("natural-frequencies", "natural_frequencies"):
        assert len(printed(shell("compute", kind, "request.json", "--json"))["Omega"]) == 3
    table = shell("compute", "natural_frequencies", "request.json", url=None).stdout
    assert ["mode", "Omega", "error"] in [line.split() for line in table.splitlines()]
    assert shell("plan", "natural_frequencies", "request.json").returncode == 0
    assert shell("compute", "natural_modes", "request.json", "--json").returncode != 0


def test_what_has_no_effect_is_said_on_standard_error(shell: Shell) -> None:
    stop = {"dof": 0, "gap": 1.0, "restitution": 0.7}
    system = {"M": [[1.0]], "K": [[1.0]], "C": [[0.1]], "constraints": [stop]}
    request = {"system": system, "frequency": {"values": [1.5]}}
    shell.file.write_text(json.dumps(request))
    for url in ("", None):  # by a service, and in the process of the command
        done = shell("compute", "impact-modes", "request.json", "--json", url=url)
        assert len(printed(done)["neglected"]) == 2
        said = [line for line in done.stderr.splitlines() if "energy loss" in line]
        assert [line.partition(":")[0] for line in said] == ["caution", "caution"]
        assert "Warning" not in done.stderr
    job = shell("submit", "impact-modes", "request.json").stdout.strip()
    done = shell("wait", job)
    assert done.returncode == 0
    done = shell("result", job, "-o", "out.h5")
    assert done.stderr.count("caution: ") == 2


def test_a_request_becomes_a_file_a_plot_and_json(shell: Shell) -> None:
    done = shell("compute", "impact-modes", "request.json", "-o", "out.h5", "--plot", "out.png")
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
    with h5py.File(shell.folder / "out.h5") as file:
        impulse = file["impulse"][()]
    assert (shell.folder / "out.png").read_bytes().startswith(b"\x89PNG")
    document = printed(shell("compute", "impact-modes", "--json", text=json.dumps(REQUEST)))
    assert document["impulse"] == impulse.tolist()


def test_a_job_is_queued_waited_for_and_fetched(shell: Shell) -> None:
    name = shell("submit", "impact-modes", "request.json", "--priority", "3").stdout.strip()
    assert name.startswith("job_")
    assert printed(shell("wait", name, "--json"))["state"] == "succeeded"
    assert name in [job["id"] for job in printed(shell("jobs", "--json", "--limit", "100"))]
    assert name in shell("jobs", "--state", "succeeded").stdout
    assert printed(shell("result", name, "--json"))["kind"] == "impact-modes"
    assert shell("result", name, "-o", "job.h5").stdout == "job.h5\n"
    assert printed(shell("plan", "impact-modes", "request.json", "--json"))["steps"]


@pytest.mark.parametrize(
    ("arguments", "text", "url", "code", "said"),
    [
        (("compute", "impact-modes"), "{}", "", 2, "/system: this field is required"),
        (("compute", "impact-modes"), "[]", "", 2, "a request is a JSON object"),
        (("compute", "impact-modes", "none.json"), None, "", 1, "none.json"),
        (("result", "job_none"), None, "", 2, "no such job"),
        (("jobs",), None, None, 2, "vibroimpact login URL"),
    ],
)
def test_exit_codes(
    shell: Shell,
    arguments: tuple[str, ...],
    text: str | None,
    url: str | None,
    code: int,
    said: str,
) -> None:
    done = shell(*arguments, text=text, url=url)
    assert done.returncode == code
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert f"{code} " in CODES


def test_without_a_service_the_computation_is_done_in_the_process(shell: Shell) -> None:
    here = printed(shell("compute", "impact-modes", "request.json", "--json", url=None))
    there = printed(shell("compute", "impact-modes", "request.json", "--json"))
    del here["plan"], there["plan"]
    assert here == there
    refused = shell("compute", "impact-modes", text="{}", url=None)
    assert (refused.returncode, "/system: this field" in refused.stderr) == (2, True)


def test_login_keeps_the_address_and_doctor_tells_it(shell: Shell) -> None:
    assert shell("login", shell.url, text="\n", url=None).returncode == 0
    path = shell.folder / "config.toml"
    assert path.stat().st_mode & 0o077 == 0
    assert shell.url in path.read_text()
    done = shell("doctor", url=None)
    assert done.returncode == 0, done.stderr
    assert f"service: {shell.url}, without a key" in done.stdout
    assert "answer: version" in done.stdout
    told = json.loads(shell("doctor", "--json", url=None).stdout)
    assert told["service"] == f"{shell.url}, without a key"
    assert told["installed"]["service"] == "yes"


def test_completion_is_offered(shell: Shell) -> None:
    assert "--install-completion" in shell("--help").stdout
