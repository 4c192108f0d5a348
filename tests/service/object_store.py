"""A real server that speaks S3, as a process of its own."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path


class Server:
    """moto's server; what it holds ends with it. `host` and `within` as for `PostgreSQL`."""

    def __init__(
        self, log: Path, host: str = "127.0.0.1", within: Sequence[str] = (), port: int = 0
    ) -> None:
        if not port:
            with socket.socket() as free:
                free.bind(("127.0.0.1", 0))
                port = free.getsockname()[1]
        self.url = f"http://{host}:{port}"
        command = [*within, sys.executable, "-m", "moto.server", "-H", host, "-p", str(port)]
        with log.open("wb") as file:
            self.process = subprocess.Popen(command, stdout=file, stderr=file)
        end = time.monotonic() + 90
        while True:
            with socket.socket() as trial:
                if trial.connect_ex((host, port)) == 0:
                    return
            assert self.process.poll() is None, log.read_text()
            assert time.monotonic() < end, "no server"
            time.sleep(0.05)
