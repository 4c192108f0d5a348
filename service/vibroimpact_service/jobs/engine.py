"""Execution of calls by Dask workers: own ones on this machine, or those of a remote scheduler.

Dask is used by its public interface alone.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import threading
import time
import uuid
from collections.abc import Callable, Sequence
from typing import Any, Final, TypeAlias

import dask
import structlog
from distributed import Client, Future, LocalCluster
from distributed.scheduler import KilledWorker

from vibroimpact_service.jobs import certificates, dask_settings, deaths, forkserver, worker
from vibroimpact_service.jobs.deaths import Deaths, keep
from vibroimpact_service.jobs.metrics import JobMetrics
from vibroimpact_service.jobs.process_limits import worker_memory
from vibroimpact_service.jobs.work import nothing
from vibroimpact_service.settings import Settings

FAST: Final = "fast"
BULK: Final = "bulk"
QUEUES: Final = (FAST, BULK)
"""Every worker has one thread for each queue, so that quick calls never wait for slow ones."""

_RETRY_SECONDS: Final = 0.5
_POLL_SECONDS: Final = 1.0
_STARTING_SECONDS: Final = 0.2
"""Interval at which workers are looked for while there are none."""
_NEVER_SECONDS: Final = 1e6
_MISSING_SECONDS: Final = 60.0
"""Time after which own workers that are missing will not come back."""

log = structlog.get_logger("vibroimpact.engine")


Call: TypeAlias = Future
"""A call that was sent to the workers."""


class EngineUnavailableError(RuntimeError):
    """There are no workers at the moment, or the workers of a call went away."""


class Engine:
    """Runs functions in worker processes, in two queues that do not wait for one another.

    Parameters
    ----------
    settings : Settings
    prepare : callable
        Called once in every worker as it starts, in a thread of its own.
    modules : sequence of str
        Modules that own workers have imported when they start; see `forkserver`.
    metrics : JobMetrics, optional
        What counts the deaths of workers.

    Attributes
    ----------
    workers : int
        How many workers there are, each with a thread for each queue.
    failure : str or None
        Why there are none.
    isolation : threading.Lock
        Held while a call is repeated that may kill its worker.
    """

    def __init__(
        self,
        settings: Settings,
        prepare: Callable[[], None] = nothing,
        modules: Sequence[str] = (),
        metrics: JobMetrics | None = None,
    ) -> None:
        self._settings, self._prepare = settings, prepare
        self._modules = tuple(modules)
        self._client: Client | None = None
        self._cluster: LocalCluster | None = None
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        self._cancelled: dict[str, float] = {}
        self._counted: dict[str, Callable[[Sequence[float]], None]] = {}
        self._open: dict[str, str] = {}  # the key of each call that has not ended -> its queue
        self._deaths = Deaths((metrics or JobMetrics()).worker_died)
        self.workers = 0
        self.failure: str | None = None
        self.isolation = threading.Lock()

    def start(self) -> None:
        """Begin to start the workers, and stay connected to them, in a thread."""
        self._thread = threading.Thread(target=self._run, name="engine", daemon=True)
        self._thread.start()

    @property
    def ready(self) -> bool:
        """Whether there are workers."""
        return self.workers > 0

    def submit(
        self,
        key: str,
        queue: str,
        priority: int,
        ended: Callable[[Call], None],
        function: Callable[..., Any],
        *args: Any,
        used: Callable[[Sequence[float]], None] | None = None,
    ) -> Call:
        """Send a call to the workers; the function gets a `Tick` as its last argument.

        Parameters
        ----------
        key : str
            Never used before: Dask would take a cancelled call for this one.
        queue : {"fast", "bulk"}
        priority : int
            Higher goes first.
        ended : callable
            Called with the call when it has ended, in whatever way.
        function : callable
            Module-level.
        *args : object
        used : callable, optional
            Called in a thread with the processor times of the jobs of the call, seconds, soon
            after it has ended; not where its worker is killed.

        Raises
        ------
        EngineUnavailableError
            Where there are no workers.
        """
        client = self._client
        if client is None or not self.ready:
            raise EngineUnavailableError
        call = client.submit(
            worker.execute,
            function,
            key,
            used is not None,
            *args,
            key=key,
            resources={queue: 1},
            priority=priority,
            pure=False,
        )
        if used is not None:
            keep(self._counted, key, used)
        self._open[key] = queue
        call.add_done_callback(lambda _: self._open.pop(key, None))
        call.add_done_callback(ended)
        return call

    def _note_use(self, event: tuple[float, dict[str, Any]]) -> None:
        """Take note of what a call of this or another service has used."""
        used = self._counted.pop(event[1]["call"], None)
        if used is not None:
            used(event[1]["used"])

    def ahead(self, job: str) -> int:
        """Return how many calls were sent before all those of a run that have not ended.

        Parameters
        ----------
        job : str
            The run's first job, with which the keys of its calls begin.
        """
        calls = list(self._open.items())
        for place, (key, queue) in enumerate(calls):
            if key.startswith(job):
                return sum(other == queue for _, other in calls[:place])
        return 0

    async def run(
        self,
        function: Callable[..., Any],
        *args: Any,
        used: Callable[[Sequence[float]], None] | None = None,
    ) -> Any:
        """Return the value of a quick call; `used` as of `submit`.

        Raises
        ------
        EngineUnavailableError, WorkerLostError, Exception
            Why the call failed.
        """
        loop, ended = asyncio.get_running_loop(), asyncio.Event()
        key = f"call-{uuid.uuid4().hex}"

        def end(_: Call) -> None:
            loop.call_soon_threadsafe(ended.set)

        call = self.submit(key, FAST, 1, end, function, *args, used=used)
        try:
            await ended.wait()
        except BaseException:
            self.cancel([call])
            raise
        error = await asyncio.to_thread(self.error, call)
        if error is not None:
            raise error
        return (await asyncio.to_thread(self.values, [call]))[0]

    def error(self, call: Call) -> BaseException | None:
        """Return why a call that has ended failed, or None."""
        if call.status == "finished":
            return None
        if call.status != "error":
            return EngineUnavailableError("the workers went away")
        error = call.exception(timeout=10)
        if isinstance(error, KilledWorker):
            return self._deaths.of(error.last_worker.address, error.last_worker.nanny, call.key)
        return error if isinstance(error, BaseException) else RuntimeError(repr(error))

    def values(self, calls: Sequence[Call]) -> list[Any]:
        """Return the values of calls that succeeded, and release them.

        Raises
        ------
        EngineUnavailableError
            Where the values were lost with the workers that held them.
        """
        if self._client is None:
            raise EngineUnavailableError
        try:
            values = self._client.gather(list(calls), errors="raise")
        except Exception as error:
            raise EngineUnavailableError("the values are lost") from error
        for call in calls:
            call.release()
        return list(values)

    def cancel(self, calls: Sequence[Call]) -> None:
        """Cancel calls.

        Those that are executed notice it by their tick. The worker of one that does not stop
        within the grace period is restarted; other calls that it executes are repeated.
        """
        client = self._client
        if client is None or not calls:
            return
        deadline = time.monotonic() + self._settings.grace_seconds
        self._cancelled |= {call.key: deadline for call in calls}
        with contextlib.suppress(Exception):  # the client may be closing at this moment
            client.cancel(list(calls), force=True)

    def end(self) -> None:
        """Start no worker again that ends from now on: somebody may end all processes at once."""
        for nanny in self._cluster.workers.values() if self._cluster is not None else ():
            nanny.auto_restart = False

    def close(self) -> None:
        """Disconnect, and stop own workers."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join(timeout=30)

    def _run(self) -> None:
        logging.getLogger("distributed").setLevel(logging.ERROR)
        dask.config.set(dask_settings.CONFIG)
        while not self._closing.is_set():
            try:
                self._client = self._connect()
                self._monitor(self._client)
            except Exception as error:
                self.failure = f"the workers cannot be reached: {type(error).__name__}: {error}"
                log.warning("workers unavailable", error=self.failure)
            self._disconnect()
            self._closing.wait(_RETRY_SECONDS)

    def _connect(self) -> Client:
        settings = self._settings
        if settings.scheduler is None:
            self._cluster = self._own_cluster()
            client = Client(self._cluster, set_as_default=False)
        else:
            tls = certificates.of_settings(settings)
            client = Client(settings.scheduler, security=tls, set_as_default=False, timeout="10s")
        client.subscribe_topic(deaths.TOPIC, self._deaths.note)
        client.subscribe_topic(worker.USE, self._note_use)
        client.register_plugin(deaths.DeathWatch())
        client.register_plugin(worker.ServicePlugin(self._prepare))
        return client

    def _own_cluster(self) -> LocalCluster:
        forkserver.start(self._modules)
        port = _free_port()
        return LocalCluster(
            n_workers=self._settings.workers,
            threads_per_worker=len(QUEUES),
            processes=True,
            host="127.0.0.1",
            protocol="tls://",
            security=certificates.temporary(),
            resources=dict.fromkeys(QUEUES, 1),
            memory_limit=worker_memory(self._settings.worker_memory_bytes, self._settings.workers),
            # Its first address is for the client, which is in the same process: without encoding
            # and encryption, a call takes it much less time.
            scheduler_kwargs={
                "dashboard": False,  # where Bokeh is installed, it would show every call
                "protocol": ["inproc://", "tls://"],
                "host": [None, "127.0.0.1"],
                "port": [0, port],
                "contact_address": f"tls://127.0.0.1:{port}",
            },
            scheduler_sync_interval=_NEVER_SECONDS,  # workers are counted by `_monitor`
            dashboard_address="127.0.0.1:0",
            worker_dashboard_address=None,
            silence_logs=logging.ERROR,
        )

    def _monitor(self, client: Client) -> None:
        """Count the workers, and restart those of cancelled calls, until the connection breaks."""
        complete = time.monotonic()
        while not self._closing.is_set() and client.status == "running":
            self.workers = len(client.nthreads())
            self.failure = None if self.workers else "there are no workers"
            if self._cluster is None or self.workers >= self._settings.workers:
                complete = time.monotonic()
            elif time.monotonic() - complete > _MISSING_SECONDS or _broken(self._cluster):
                log.warning("all workers are restarted: some are missing", workers=self.workers)
                return
            silent = self._deaths.silent()
            if silent:
                log.warning("workers given up: their machine is silent", workers=silent)
                client.run_on_scheduler(_remove_workers, silent)
            self._restart_workers(client)
            self._closing.wait(_POLL_SECONDS if self.workers else _STARTING_SECONDS)

    def _restart_workers(self, client: Client) -> None:
        """Restart the workers that execute calls which were cancelled a grace period ago."""
        now = time.monotonic()
        late = {key for key, deadline in self._cancelled.items() if deadline < now}
        if not late:
            return
        for key in late:
            del self._cancelled[key]
        running: dict[str, list[str]] = client.run(worker.running_calls, on_error="ignore")
        workers = [address for address, keys in running.items() if late.intersection(keys)]
        if workers:
            log.warning("workers restarted: cancelled calls did not stop", workers=workers)
            client.restart_workers(workers, raise_for_error=False)

    def _disconnect(self) -> None:
        self.workers = 0
        self._open.clear()
        client, self._client = self._client, None
        cluster, self._cluster = self._cluster, None
        with contextlib.suppress(Exception):
            if client is not None:
                client.close(timeout=5)
        with contextlib.suppress(Exception):
            if cluster is not None:
                cluster.close(timeout=3)


def _broken(cluster: LocalCluster) -> bool:
    """Whether what restarts a worker has failed, as where the forkserver died at the same time."""
    expected = ("init", "starting", "running", "undefined")
    return any(nanny.status.name not in expected for nanny in cluster.workers.values())


async def _remove_workers(workers: list[str], dask_scheduler: Any) -> None:
    """Give up workers, in the scheduler; their calls are repeated elsewhere."""
    for address in workers:
        await dask_scheduler.remove_worker(address, stimulus_id="vibroimpact-silent")


def _free_port() -> int:
    """Return a port that is free at the moment; where it is taken, the cluster starts again."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])
