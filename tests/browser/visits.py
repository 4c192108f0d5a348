"""A service in a process of its own, and pages that are watched."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
import urllib.request
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote, urlsplit

from playwright.sync_api import BrowserContext, Page, Response

LONG = 300_000
"""Milliseconds in which anything ends: kernels are loaded first, and jobs take their turn."""


@dataclass
class Service:
    """A service in a process of its own, which can be stopped and started again."""

    data: Path
    port: int = 0
    process: subprocess.Popen[bytes] | None = None
    url: str = ""

    def start(self) -> None:
        """Start it, and wait until its kernels are loaded."""
        note = self.data / "service.json"
        note.unlink(missing_ok=True)
        self.process = subprocess.Popen(
            [
                *(sys.executable, "-m", "vibroimpact_service"),
                *("--port", str(self.port), "--data", str(self.data)),
            ],
            env={**os.environ, "OMP_NUM_THREADS": "1", "VIBROIMPACT_WORKERS": "1"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        end = time.monotonic() + 900
        while not (note.exists() and self._warm(note)):
            if self.process.poll() is not None or time.monotonic() > end:
                self.stop()
                raise RuntimeError("the service did not start")
            time.sleep(0.1)

    def _warm(self, note: Path) -> bool:
        self.url = json.loads(note.read_text())["url"]
        self.port = urlsplit(self.url).port or 0
        try:
            with urllib.request.urlopen(f"{self.url}/v1/health/ready", timeout=10) as answer:
                return json.load(answer).get("kernels", "warm") == "warm"
        except OSError:
            return False

    def stop(self) -> None:
        """Stop it."""
        assert self.process is not None
        self.process.terminate()
        self.process.wait(60)


@dataclass
class Visit:
    """A page, what it asked for, and what it complained of."""

    page: Page
    url: str
    asked: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)

    def open(self, view: str = "modes", structure: object = None, **fields: object) -> Page:
        """Open a view; structure and fields are what its address says."""
        if structure is not None:
            fields = {"structure": structure, **fields}
        query = "&".join(f"{name}={quote(json.dumps(value))}" for name, value in fields.items())
        self.page.goto(f"{self.url}/#{view}?{query}")
        return self.page


def visit(context: BrowserContext, url: str) -> Visit:
    """Return a new page that is watched."""
    page = context.new_page()
    page.set_default_timeout(LONG)
    made = Visit(page, url)
    page.on("request", lambda request: made.asked.append(request.url))
    page.on("pageerror", lambda error: made.wrong.append(str(error)))
    page.on("console", lambda said: made.wrong.append(said.text) if said.type == "error" else None)
    return made


def received(page: Page) -> dict[str, int]:
    """Return the sizes of the files of the pages as they come: address -> bytes, compressed."""
    sizes: dict[str, int] = {}

    def note(answer: Response) -> None:
        length = answer.headers.get("content-length")
        if "/v1/" not in answer.url and "openapi.json" not in answer.url and length:
            sizes.setdefault(urlsplit(answer.url).path, int(length))

    page.on("response", note)
    return sizes
