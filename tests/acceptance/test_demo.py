"""The first thing a newcomer runs, and what it tells while kernels are compiled."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import xarray

NOTICE = re.compile(r"compiling kernels, about \d+ s, once")
CLIENT = """
import sys
import vibroimpact as vi
vi.Client(data=sys.argv[1]).close()
"""
SLOW_FLOW = {
    "system": {
        "preset": "oscillator", "Omega0": 1,
        "constraints": [{"dof": 0, "gap": 1, "restitution": 0.95}],
    },
    "model": "restitution",
    "variant": "printed",
    "initial": {"omega": 5},
    "t": {"start": 0, "stop": 2, "num": 5},
}  # fmt: skip


@pytest.fixture
def cold(tmp_path: Path) -> dict[str, str]:
    """Return an environment without compiled kernels, and without a service."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("VIBROIMPACT_")}
    places = {"NUMBA_CACHE_DIR": "kernels", "VIBROIMPACT_CONFIG": "config.toml"}
    return environment | {name: str(tmp_path / place) for name, place in places.items()}


def test_the_demo_computes_draws_and_checks(tmp_path: Path) -> None:
    out = tmp_path / "demo"
    command = [sys.executable, "-m", "vibroimpact.cli", "demo", "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=1000, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Kernels are kept in" in done.stdout  # all of them: nobody waits for one later
    for name in ("momentum.png", "mode.png"):
        assert (out / name).read_bytes().startswith(b"\x89PNG")
    with xarray.open_dataset(out / "impact_modes.h5", engine="h5netcdf") as data:
        assert data.sizes["Omega"] == 6001


def test_a_service_that_compiles_says_so_and_so_does_the_client_that_starts_it(
    tmp_path: Path, cold: dict[str, str]
) -> None:
    done = subprocess.run(
        [sys.executable, "-c", CLIENT, str(tmp_path / "data")],
        env=cold, capture_output=True, text=True, timeout=1000, check=True,
    )  # fmt: skip
    (line,) = done.stderr.splitlines()
    assert NOTICE.fullmatch(line)
    log = (tmp_path / "data" / "service.log").read_text().splitlines()
    records = [json.loads(record) for record in log if record.startswith("{")]
    assert line in [record["event"] for record in records]


def test_computing_without_a_service_says_so_once(tmp_path: Path, cold: dict[str, str]) -> None:
    for notices in (1, 0):
        done = subprocess.run(
            [sys.executable, "-m", "vibroimpact.cli", "compute", "slow-flow", "--json"],
            input=json.dumps(SLOW_FLOW),
            env=cold, capture_output=True, text=True, timeout=1000, check=True,
        )  # fmt: skip
        assert len(NOTICE.findall(done.stderr)) == notices, done.stderr
        assert json.loads(done.stdout)["kind"] == "slow-flow"
