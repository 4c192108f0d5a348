"""Assembly of the application; nothing is decided here."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib.metadata import version
from typing import Final

from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.middleware.cors import CORSMiddleware

from vibroimpact_service import problems
from vibroimpact_service.access.authenticator import Authenticator
from vibroimpact_service.access.budget import Budget
from vibroimpact_service.api import (
    admin,
    compute,
    job_control,
    jobs,
    pages,
    results,
    service,
    shared_results,
    systems,
)
from vibroimpact_service.api.boundary import Boundary, cross_origin, http_error, parameter_error
from vibroimpact_service.api.route import Services
from vibroimpact_service.jobs.queue import JobQueue
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.metrics import Metrics
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store
from vibroimpact_service.use_case import chunks
from vibroimpact_service.use_case.evaluation import Evaluation
from vibroimpact_service.use_case.warming import Warming

_DESCRIPTION: Final = (
    "Indices count from 0. Frequencies are Omega, the fundamental angular frequency "
    "Omega = (pi/2) omega, unless a field says omega. Numbers are in any consistent set of "
    "units; JSON and HDF5 hold the same numbers to the last bit. Every error is a problem "
    "document (RFC 9457) whose errors point at the faulty fields."
)
_ROUTERS: Final = (
    results.router,
    compute.router,
    jobs.router,
    job_control.router,
    shared_results.router,
    systems.router,
    admin.router,
    service.router,
    pages.router,
)


def create_app(
    settings: Settings | None = None,
    queue: JobQueue | None = None,
    warming: Warming | None = None,
) -> FastAPI:
    """Return the application.

    Parameters
    ----------
    settings : Settings, optional
        Absent: from the environment.
    queue : JobQueue, optional
        Absent: one of its own.
    warming : Warming, optional
        Absent: kernels are compiled where they are needed first.
    """
    chosen = settings or Settings()
    store = Store(chosen.store_url, patient=False)
    budget = Budget(chosen)
    jobs_queue = queue or JobQueue(chosen, store, chunks.work(chosen), budget.settle)

    authenticator = Authenticator(chosen)
    jobs_queue.metrics.expect(KINDS, [problem.code for problem in problems.OF_THE_SERVICE])
    metrics = Metrics(jobs_queue.metrics.registry)
    parts = Services(
        settings=chosen,
        authenticator=authenticator,
        budget=budget,
        metrics=metrics,
        evaluation=Evaluation(chosen, store, jobs_queue, metrics, warming),
        body_bytes_left=chosen.max_bodies_bytes,
    )

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        await authenticator.start()
        await jobs_queue.start()
        watching = asyncio.create_task(metrics.watch_loop())
        try:
            yield
        finally:
            watching.cancel()
            parts.drain.set()
            parts.evaluation.close()
            await jobs_queue.close()
            await authenticator.close()

    traced = "OTEL_EXPORTER_OTLP_ENDPOINT" in os.environ
    app = FastAPI(
        title="Vibroimpact",
        summary="Impact modes and motions of structures with rigid amplitude limiters.",
        description=_DESCRIPTION,
        version=version("vibroimpact"),
        lifespan=lifespan,
        # In one list, the most frequent first: the framework tries them one after the other,
        # and routers that are included cost it twice as much.
        routes=[route for router in _ROUTERS for route in router.routes],
        openapi_url=None,
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,
        # Traces and figures go where the variables OTEL_… of OpenTelemetry say, if they do.
        telemetry={"auto_configure": traced, "tracing": traced, "metrics": traced, "logs": False},
    )
    app.state.services = parts
    if chosen.cors_origins:
        app.add_middleware(CORSMiddleware, **cross_origin(chosen))
    app.add_middleware(
        Boundary,
        metrics=metrics,
        host=chosen.host,
        names=chosen.hosts,
        keys_required=lambda: authenticator.keys_required,
    )
    app.add_exception_handler(HTTPException, http_error)
    app.add_exception_handler(RequestValidationError, parameter_error)
    return app
