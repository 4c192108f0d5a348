"""Access to a database, from the event loop and from threads; writes share transactions."""

from __future__ import annotations

import asyncio
import queue
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, Final, TypeVar, TypeVarTuple

from sqlalchemy.engine import Connection, Engine

from vibroimpact_service.jobs.database import RecordsUnavailableError, failing, reader
from vibroimpact_service.store import StoreFullError

Value = TypeVar("Value")
Arguments = TypeVarTuple("Arguments")

_READERS: Final = 4
_MAX_OPERATIONS: Final = 200

_Operation = Callable[[Connection], Any]


def _unmeasured(_operation: str, _seconds: float) -> None:
    """Keep no account of transactions."""


class RecordAccess:
    """Reads records in a few threads, and writes them in one thread, several per transaction.

    Queries and operations are functions whose first argument is a connection, such as those of
    `records` and `claims`. All methods raise `RecordsUnavailableError` and `StoreFullError`.

    A write is done only after its transaction was committed. Where one operation of a group
    fails, the group is rolled back and each operation is repeated alone.

    Parameters
    ----------
    database : Engine
    measured : callable
        ``("read" or "write", seconds) -> None``: called after each transaction.
    """

    def __init__(
        self, database: Engine, measured: Callable[[str, float], None] = _unmeasured
    ) -> None:
        self.database, self._measured = database, measured
        self._reader = reader(database)
        self._threads = ThreadPoolExecutor(_READERS, "records")
        self._waiting: queue.SimpleQueue[tuple[_Operation, Future[Any]] | None]
        self._waiting = queue.SimpleQueue()
        self._lock, self._closed = threading.Lock(), False
        self._writer = threading.Thread(target=self._write_all, name="record-writer", daemon=True)
        self._writer.start()

    def submit(
        self, operation: Callable[[Connection, *Arguments], Value], *args: *Arguments
    ) -> Future[Value]:
        """Queue an operation; its future is done once it is durable.

        Once the access is closed, the future has a RecordsUnavailableError.
        """
        future: Future[Value] = Future()
        with self._lock:
            if self._closed:
                future.set_exception(RecordsUnavailableError("the service ends"))
            else:
                self._waiting.put((lambda connection: operation(connection, *args), future))
        return future

    def write_now(
        self, operation: Callable[[Connection, *Arguments], Value], *args: *Arguments
    ) -> Value:
        """Return the value of an operation once it is durable; blocks the calling thread."""
        return self.submit(operation, *args).result()

    async def write(
        self, operation: Callable[[Connection, *Arguments], Value], *args: *Arguments
    ) -> Value:
        """Return the value of an operation, once it is durable."""
        return await asyncio.wrap_future(self.submit(operation, *args))

    def read_now(
        self, query: Callable[[Connection, *Arguments], Value], *args: *Arguments
    ) -> Value:
        """Return the value of a query; blocks the calling thread."""
        with self._timed("read"), failing(), self._reader.connect() as connection:
            return query(connection, *args)

    async def read(
        self, query: Callable[[Connection, *Arguments], Value], *args: *Arguments
    ) -> Value:
        """Return the value of a query."""
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._threads, lambda: self.read_now(query, *args))

    def close(self) -> None:
        """Finish the writes that wait, and close the database."""
        with self._lock:
            if not self._closed:
                self._waiting.put(None)
            self._closed = True
        self._writer.join()
        self._threads.shutdown()
        self.database.dispose()

    @contextmanager
    def _timed(self, operation: str) -> Iterator[None]:
        began = time.perf_counter()
        try:
            yield
        finally:
            self._measured(operation, time.perf_counter() - began)

    def _write_all(self) -> None:
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
            with self._timed("write"), failing(), self.database.begin() as connection:
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
