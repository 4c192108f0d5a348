"""Assembly of the application; nothing is decided here."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib.metadata import version

from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException

from vibroimpact_service import tasks
from vibroimpact_service.api import compute, contract, jobs, results, service, systems
from vibroimpact_service.api.shell import Shell, http_error, parameter_error
from vibroimpact_service.evaluate import Evaluation
from vibroimpact_service.jobs.queue import JobQueue
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store


def create_app(settings: Settings | None = None, queue: JobQueue | None = None) -> FastAPI:
    """Return the application.

    Parameters
    ----------
    settings : Settings, optional
        Absent: from the environment.
    queue : JobQueue, optional
        Absent: one of its own.
    """
    chosen = settings or Settings()
    store = Store(chosen.store_url)
    jobs_queue = queue or JobQueue(chosen, store, tasks.WORK)

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        await jobs_queue.start()
        try:
            yield
        finally:
            app.state.drain.set()
            app.state.evaluation.close()
            await jobs_queue.close()

    app = FastAPI(
        title=contract.TITLE,
        summary=contract.SUMMARY,
        description=contract.DESCRIPTION,
        version=version("vibroimpact"),
        lifespan=lifespan,
        openapi_url=None,
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,
    )
    app.state.settings = chosen
    app.state.evaluation = Evaluation(chosen, store, jobs_queue)
    app.state.drain = asyncio.Event()
    app.state.routers = (
        compute.router(),
        jobs.router,
        results.router,
        systems.router,
        service.router,
    )
    for router in app.state.routers:
        app.include_router(router)
    app.add_middleware(Shell)
    app.add_exception_handler(HTTPException, http_error)
    app.add_exception_handler(RequestValidationError, parameter_error)
    return app
