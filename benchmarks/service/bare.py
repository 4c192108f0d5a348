"""A server that only answers, bare, with the framework, or beside workers of Dask.

``python -m benchmarks.service.bare``: what the service takes beside it is the service's own.
"""

from __future__ import annotations

import signal
import socket
import sys
from typing import Final

import uvicorn
from distributed import LocalCluster
from fastapi import FastAPI
from starlette.responses import Response
from starlette.types import ASGIApp, Receive, Scope, Send

SERVER: Final = "server"
FRAMEWORK: Final = "framework"
CLUSTER: Final = "cluster"


def application(kind: str, size: int) -> ASGIApp:
    """Return an application that answers everything with so many bytes."""
    body = b"x" * size
    if kind != FRAMEWORK:

        async def answer(scope: Scope, receive: Receive, send: Send) -> None:
            assert scope["type"] == "http"
            headers = [(b"content-length", str(size).encode())]
            await send({"type": "http.response.start", "status": 200, "headers": headers})
            await send({"type": "http.response.body", "body": body})

        return answer
    framework = FastAPI()

    @framework.get("/{name}")
    async def answer_all(name: str) -> Response:
        return Response(body)

    return framework


def main(kind: str, size: int) -> None:
    """Serve on a free port of this machine and print its address.

    Beside a cluster the size is the number of its workers, each a process with one thread.
    """
    if kind == CLUSTER:
        # The server passes the signal on when it has stopped: the workers are closed then.
        signal.signal(signal.SIGTERM, lambda *_: sys.exit())
        with LocalCluster(n_workers=size, threads_per_worker=1, dashboard_address=None):
            serve(kind, size)
    else:
        serve(kind, size)


def serve(kind: str, size: int) -> None:
    """Serve until the process is stopped."""
    listener = socket.create_server(("127.0.0.1", 0))
    sys.stdout.write(f"http://127.0.0.1:{listener.getsockname()[1]}\n")
    sys.stdout.flush()
    config = uvicorn.Config(
        application(kind, size), log_config=None, access_log=False, lifespan="off"
    )
    uvicorn.Server(config).run(sockets=[listener])


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
