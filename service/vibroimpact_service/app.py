"""Assembly of the application; nothing is decided here."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib.metadata import version

from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.middleware.cors import CORSMiddleware

from vibroimpact_service import tasks
from vibroimpact_service.access.budget import Budget
from vibroimpact_service.access.gate import Gate
from vibroimpact_service.api import (
    admin,
    compute,
    contract,
    exchange,
    jobs,
    pages,
    results,
    service,
    sharing,
    systems,
)
from vibroimpact_service.api.direct import Direct
from vibroimpact_service.api.shell import Shell, cross_origin, http_error, parameter_error
from vibroimpact_service.api.turns import Turns
from vibroimpact_service.evaluate import Evaluation
from vibroimpact_service.jobs.queue import JobQueue
from vibroimpact_service.metrics import Metrics
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

    gate = Gate(chosen)
    metrics = Metrics()

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        await gate.start()
        await jobs_queue.start()
        watching = asyncio.create_task(metrics.watch_loop())
        try:
            yield
        finally:
            watching.cancel()
            app.state.drain.set()
            app.state.evaluation.close()
            await jobs_queue.close()
            await gate.close()

    traced = "OTEL_EXPORTER_OTLP_ENDPOINT" in os.environ
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
        # Traces and figures go where the variables OTEL_… of OpenTelemetry say, if they do.
        telemetry={"auto_configure": traced, "tracing": traced, "metrics": traced, "logs": False},
    )
    app.state.settings = chosen
    app.state.gate = gate
    app.state.room = exchange.Room(chosen.max_bodies_bytes)
    app.state.budget = Budget(chosen)
    app.state.metrics = metrics
    app.state.evaluation = Evaluation(chosen, store, jobs_queue, metrics)
    app.state.drain = asyncio.Event()
    app.state.routers = (
        compute.router(),
        jobs.router,
        sharing.router,
        results.router,
        systems.router,
        admin.router,
        service.router,
        pages.router,
    )
    for router in app.state.routers:
        app.include_router(router)
    if not traced:  # the framework traces on its own way
        app.add_middleware(Direct, routers=app.state.routers)
    if chosen.cors_origins:
        app.add_middleware(CORSMiddleware, **cross_origin(chosen))
    app.add_middleware(Shell, settings=chosen, metrics=metrics, gate=gate)
    app.add_middleware(Turns)
    app.add_exception_handler(HTTPException, http_error)
    app.add_exception_handler(RequestValidationError, parameter_error)
    return app
