"""Gives calls to Dask: to workers of our own, or to those of a scheduler elsewhere."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
import time
import uuid
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import dask
import distributed.scheduler
import distributed.utils
import structlog
from distributed import (
    Client,
    Future,
    LocalCluster,
    Scheduler,
    Security,
    WorkerPlugin,
    get_worker,
)
from distributed.scheduler import KilledWorker

from vibroimpact_service.jobs import certificates, nursery
from vibroimpact_service.jobs.work import StoppedError, WorkerLostError, nothing
from vibroimpact_service.settings import Settings

FAST: Final = "fast"
BULK: Final = "bulk"
LANES: Final = (FAST, BULK)
"""Every worker has one thread for each lane, so that quick work never waits for slow work."""

CONFIG: Final[dict[str, Any]] = {
    # A worker is declared dead late: code that holds the GIL must not be mistaken for a corpse.
    "distributed.scheduler.worker-ttl": "5 minutes",
    "distributed.scheduler.allowed-failures": 1,
    "distributed.comm.timeouts.tcp": "15s",
    "distributed.comm.timeouts.connect": "15s",
    "distributed.admin.tick.limit": "30s",
    # A local cluster gives up for good a worker that is being started anew when some earlier
    # death of it is this long ago: with the 15 s of Dask, two deaths can cost the worker.
    "distributed.deploy.lost-worker-timeout": "3650 days",
    "distributed.worker.multiprocessing-method": nursery.METHOD,
    # What Dask measures of itself all the time, in every process: nobody looks at it.
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.admin.system-monitor.disk": False,
    "distributed.admin.system-monitor.gil.enabled": False,
    "distributed.diagnostics.nvml": False,
    "distributed.worker.memory.monitor-interval": "1s",
    "distributed.client.scheduler-info-interval": "5 minutes",
    # Nor does anybody want to see the lines of source from which calls come.
    "distributed.diagnostics.computations.nframes": 0,
    # There are never many bundles to be moved: each user has a few per worker at a time.
    "distributed.scheduler.work-stealing-interval": "1s",
    # A result has one copy, and it is gone as soon as it was fetched.
    "distributed.scheduler.active-memory-manager.start": False,
    # Dask's status pages know no keys: they show nothing.
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}
_RETRY_SECONDS = 0.5
_LOOK_SECONDS = 1.0
_MISSING_SECONDS = 60.0  # workers of our own that are away for longer will not come back
_SEND_SECONDS = 0.002  # Dask collects messages to the scheduler for 10 ms otherwise
_HEARTBEAT_SECONDS = 5.0
"""Between heartbeats of a worker. A death shows at once by its connection, and only a worker that
hangs by heartbeats: after minutes, see above. Dask's half a second is for its status pages."""
_SELDOM = 1e6
_HERE: Final = "inproc://"
"""How the client and a scheduler in the same process talk: without encoding and encryption."""

log = structlog.get_logger("vibroimpact.engine")


class EngineUnavailableError(RuntimeError):
    """There are no workers to be had at the moment, or those there were went away."""


@dataclass(frozen=True, slots=True)
class Call:
    """A call that was given to the workers."""

    key: str
    future: Future


