"""The short way to handlers that want the request and a part of its path alone.

The framework looks for a route by trying one after the other, and then finds out what else a
handler could want. For answers that are at hand, as stored results are, that takes longer than
everything else. What this layer does not know it leaves to the framework: other addresses,
methods that an address does not have, and prefixes of proxies.
"""

from __future__ import annotations

from collections.abc import Sequence

from fastapi import APIRouter
from starlette.convertors import StringConvertor
from starlette.requests import Request
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send

from vibroimpact_service.api.guard import Guarded, Handler

_Way = tuple[Guarded, Handler, str]
"""A route, its handler and the name of the last part of its path, where that is a parameter."""


class Direct:
    """The innermost layer around the framework.

    Parameters
    ----------
    app : ASGI application
    routers : sequence of APIRouter
        Whose routes are found here, where they are simple enough.
    """

    def __init__(self, app: ASGIApp, routers: Sequence[APIRouter]) -> None:
        self._app = app
        self._ways: dict[tuple[str, str], _Way] = {}
        self._left: set[tuple[str, str]] = set()
        for route in (route for router in routers for route in router.routes):
            if isinstance(route, Guarded) and route.direct:
                self._add(route)
            elif isinstance(route, Route):
                # An address of its own is not what a parameter could be.
                self._left |= {(method, route.path) for method in route.methods or ()}

    def _add(self, route: Guarded) -> None:
        assert route.methods is not None
        (method,) = route.methods
        fixed, _, last = route.path.rpartition("/")
        handler = route.get_route_handler()
        if not route.param_convertors:
            self._ways[method, route.path] = route, handler, ""
        elif list(route.param_convertors) == [last[1:-1]] and isinstance(
            route.param_convertors[last[1:-1]], StringConvertor
        ):
            self._ways[method, f"{fixed}/"] = route, handler, last[1:-1]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] != "http" or scope.get("root_path"):
            await self._app(scope, receive, send)
            return
        method, path = scope["method"], scope["path"]
        way, last = self._ways.get((method, path)), ""
        if (way is None or way[2]) and (method, path) not in self._left:
            fixed, _, last = path.rpartition("/")
            way = self._ways.get((method, f"{fixed}/"))
        if way is None or bool(way[2]) != bool(last):
            await self._app(scope, receive, send)
            return
        route, handler, name = way
        scope["route"], scope["endpoint"] = route, route.endpoint
        scope["path_params"] = {name: last} if name else {}
        answer = await handler(Request(scope, receive, send))
        await answer(scope, receive, send)
