"""A service that the client starts in a process of its own and stops when it is closed."""

from __future__ import annotations

import atexit
import importlib.util
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from vibroimpact.errors import EmbeddedServiceError

_START_SECONDS = 300.0
"""On a machine that is busy with other work; a service that has ended is noticed at once."""
_STOP_SECONDS = 15.0


class EmbeddedService:
    """A running service on a free loopback port; `data` is its folder, or a temporary one."""

    def __init__(self, data: str | Path | None = None) -> None:
        if importlib.util.find_spec("vibroimpact_service") is None:
            message = (
                "the service is not installed: give the address of a running one, "
                "or install it with  pip install 'vibroimpact[all]'"
            )
            raise EmbeddedServiceError(message)
        self._own = tempfile.TemporaryDirectory(prefix="vibroimpact-") if data is None else None
        self.data = Path(self._own.name if self._own is not None else str(data))
        self.data.mkdir(parents=True, exist_ok=True)
        self._log = (self.data / "service.log").open("ab")
        command = [sys.executable, "-m", "vibroimpact_service", "--host", "127.0.0.1"]
        self._process = subprocess.Popen(
            [*command, "--port", "0", "--data", str(self.data)],
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=self._log,
            # Ctrl-C goes to the program in the foreground; `close` stops the service.
            start_new_session=True,
        )
        atexit.register(self.close)
        try:
            self.url = self._address()
        except EmbeddedServiceError:
            self.close()
            raise

    def close(self) -> None:
        """Stop the service; its unfinished jobs stay on record."""
        atexit.unregister(self.close)
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(_STOP_SECONDS)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._log.close()
        if self._own is not None:
            self._own.cleanup()
            self._own = None

    def _address(self) -> str:
        """Wait until the service answers, and return its address."""
        deadline = time.monotonic() + _START_SECONDS
        while time.monotonic() < deadline:
            if self._process.poll() is not None:
                raise EmbeddedServiceError(f"the service did not start:\n{self._log_tail()}")
            try:
                announced = json.loads((self.data / "service.json").read_text())
            except (OSError, ValueError):
                announced = {}
            # The file may be that of an earlier service.
            if announced.get("pid") == self._process.pid:
                if "notice" in announced:
                    sys.stderr.write(announced["notice"] + "\n")
                return str(announced["url"])
            time.sleep(0.02)
        raise EmbeddedServiceError(f"the service does not answer:\n{self._log_tail()}")

    def _log_tail(self) -> str:
        return (self.data / "service.log").read_text(errors="replace")[-2000:]
