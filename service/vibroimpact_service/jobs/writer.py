"""Group commit: one thread writes, and all that waits meanwhile shares the next transaction."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, Final, TypeVar

from sqlalchemy.engine import Connection, Engine

from vibroimpact_service.jobs.database import RecordsUnavailableError, failing
from vibroimpact_service.store import StoreFullError

Value = TypeVar("Value")
_MOST: Final = 200

Operation = Callable[[Connection], Any]


class Writer:
    """Runs operations on the database, one after the other, several to a transaction.

    A future is done only after the transaction of its operation was committed. Where one of
    a group fails, the group is rolled back and each of its operations is tried alone.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._waiting: queue.SimpleQueue[tuple[Operation, Future[Any]] | None]
        self._waiting = queue.SimpleQueue()
        self._lock, self._closed = threading.Lock(), False
        self._thread = threading.Thread(target=self._run, name="record-writer", daemon=True)
        self._thread.start()

    def submit(self, operation: Callable[[Connection], Value]) -> Future[Value]:
        """Queue an operation; its future is done once it is durable.

        Once the writer is closed, the future has a RecordsUnavailableError.
        """
        future: Future[Value] = Future()
        with self._lock:
            if self._closed:
                future.set_exception(RecordsUnavailableError("the service ends"))
            else:
                self._waiting.put((operation, future))
        return future

    def close(self) -> None:
        """Write what waits, then stop."""
        with self._lock:
            if not self._closed:
                self._waiting.put(None)
            self._closed = True
        self._thread.join()

    def _run(self) -> None:
        while True:
            group = []
            item = self._waiting.get()
            while item is not None:
                # From here on it cannot be cancelled: it may be committed at any moment.
                if item[1].set_running_or_notify_cancel():
                    group.append(item)
                if len(group) == _MOST or self._waiting.empty():
                    break
                item = self._waiting.get()
            if group:
                self._commit(group)
            if item is None:
                return

    def _commit(self, group: list[tuple[Operation, Future[Any]]]) -> None:
        try:
            with failing(), self._engine.begin() as connection:
                values = [operation(connection) for operation, _ in group]
        except (RecordsUnavailableError, StoreFullError) as error:
            # It is nobody's fault in particular: trying each alone would only take longer.
            for _, future in group:
                future.set_exception(error)
            return
        except Exception as error:
            if len(group) == 1:
                group[0][1].set_exception(error)
                return
            for item in group:
                self._commit([item])
            return
        for (_, future), value in zip(group, values, strict=True):
            future.set_result(value)
