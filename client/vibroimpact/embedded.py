"""A service of our own, in a process beside this one, for as long as it is needed."""

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

_START_SECONDS = 60.0
_STOP_SECONDS = 15.0


class EmbeddedService:
    """A running service on a free loopback port.

    Parameters
    ----------
    data : path, optional
        Folder for its records and results; absent: one that goes with it.
    """

    def __init__(self, data: str | Path | None = None) -> None:
        if importlib.util.find_spec("vibroimpact_service") is None:
            message = (
                "there is no service here: give the address of one, "
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
            # Ctrl-C is meant for the program in front; the service is stopped by `close`.
            start_new_session=True,
        )
        atexit.register(self.close)
        try:
            self.url = self._address()
        except EmbeddedServiceError:
            self.close()
            raise

    def close(self) -> None:
        """Stop it; its unfinished jobs stay on record."""
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
        """Wait until it answers, and return where."""
        deadline = time.monotonic() + _START_SECONDS
        while time.monotonic() < deadline:
            if self._process.poll() is not None:
                raise EmbeddedServiceError(f"the service did not start:\n{self._last_words()}")
            try:
                found = json.loads((self.data / "service.json").read_text())
            except (OSError, ValueError):
                found = {}
            # A file of an earlier service may still lie there.
            if found.get("pid") == self._process.pid:
                return str(found["url"])
            time.sleep(0.02)
        raise EmbeddedServiceError(f"the service does not answer:\n{self._last_words()}")

    def _last_words(self) -> str:
        return (self.data / "service.log").read_text(errors="replace")[-2000:]
