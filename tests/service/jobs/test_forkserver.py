"""The process that workers are forked from."""

from __future__ import annotations

import subprocess
import sys


def test_workers_start_without_libraries_that_nobody_uses() -> None:
    """Dask would import all packages that any worker could use into the service too."""
    script = """
import sys
from vibroimpact_service.jobs import forkserver
from vibroimpact_service.jobs.dask_settings import CONFIG

if __name__ == "__main__":
    import dask
    from distributed.utils import get_mp_context

    dask.config.set(CONFIG)
    forkserver.start(())
    assert get_mp_context().get_start_method() == "forkserver"
    assert "pandas" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", script], check=True, timeout=120)
