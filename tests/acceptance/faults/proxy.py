"""A TCP proxy that swallows what passes it, or notices what does."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from urllib.parse import urlsplit, urlunsplit


class Proxy:
    """Passes connections on to a server until it drops them.

    Parameters
    ----------
    url : str
        Of the server; `url` of the proxy is the same with another port.
    seen : callable, optional
        Called with what clients sent, once it was passed on.
    """

    def __init__(self, url: str, seen: Callable[[bytes], None] = lambda _: None) -> None:
        parts = urlsplit(url)
        self._server = (parts.hostname, parts.port or 5432)
        self._seen = seen
        self._listener = socket.create_server(("127.0.0.1", 0))
        place = f"{parts.username}@127.0.0.1:{self._listener.getsockname()[1]}"
        self.url = urlunsplit(parts._replace(netloc=place))
        self._connections: set[socket.socket] = set()
        self._dropped: set[socket.socket] = set()
        self.cut = False
        """Whether new connections are dropped too."""
        self.accepted = 0
        """How many connections there have been."""
        threading.Thread(target=self._accept, daemon=True).start()

    def drop(self) -> None:
        """Swallow all that is sent through the present connections, without closing them."""
        self._dropped = set(self._connections)

    def close(self) -> None:
        """Close everything."""
        for each in (self._listener, *self._connections):
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def _accept(self) -> None:
        with suppress(OSError):  # as its closing is
            while True:
                client, _ = self._listener.accept()
                self.accepted += 1
                try:
                    server = socket.create_connection(self._server)
                except OSError:
                    client.close()
                    continue
                self._connections |= {client, server}
                if self.cut:
                    self._dropped |= {client, server}
                for pair, seen in (((client, server), self._seen), ((server, client), bytes)):
                    threading.Thread(target=self._pass, args=(*pair, seen), daemon=True).start()

    def _pass(
        self, source: socket.socket, target: socket.socket, seen: Callable[[bytes], object]
    ) -> None:
        with suppress(OSError):
            while data := source.recv(2**16):
                if source not in self._dropped:
                    target.sendall(data)
                    seen(data)
        if source not in self._dropped:
            for end in (source, target):
                with suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)
