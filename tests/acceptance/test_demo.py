"""The first thing a newcomer runs."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import xarray


def test_the_demo_computes_draws_and_checks(tmp_path: Path) -> None:
    out = tmp_path / "demo"
    command = [sys.executable, "-m", "vibroimpact.cli", "demo", "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    for name in ("momentum.png", "mode.png"):
        assert (out / name).read_bytes().startswith(b"\x89PNG")
    with xarray.open_dataset(out / "impact_modes.h5", engine="h5netcdf") as data:
        assert data.sizes["Omega"] == 6001
