"""The only module that knows Dask: workers of our own, or those of a scheduler elsewhere."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from typing import Any

import dask
import structlog
from distributed import Client, Future, LocalCluster, Security
from distributed.scheduler import KilledWorker

from vibroimpact_service.settings import Settings

# A worker is declared dead late: code that holds the GIL must not be mistaken for a corpse.
_CONFIG = {
    "distributed.scheduler.worker-ttl": "5 minutes",
    "distributed.scheduler.allowed-failures": 2,
    "distributed.comm.timeouts.tcp": "15s",
    "distributed.comm.timeouts.connect": "15s",
    "distributed.admin.tick.limit": "30s",
    # Dask's status pages know no keys: they show nothing.
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}
LANES = ("fast", "bulk")
_RETRY_SECONDS = 3.0

log = structlog.get_logger("vibroimpact.engine")


class EngineUnavailableError(RuntimeError):
    """There are no workers to be had at the moment."""


class WorkerLostError(RuntimeError):
    """A piece of work killed its worker again and again."""


class Engine:
    """Runs functions in worker processes, in two lanes that do not wait for one another."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._client: Client | None = None
        self._cluster: LocalCluster | None = None
        self._ready = threading.Event()
        self._closing = threading.Event()
        self.failure: str | None = None
        self.quarantine = threading.Lock()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Begin to start the workers, in the background."""
        self._thread = threading.Thread(target=self._start, name="engine-start", daemon=True)
        self._thread.start()

    @property
    def ready(self) -> bool:
        """Whether work can be given to workers now."""
        return (
            self._ready.is_set()
            and self._client is not None
            and bool(self._client.status == "running")
        )

    def wait_ready(self, seconds: float) -> bool:
        """Wait until there are workers; whether there are."""
        return self._ready.wait(seconds)

    def submit(
        self,
        key: str,
        lane: str,
        priority: int,
        done: Callable[[Future], None],
        function: Callable[..., Any],
        *args: Any,
    ) -> Future:
        """Give one call to a worker; `done` is called with the future when it ended."""
        if self._client is None or not self.ready:
            raise EngineUnavailableError
        future = self._client.submit(
            function, *args, key=key, resources={lane: 1}, priority=priority, pure=False
        )
        future.add_done_callback(done)
        return future

    @staticmethod
    def outcome(future: Future) -> BaseException | None:
        """Return what a finished call raised, or None."""
        if future.status == "finished":
            return None
        if future.status in ("cancelled", "lost"):
            return EngineUnavailableError("the workers went away")
        error = future.exception(timeout=10)
        if isinstance(error, KilledWorker):
            return WorkerLostError("the computation killed its worker")
        return error if isinstance(error, BaseException) else RuntimeError(repr(error))

    @staticmethod
    def forget(futures: Sequence[Future]) -> None:
        """Cancel calls that nobody waits for any more."""
        for future in futures:
            future.cancel(force=True)

    def close(self) -> None:
        """Stop the workers that were started here."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join(timeout=30)
        self._ready.clear()
        if self._client is not None:
            self._client.close(timeout=5)
        if self._cluster is not None:
            self._cluster.close(timeout=10)

    def _start(self) -> None:
        logging.getLogger("distributed").setLevel(logging.ERROR)
        dask.config.set(_CONFIG)
        while not self._closing.is_set():
            try:
                if self._settings.scheduler is None:
                    self._start_own()
                else:
                    self._connect(self._settings.scheduler)
            except Exception as error:
                self.failure = f"{type(error).__name__}: {error}"
                log.warning("the workers did not start", error=self.failure)
                self._closing.wait(_RETRY_SECONDS)
            else:
                self.failure = None
                self._ready.set()
                return

    def _start_own(self) -> None:
        security = Security.temporary()
        self._cluster = LocalCluster(
            n_workers=self._settings.workers,
            threads_per_worker=self._settings.threads,
            processes=True,
            host="127.0.0.1",
            protocol="tls://",
            security=security,
            resources=dict.fromkeys(LANES, 1),
            dashboard_address="127.0.0.1:0",
            worker_dashboard_address="127.0.0.1:0",
            silence_logs=logging.ERROR,
        )
        self._client = Client(self._cluster, security=security, set_as_default=False)

    def _connect(self, address: str) -> None:
        settings = self._settings
        security = Security(
            tls_ca_file=str(settings.tls_ca),
            tls_client_cert=str(settings.tls_cert),
            tls_client_key=str(settings.tls_key),
            require_encryption=True,
        )
        self._client = Client(address, security=security, set_as_default=False, timeout="60s")
