"""A server that only answers, with and without the framework: ``python -m benchmarks.bare``.

What the service's answers take beside it is the service's own.
"""

from __future__ import annotations

import socket
import sys
from typing import Final

import uvicorn
from fastapi import FastAPI
from starlette.responses import Response
from starlette.types import ASGIApp, Receive, Scope, Send

KINDS: Final = ("server", "framework")


def application(kind: str, size: int) -> ASGIApp:
    """Return an application that answers everything with so many bytes."""
    body = b"x" * size
    if kind == "server":

        async def answer(scope: Scope, receive: Receive, send: Send) -> None:
            assert scope["type"] == "http"
            headers = [(b"content-length", str(size).encode())]
            await send({"type": "http.response.start", "status": 200, "headers": headers})
            await send({"type": "http.response.body", "body": body})

        return answer
    framework = FastAPI()

    @framework.get("/{name}")
    async def found(name: str) -> Response:
        return Response(body)

    return framework


def main(kind: str, size: int) -> None:
    """Serve on a free port of this machine and print its address."""
    listener = socket.create_server(("127.0.0.1", 0))
    sys.stdout.write(f"http://127.0.0.1:{listener.getsockname()[1]}\n")
    sys.stdout.flush()
    config = uvicorn.Config(
        application(kind, size), log_config=None, access_log=False, lifespan="off"
    )
    uvicorn.Server(config).run(sockets=[listener])


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
