"""Scheduler and workers as separate processes, for services on several machines."""

from __future__ import annotations

import asyncio
import logging
import signal
from collections.abc import Awaitable, Callable, Sequence
from typing import Any, Final

import dask
import structlog
from distributed import Nanny, Scheduler

from vibroimpact_service import stopping
from vibroimpact_service.jobs import certificates, forkserver
from vibroimpact_service.jobs.dask_settings import CONFIG
from vibroimpact_service.jobs.engine import QUEUES
from vibroimpact_service.jobs.process_limits import worker_memory
from vibroimpact_service.settings import Settings

log = structlog.get_logger("vibroimpact.cluster")

_RETRY_SECONDS: Final = 1.0


def schedule(settings: Settings, host: str, port: int, ready: Callable[[str], None]) -> None:
    """Run a scheduler until SIGTERM or SIGINT; `ready` is called with its address.

    Nothing is lost when it dies: services submit their calls again to the next one.

    Raises
    ------
    OSError
        Where it cannot listen there.
    """

    async def run(stop: asyncio.Event) -> None:
        async with Scheduler(
            host=host,
            port=port,
            protocol="tls://",
            security=certificates.of_settings(settings),
            dashboard=False,
            dashboard_address="127.0.0.1:0",
        ) as scheduler:
            ready(scheduler.address)
            await _first(stop.wait(), scheduler.finished())

    try:
        _until_signalled(run)
    except RuntimeError as error:  # "Scheduler failed to start"
        if isinstance(error.__cause__, OSError):
            raise error.__cause__ from None
        raise


def work(settings: Settings, modules: Sequence[str], ready: Callable[[int], None]) -> None:
    """Run workers for a remote scheduler until SIGTERM or SIGINT.

    They wait for the scheduler to be there, and connect again to one that was restarted.
    `ready` is called with their number whenever they are connected.
    """

    async def run(stop: asyncio.Event) -> None:
        forkserver.start(modules)
        while not stop.is_set():
            try:
                await _work_once(settings, ready, stop)
            except Exception as error:
                log.warning("no scheduler", error=f"{type(error).__name__}: {error}")
            await _first(stop.wait(), asyncio.sleep(_RETRY_SECONDS))

    _until_signalled(run)


async def _work_once(settings: Settings, ready: Callable[[int], None], stop: asyncio.Event) -> None:
    """Run workers until the scheduler, or one of them, is gone for good."""
    nannies = [
        Nanny(
            settings.scheduler,
            nthreads=len(QUEUES),
            resources=dict.fromkeys(QUEUES, 1),
            memory_limit=worker_memory(settings.worker_memory_bytes, settings.workers),
            security=certificates.of_settings(settings),
            local_directory=None,
            # The status page has no routes, and is for this machine alone.
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.ERROR,
        )
        for _ in range(settings.workers)
    ]
    try:
        await asyncio.gather(*nannies)
        ready(len(nannies))
        await _first(stop.wait(), *(nanny.finished() for nanny in nannies))
    finally:
        await asyncio.gather(*(nanny.close(timeout=5) for nanny in nannies), return_exceptions=True)


def _until_signalled(run: Callable[[asyncio.Event], Awaitable[None]]) -> None:
    async def main() -> None:
        stop = asyncio.Event()

        def end() -> None:
            if not stop.is_set():
                stopping.begin()
            stop.set()

        for sign in (signal.SIGTERM, signal.SIGINT):
            asyncio.get_running_loop().add_signal_handler(sign, end)
        await run(stop)

    logging.getLogger("distributed").setLevel(logging.ERROR)
    with dask.config.set(CONFIG):
        asyncio.run(main())


async def _first(*waiting: Any) -> None:
    """Wait until one of several awaitables is done; cancel the others."""
    tasks = [asyncio.ensure_future(each) for each in waiting]
    await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
