"""What a start of workers must not cost."""

from __future__ import annotations

import subprocess
import sys


def test_workers_start_without_libraries_that_nobody_uses() -> None:
    """Dask imports all that workers of others may want, where it is not kept from it."""
    script = """
import sys
from vibroimpact_service.jobs.engine import CONFIG, open_nursery

if __name__ == "__main__":
    import dask
    from distributed.utils import get_mp_context

    dask.config.set(CONFIG)
    open_nursery(())
    assert get_mp_context().get_start_method() == "forkserver"
    assert "pandas" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", script], check=True, timeout=120)
