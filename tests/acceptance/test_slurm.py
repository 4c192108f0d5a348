"""docker/slurm/workers.sbatch with a real worker, which does a job for a service: all but SLURM.

A double of `srun` starts the command on this machine, as srun does on the nodes.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.acceptance.conftest import Service
from vibroimpact_service.jobs import certificates
from vibroimpact_solvers.kernels import cache

SCRIPT = Path(__file__).parents[2] / "docker" / "slurm" / "workers.sbatch"
COMMAND = "import sys; from vibroimpact.cli import main; sys.argv[0] = 'vibroimpact'; main()"
REQUEST = {
    "system": {"preset": "chain", "n": 40, "constraints": [{"dof": 5, "gap": 0.2}]},
    "frequency": {"start": 0.6, "stop": 2.4, "num": 20_000},
    "outputs": ["impulse", "exists"],
}


def program(place: Path, text: str) -> None:
    place.write_text(text)
    place.chmod(0o755)


@pytest.fixture
def running() -> Iterator[Callable[..., subprocess.Popen[bytes]]]:
    """Return the function that starts a command in a session of its own, which ends with it."""
    processes: list[subprocess.Popen[bytes]] = []

    def start(command: list[str], environment: dict[str, str], output: Path) -> object:
        with output.open("wb") as opened:
            processes.append(
                subprocess.Popen(
                    command, env=os.environ | environment, stdout=opened, stderr=opened,
                    start_new_session=True,
                )
            )  # fmt: skip
        return processes[-1]

    yield start
    for process in processes:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait(60)


def test_workers_of_the_script_do_a_job(
    start: Callable[..., Service],
    running: Callable[..., subprocess.Popen[bytes]],
    tmp_path: Path,
) -> None:
    tls = [str(path) for path in certificates.write(tmp_path / "tls", days=2)]
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tls://127.0.0.1:{free.getsockname()[1]}"
    store = str(tmp_path / "store")
    words = ["scheduler", "--port", address.rsplit(":", 1)[1], "--tls", str(tmp_path / "tls")]
    running([sys.executable, "-c", COMMAND, *words], {}, tmp_path / "scheduler.txt")
    ca, cert, key = tls
    settings = {"scheduler": address, "store": store, "tls_ca": ca, "tls_cert": cert}
    service = start(tmp_path / "data", **settings, tls_key=key)
    assert service.http.get("/v1/health/ready").status_code == 503  # there are no workers

    # A node has the programs of the environment that the user has made, and SLURM's variables.
    node = tmp_path / "node"
    node.mkdir()
    program(node / "vibroimpact", f'#!/bin/sh\nexec {sys.executable} -c "{COMMAND}" "$@"\n')
    program(node / "srun", '#!/bin/sh\necho "memory $VIBROIMPACT_WORKER_MEMORY_BYTES"\nexec "$@"\n')
    kernels = cache.folder()
    assert kernels is not None
    output = tmp_path / "slurm-1.out"
    batch = running(
        ["bash", str(SCRIPT), address],
        {
            "PATH": f"{node}:{os.environ['PATH']}",
            "SLURM_CPUS_PER_TASK": "1",
            "SLURM_MEM_PER_CPU": "1024",
            "VIBROIMPACT_STORE": store,
            "VIBROIMPACT_TLS": str(tmp_path / "tls"),
            "NUMBA_CACHE_DIR": str(kernels.parent),  # not compiled anew
        },
        output,
    )
    service.wait_ready()
    answer = service.http.post("/v1/jobs", json={"kind": "impact-modes", "request": REQUEST})
    job = answer.json()["id"]
    end = time.monotonic() + 120
    while not (state := service.http.get(f"/v1/jobs/{job}", params={"wait": 20}).json())["final"]:
        assert time.monotonic() < end, (state, output.read_text())
    assert state["state"] == "succeeded", state
    assert f"memory {1024 * 2**20}\n" in output.read_text()

    # SLURM sends SIGTERM to the processes of the step 60 s before the time is up.
    os.killpg(batch.pid, signal.SIGTERM)
    batch.wait(60)
    end = time.monotonic() + 60
    while service.http.get("/v1/health/ready").status_code != 503:
        assert time.monotonic() < end, "workers are left"
        time.sleep(0.1)
