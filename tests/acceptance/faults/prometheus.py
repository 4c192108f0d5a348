"""A Prometheus of the tests' own, with the configuration and alerts of docker/monitoring."""

from __future__ import annotations

import re
import shutil
import socket
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import httpx2
import pytest
import yaml
from processes import Process, until

FOLDER = Path(__file__).parents[3] / "docker" / "monitoring"
WINDOW = "12s"


def free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port: int = free.getsockname()[1]
        return port


def program(name: str) -> str:
    """Return the path of a program of Prometheus; without it the test is skipped."""
    path = shutil.which(name)
    if path is None:
        pytest.skip(f"{name} is not installed: apt install prometheus")
    return path


def hurried(rules: str, **thresholds: str) -> str:
    """Return alerts that wait for seconds where they wait for minutes, with other thresholds."""
    rules = re.sub(r"\bfor: \d+m\b", "for: 1s", rules)
    rules = re.sub(r"\[\d+m\]", f"[{WINDOW}]", rules)
    for alert, threshold in thresholds.items():
        pattern = rf"(alert: {alert}\n(?:.*\n)*?.*) > [0-9.]+$"
        rules, count = re.subn(pattern, rf"\1 > {threshold}", rules, count=1, flags=re.M)
        assert count == 1, alert
    return rules


class Prometheus(Process):
    """A server that asks some targets for their metrics every second."""

    def __init__(self, folder: Path, targets: Sequence[str], **thresholds: str) -> None:
        folder.mkdir()
        settings = yaml.safe_load((FOLDER / "prometheus.yaml").read_text())
        settings["global"] = {"scrape_interval": "1s", "evaluation_interval": "1s"}
        (job,) = settings["scrape_configs"]
        assert job.pop("dns_sd_configs")
        job["static_configs"] = [{"targets": list(targets)}]
        (folder / "prometheus.yaml").write_text(yaml.safe_dump(settings))
        rules = hurried((FOLDER / "alerts.yaml").read_text(), **thresholds)
        (folder / "alerts.yaml").write_text(rules)
        address = f"127.0.0.1:{free_port()}"
        command = [
            program("prometheus"),
            f"--config.file={folder / 'prometheus.yaml'}",
            f"--storage.tsdb.path={folder / 'data'}",
            f"--web.listen-address={address}",
        ]
        super().__init__(command, folder)
        self.http = httpx2.Client(base_url=f"http://{address}", timeout=10)
        until(self._answers, "Prometheus does not answer")

    def _answers(self) -> bool:
        assert self.process.poll() is None, self.errors.read_text()
        try:
            return bool(self.http.get("/-/ready").is_success)
        except httpx2.TransportError:
            return False

    def query(self, expression: str) -> list[dict[str, Any]]:
        """Return the present values of an expression."""
        answer = self.http.get("/api/v1/query", params={"query": expression})
        assert answer.status_code == 200, answer.text
        result: list[dict[str, Any]] = answer.json()["data"]["result"]
        return result

    def firing(self) -> set[str]:
        """Return the names of the alerts that fire."""
        alerts = self.http.get("/api/v1/alerts").json()["data"]["alerts"]
        return {each["labels"]["alertname"] for each in alerts if each["state"] == "firing"}

    def targets(self) -> list[dict[str, Any]]:
        """Return what Prometheus says of its targets."""
        found: list[dict[str, Any]] = self.http.get("/api/v1/targets").json()["data"][
            "activeTargets"
        ]
        return found

    def end(self) -> None:
        """End it."""
        self.http.close()
        super().end()