class Engine:
    """Runs functions in worker processes, in two lanes that do not wait for one another.

    Parameters
    ----------
    settings : Settings
    prepare : callable
        Called once in every worker as it starts, in a thread of its own.
    modules : sequence of str
        What workers of our own are born with; see `nursery`.
    """

    def __init__(
        self,
        settings: Settings,
        prepare: Callable[[], None] = nothing,
        modules: Sequence[str] = (),
    ) -> None:
        self._settings, self._prepare = settings, prepare
        self._modules = tuple(modules)
        self._client: Client | None = None
        self._cluster: LocalCluster | None = None
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        self._stubborn: dict[str, float] = {}
        self.slots = 0
        self.failure: str | None = None
        self.quarantine = threading.Lock()

    def start(self) -> None:
        """Begin to start the workers, in the background, and keep up the connection to them."""
        self._thread = threading.Thread(target=self._run, name="engine", daemon=True)
        self._thread.start()

    @property
    def ready(self) -> bool:
        """Whether work can be given to workers now."""
        return self.slots > 0

    def submit(
        self,
        key: str,
        lane: str,
        priority: int,
        ended: Callable[[Call], None],
        function: Callable[..., Any],
        *args: Any,
    ) -> Call:
        """Give one call to a worker; it gets a `Tick` as its last argument.

        Parameters
        ----------
        key : str
            Never used before: Dask would take an abandoned call for this one.
        lane : {"fast", "bulk"}
        priority : int
            Higher goes first.
        ended : callable
            Told when the call ended, however it did.
        function : callable
            Module-level.
        *args : object

        Raises
        ------
        EngineUnavailableError
            Where there are no workers.
        """
        client = self._client
        if client is None or not self.ready:
            raise EngineUnavailableError
        future = client.submit(
            _call, function, key, *args, key=key, resources={lane: 1}, priority=priority, pure=False
        )
        call = Call(key, future)
        future.add_done_callback(lambda _: ended(call))
        return call

    async def run(self, function: Callable[..., Any], *args: Any) -> Any:
        """Return the value of one quick call, for somebody who waits for it.

        Raises
        ------
        EngineUnavailableError, WorkerLostError, Exception
            As the call failed.
        """
        loop, ended = asyncio.get_running_loop(), asyncio.Event()
        key = f"call-{uuid.uuid4().hex}"

        def end(_: Call) -> None:
            loop.call_soon_threadsafe(ended.set)

        call = self.submit(key, FAST, 1, end, function, *args)
        try:
            await ended.wait()
        except BaseException:
            self.forget([call])
            raise
        error = self.error(call)
        if error is not None:
            raise error
        return (await asyncio.to_thread(self.values, [call]))[0]

    @staticmethod
    def error(call: Call) -> BaseException | None:
        """Return why an ended call failed, or None."""
        future = call.future
        if future.status == "finished":
            return None
        if future.status != "error":
            return EngineUnavailableError("the workers went away")
        error = future.exception(timeout=10)
        if isinstance(error, KilledWorker):
            return WorkerLostError("the computation killed its worker process")
        return error if isinstance(error, BaseException) else RuntimeError(repr(error))

    def values(self, calls: Sequence[Call]) -> list[Any]:
        """Return what calls that ended well returned, and let go of them.

        Raises
        ------
        EngineUnavailableError
            Where the values went away with the workers that held them.
        """
        if self._client is None:
            raise EngineUnavailableError
        try:
            found = self._client.gather([call.future for call in calls], errors="raise")
        except Exception as error:
            raise EngineUnavailableError("the values are gone") from error
        for call in calls:
            call.future.release()
        return list(found)

    def forget(self, calls: Sequence[Call]) -> None:
        """Give up calls that nobody waits for any more.

        Those under way notice by their tick. Where one still runs after a grace period, its
        worker is started anew: what its neighbours lose is computed again.
        """
        client = self._client
        if client is None or not calls:
            return
        deadline = time.monotonic() + self._settings.grace_seconds
        self._stubborn |= {call.key: deadline for call in calls}
        with contextlib.suppress(Exception):  # the client may be closing at this moment
            client.cancel([call.future for call in calls], force=True)

    def close(self) -> None:
        """Stop the workers that were started here, and leave the others."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join(timeout=30)

    def _run(self) -> None:
        logging.getLogger("distributed").setLevel(logging.ERROR)
        dask.config.set(CONFIG)
        while not self._closing.is_set():
            try:
                self._client = self._connect()
                self._keep_up(self._client)
            except Exception as error:
                self.failure = f"the workers cannot be reached: {type(error).__name__}: {error}"
                log.warning("workers unavailable", error=self.failure)
            self._disconnect()
            self._closing.wait(_RETRY_SECONDS)

    def _connect(self) -> Client:
        if self._settings.scheduler is None:
            passing = _passing_security()
            self._cluster = self._own_cluster(passing)
            listeners = self._cluster.scheduler.listeners
            (here,) = (e.contact_address for e in listeners if e.contact_address.startswith(_HERE))
            loop = self._cluster.loop
            loop.add_callback(calm, self._cluster.scheduler)
            client = Client(here, loop=loop, security=passing, set_as_default=False)
        else:
            client = Client(
                self._settings.scheduler,
                security=security(self._settings),
                set_as_default=False,
                timeout="10s",
            )
        client.scheduler_comm.interval = _SEND_SECONDS
        if self._prepare is not nothing:
            client.register_plugin(_Preparation(self._prepare), name="vibroimpact-preparation")
        return client

    def _own_cluster(self, passing: Security) -> LocalCluster:
        open_nursery(self._modules)
        return LocalCluster(
            n_workers=self._settings.workers,
            threads_per_worker=len(LANES),
            processes=True,
            host="127.0.0.1",
            protocol="tls://",
            security=passing,
            resources=dict.fromkeys(LANES, 1),
            scheduler_kwargs={"host": ["127.0.0.1", None], "protocol": ["tls://", _HERE]},
            scheduler_sync_interval=_SELDOM,
            dashboard_address="127.0.0.1:0",
            worker_dashboard_address="127.0.0.1:0",
            silence_logs=logging.ERROR,
        )

    def _keep_up(self, client: Client) -> None:
        """Watch the connection until it breaks, and calls that do not stop."""
        complete = time.monotonic()
        while not self._closing.is_set() and client.status == "running":
            self.slots = self._count(client)
            self.failure = None if self.slots else "there are no workers"
            if self._cluster is None or self.slots >= self._settings.workers:
                complete = time.monotonic()
            elif time.monotonic() - complete > _MISSING_SECONDS:
                log.warning("workers started anew: some did not come back", there=self.slots)
                return
            self._stop_stubborn(client)
            self._closing.wait(_LOOK_SECONDS if self.slots else _LOOK_SECONDS / 5)

    def _count(self, client: Client) -> int:
        """Return how many workers there are."""
        if self._cluster is not None:
            return len(self._cluster.scheduler.workers)
        return len(client.nthreads())

    def _stop_stubborn(self, client: Client) -> None:
        now = time.monotonic()
        late = {key for key, deadline in self._stubborn.items() if deadline < now}
        if not late:
            return
        for key in late:
            del self._stubborn[key]
        running: dict[str, list[str]] = client.run(_executing, on_error="ignore")
        workers = [address for address, keys in running.items() if late.intersection(keys)]
        if workers:
            log.warning("workers started anew: given-up calls did not stop", workers=workers)
            client.restart_workers(workers, raise_for_error=False)

    def _disconnect(self) -> None:
        self.slots = 0
        client, self._client = self._client, None
        cluster, self._cluster = self._cluster, None
        with contextlib.suppress(Exception):
            if client is not None:
                client.close(timeout=5)
        with contextlib.suppress(Exception):
            if cluster is not None:
                cluster.close(timeout=10)


def open_nursery(modules: Sequence[str]) -> None:
    """Begin to start the process that forks workers, and keep Dask from preparing its own.

    It would import here whatever workers of others may want, pandas among it: a good part of
    the time of a start, for a process that is there already.
    """
    nursery.open_nursery(modules)
    distributed.utils._forkserver_preload_set = True


def calm(scheduler: Scheduler) -> None:
    """Keep a scheduler from looking four times a second for what it was not asked to look for."""
    limits = {
        "idle-timeout": scheduler.idle_timeout,
        "no-workers-timeout": scheduler.no_workers_timeout,
    }
    for name, limit in limits.items():
        look = scheduler.periodic_callbacks.get(name)
        if limit is None and look is not None:
            look.stop()


def _heartbeat_seconds(workers: int) -> float:
    return float(max(_HEARTBEAT_SECONDS, _usual_heartbeat_seconds(workers)))


# Dask has no setting for it.
_usual_heartbeat_seconds = distributed.scheduler.heartbeat_interval
distributed.scheduler.heartbeat_interval = _heartbeat_seconds


def _passing_security() -> Security:
    """Return keys and certificates that live as long as this process, and only in it."""
    made = certificates.make(days=3650)
    cert, key = made.certificate.decode(), made.key.decode()
    return _security(made.authority.decode(), cert, key)


def security(settings: Settings) -> Security:
    """Return the keys and certificates that settings name.

    Raises
    ------
    ValueError
        Where they do not name all three.
    """
    if settings.tls_ca is None or settings.tls_cert is None or settings.tls_key is None:
        raise ValueError("a scheduler needs VIBROIMPACT_TLS_CA, _TLS_CERT and _TLS_KEY")
    return _security(str(settings.tls_ca), str(settings.tls_cert), str(settings.tls_key))


def _security(authority: str, cert: str, key: str) -> Security:
    return Security(
        tls_ca_file=authority,
        tls_client_cert=cert,
        tls_client_key=key,
        tls_scheduler_cert=cert,
        tls_scheduler_key=key,
        tls_worker_cert=cert,
        tls_worker_key=key,
        require_encryption=True,
    )


def _call(function: Callable[..., Any], key: str, *args: Any) -> Any:
    return function(*args, _WantedTick(key))


class _WantedTick:
    """Stops a call once the scheduler has told its worker that nobody wants it."""

    _SECONDS = 0.05

    def __init__(self, key: str) -> None:
        self._key, self._tasks = key, get_worker().state.tasks
        self._looked = time.monotonic()

    def __call__(self, _done: int, _total: int, /) -> None:
        now = time.monotonic()
        if now - self._looked < self._SECONDS:
            return
        self._looked = now
        task = self._tasks.get(self._key)
        if task is None or task.state != "executing":
            raise StoppedError


class _Preparation(WorkerPlugin):  # type: ignore[misc]
    def __init__(self, prepare: Callable[[], None]) -> None:
        self._prepare = prepare

    def setup(self, worker: Any) -> None:
        threading.Thread(target=self._prepare, name="prepare", daemon=True).start()


def _executing(dask_worker: Any) -> list[str]:
    return [task.key for task in dask_worker.state.executing]
