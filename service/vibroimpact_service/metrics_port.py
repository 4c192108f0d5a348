"""A port of its own for metrics and health, for those who watch the service and have no key."""

from __future__ import annotations

import uvicorn
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from vibroimpact_service.api import service
from vibroimpact_service.api.boundary import Boundary, http_error
from vibroimpact_service.api.route import Services
from vibroimpact_service.connection import connection


def application(parts: Services) -> Starlette:
    """Return the application: metrics and health of another one, and nothing else."""
    host = parts.settings.metrics_host
    boundary = Middleware(
        Boundary, metrics=parts.metrics, host=host, names=(), keys_required=lambda: False
    )
    app = Starlette(
        routes=[
            Route("/metrics", service.get_metrics),
            Route("/v1/health/live", _live),
            Route("/v1/health/ready", service.health_ready),
        ],
        middleware=[boundary],
        exception_handlers={HTTPException: http_error},
    )
    app.state.services = parts
    return app


async def _live(_: Request) -> Response:
    return await service.health_live()


class MetricsServer(uvicorn.Server):
    """A server of that application within another server's event loop.

    It has connections of its own: those that are there when the service has as many as it takes
    keep nobody from seeing that.
    """

    def __init__(self, parts: Services, port: int) -> None:
        config = uvicorn.Config(
            application(parts),
            host=parts.settings.metrics_host,
            port=port,
            http=connection(parts.settings),
            log_config=None,
            access_log=False,
            server_header=False,
            date_header=False,  # it would stand still: the loop that renews it is the other's
            ws="none",
            lifespan="off",
            timeout_graceful_shutdown=1,
        )
        super().__init__(config)

    async def start(self) -> None:
        """Listen.

        Raises
        ------
        SystemExit
            Where the port is taken.
        """
        self.config.load()
        self.lifespan = self.config.lifespan_class(self.config)
        await self.startup()
