"""A large result goes through the client in little memory, whatever its size.

``VIBROIMPACT_LARGE=1000 pytest -n 0 tests/client/test_memory.py`` does the same with 1 GB.
"""

from __future__ import annotations

import functools
import http.server
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import h5py
import pytest

MEGABYTES = int(os.environ.get("VIBROIMPACT_LARGE", "200"))
DIGEST = "cd" * 32
ALLOWED = 96
"""Megabytes of address space beyond what the client has after its imports."""

PROGRAM = f"""
import re, resource, sys
import vibroimpact as vi

vi.Client(sys.argv[1]).close()
pages = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (pages + {ALLOWED} * 2**20,) * 2)
peak = lambda: int(re.search(r"VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1])
before = peak()
with vi.Client(sys.argv[1]) as client:
    result = client.result("{DIGEST}", "result.h5")
with result.open() as file:
    x = file["x"]
    last = max(float(x[row : row + 2**17].max()) for row in range(0, x.shape[0], 2**17))
assert type(result) is vi.TimeHistory
print(last, (peak() - before) // 1024)
"""


class Quiet(http.server.SimpleHTTPRequestHandler):
    """Serves the folder of results without a log."""

    def log_message(self, *_: object) -> None:
        """Say nothing."""


@pytest.fixture
def url(tmp_path: Path) -> Iterator[str]:
    folder = tmp_path / "v1" / "results"
    folder.mkdir(parents=True)
    with h5py.File(folder / DIGEST, "w") as file:
        head = {"kind": "time-history", "digest": DIGEST, "solver_version": "1"}
        file.attrs.update(head | {"request": "{}", "plan": "{}"})
        x = file.create_dataset("x", (MEGABYTES * 2**17,), "f8", chunks=(2**17,))
        for row in range(0, x.shape[0], 2**17):
            x[row : row + 2**17] = row // 2**17
    handler = functools.partial(Quiet, directory=str(tmp_path))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def test_a_large_result_needs_little_memory(url: str, tmp_path: Path) -> None:
    command = [sys.executable, "-c", PROGRAM, url]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    largest, megabytes = done.stdout.split()
    assert float(largest) == MEGABYTES - 1
    assert int(megabytes) < 40
    print(f"{MEGABYTES} MB through {megabytes} MB")
