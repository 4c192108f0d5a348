"""Group commit: one thread writes, and operations that wait meanwhile share a transaction."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, Concatenate, Final, ParamSpec, TypeVar

from sqlalchemy.engine import Connection, Engine

from vibroimpact_service.jobs.database import RecordsUnavailableError, failing
from vibroimpact_service.store import StoreFullError

Value = TypeVar("Value")
Arguments = ParamSpec("Arguments")
_MAX_OPERATIONS: Final = 200

_Operation = Callable[[Connection], Any]


class Writer:
    """Performs operations on the database one after the other, several per transaction.

    A future is done only after the transaction of its operation was committed. Where one
    operation of a group fails, the group is rolled back and each operation is repeated alone.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._waiting: queue.SimpleQueue[tuple[_Operation, Future[Any]] | None]
        self._waiting = queue.SimpleQueue()
        self._lock, self._closed = threading.Lock(), False
        self._thread = threading.Thread(target=self._run, name="record-writer", daemon=True)
        self._thread.start()

    def submit(
        self,
        operation: Callable[Concatenate[Connection, Arguments], Value],
        *args: Arguments.args,
        **kwargs: Arguments.kwargs,
    ) -> Future[Value]:
        """Queue an operation, which is called with a connection; its future is done once durable.

        Once the writer is closed, the future has a RecordsUnavailableError.
        """
        future: Future[Value] = Future()

        def bound(connection: Connection) -> Value:
            return operation(connection, *args, **kwargs)

        with self._lock:
            if self._closed:
                future.set_exception(RecordsUnavailableError("the service ends"))
            else:
                self._waiting.put(
                    (lambda connection: operation(connection, *args, **kwargs), future)
                )
        return future

    def close(self) -> None:
        """Perform the operations that wait, then stop."""
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
                if len(group) == _MAX_OPERATIONS or self._waiting.empty():
                    break
                item = self._waiting.get()
            if group:
                self._commit(group)
            if item is None:
                return

    def _commit(self, group: list[tuple[_Operation, Future[Any]]]) -> None:
        try:
            with failing(), self._engine.begin() as connection:
                values = [operation(connection) for operation, _ in group]
        except (RecordsUnavailableError, StoreFullError) as error:
            # No single operation is to blame, so repeating each alone would only take longer.
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
