"""What Dask does otherwise here than by default, and why."""

from __future__ import annotations

from typing import Any, Final

CONFIG: Final[dict[str, Any]] = {
    # A silent worker is given up late: it may run code that holds the GIL. The death of a worker
    # is noticed at once, by its connection.
    "distributed.scheduler.worker-ttl": "5 minutes",
    # Each death is judged by its cause: see `WorkerLostError`.
    "distributed.scheduler.allowed-failures": 0,
    "distributed.comm.timeouts.tcp": "15s",
    "distributed.comm.timeouts.connect": "15s",
    "distributed.admin.tick.limit": "30s",
    # A local cluster gives up for good a worker that is being restarted when an earlier death of
    # it is this long ago: with the default of 15 s, two deaths can cost the worker.
    "distributed.deploy.lost-worker-timeout": "3650 days",
    # The default of `multiprocessing`, which `forkserver` sets. Named here, Dask would first import
    # many packages into that process that no worker uses, pandas among them.
    "distributed.worker.multiprocessing-method": None,
    # Measurements that Dask makes of itself all the time, in every process.
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.admin.system-monitor.disk": False,
    "distributed.admin.system-monitor.gil.enabled": False,
    "distributed.diagnostics.nvml": False,
    # The limit of memory is kept by the operating system: see `worker`.
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": False,
    "distributed.client.scheduler-info-interval": "5 minutes",
    # Source lines from which calls are submitted.
    "distributed.diagnostics.computations.nframes": 0,
    # There are never many calls to be moved: each user has a few per worker at a time.
    "distributed.scheduler.work-stealing-interval": "1s",
    # A result has one copy, and is removed as soon as it has been fetched.
    "distributed.scheduler.active-memory-manager.start": False,
    # The status pages of Dask have no authentication.
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}
