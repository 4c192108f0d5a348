"""Access to a database, from the event loop and from threads; writes share transactions."""

from __future__ import annotations

import asyncio
import queue
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import Any, Final, NamedTuple, TypeVar, TypeVarTuple

from sqlalchemy.engine import Connection, Engine

from vibroimpact_service.jobs.database import RecordsUnavailableError, failing, reader
from vibroimpact_service.jobs.reserve import Reserve
from vibroimpact_service.store import StoreFullError
from vibroimpact_service.store.faults import Silence

Value = TypeVar("Value")
Arguments = TypeVarTuple("Arguments")

_READERS: Final = 4
_MAX_OPERATIONS: Final = 200

_UNREACHED: Final = "the database cannot be reached"

_Operation = Callable[[Connection], Any]


def _unmeasured(_operation: str, _seconds: float) -> None:
    """Keep no account of transactions."""


class _Write(NamedTuple):
    """A write that waits for its turn."""

    operation: _Operation
    future: Future[Any]
    trial: bool
    """Whether it is the one that tries a silent server."""
    reserved: bool = False
    """Whether it may use the room that is kept for it where there is no other."""


@cache
def _silence_of(_url: str) -> Silence:
    """Return what this process knows of the server of a database."""
    return Silence()


class RecordAccess:
    """Reads records in a few threads, and writes them in one thread, several per transaction.

    Queries and operations are functions whose first argument is a connection, such as those of
    `records` and `claims`. All methods raise `RecordsUnavailableError` and `StoreFullError`.

    A write is done only after its transaction was committed. Where one operation of a group
    fails, the group is rolled back and each operation is repeated alone. Those that end work may
    use what is kept of a disk that is full (`reserve`).

    Of a server that is known to be silent, which one of them learns for all of the process, only
    one now and then waits; the others have their error at once.

    Parameters
    ----------
    database : Engine
    measured : callable
        ``("read" or "write", seconds) -> None``: called after each transaction.
    reserve : Reserve, optional
        What `end` may use of a disk that is full.
    """

    def __init__(
        self,
        database: Engine,
        measured: Callable[[str, float], None] = _unmeasured,
        reserve: Reserve | None = None,
    ) -> None:
        self.database, self._measured = database, measured
        self._reader = reader(database)
        self._silence, self._reserve = _silence_of(str(database.url)), reserve
        self._threads = ThreadPoolExecutor(_READERS, "records")
        self._waiting: queue.SimpleQueue[_Write | None]
        self._waiting = queue.SimpleQueue()
        self._lock, self._closed = threading.Lock(), False
        self._writer = threading.Thread(target=self._write_all, name="record-writer", daemon=True)
        self._writer.start()

    def submit(
        self,
        operation: Callable[[Connection, *Arguments], Value],
        *args: *Arguments,
        reserved: bool = False,
    ) -> Future[Value]:
        """Queue an operation; its future is done once it is durable.

        Once the access is closed, the future has a RecordsUnavailableError.
        """
        future: Future[Value] = Future()
        with self._lock:
            trial = self._silence.known
            if self._closed:
                future.set_exception(RecordsUnavailableError("the service ends"))
            elif not self._silence.admits():
                future.set_exception(RecordsUnavailableError(_UNREACHED))
            else:
                work = _Write(lambda c: operation(c, *args), future, trial, reserved)
                self._waiting.put(work)
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

    async def end(
        self, operation: Callable[[Connection, *Arguments], Value], *args: *Arguments
    ) -> Value:
        """As `write`, of an operation that ends work: also where the disk is full."""
        return await asyncio.wrap_future(self.submit(operation, *args, reserved=True))

    def read_now(
        self, query: Callable[[Connection, *Arguments], Value], *args: *Arguments
    ) -> Value:
        """Return the value of a query; blocks the calling thread."""
        return self._read(self._admitted(), query, *args)

    def _admitted(self) -> bool:
        """Return whether a query is one that tries a silent server."""
        trial = self._silence.known
        if not self._silence.admits():
            raise RecordsUnavailableError(_UNREACHED)
        return trial

    def _read(
        self, trial: bool, query: Callable[[Connection, *Arguments], Value], *args: *Arguments
    ) -> Value:
        with self._answering(trial), self._timed("read"), self._reader.connect() as connection:
            return query(connection, *args)

    @contextmanager
    def _answering(self, trial: bool) -> Iterator[None]:
        """Translate errors, and remember whether the server answers.

        What had to wait for its turn meanwhile does not wait for a silent server as well.
        """
        if self._silence.known and not trial:
            raise RecordsUnavailableError(_UNREACHED)
        started = time.monotonic()
        try:
            with failing():
                yield
        except RecordsUnavailableError as error:
            if self._silent(error):
                self._silence.failed(started)
            else:
                self._silence.spoke()
            raise
        except BaseException:
            self._silence.spoke()
            raise
        self._silence.spoke()

    def _silent(self, error: RecordsUnavailableError) -> bool:
        """Whether an error is not one that a server has told, as of a lock that took too long."""
        told = getattr(getattr(error.__cause__, "orig", None), "sqlstate", None)
        return told is None and self.database.dialect.name != "sqlite"

    async def read(
        self, query: Callable[[Connection, *Arguments], Value], *args: *Arguments
    ) -> Value:
        """Return the value of a query."""
        loop, trial = asyncio.get_running_loop(), self._admitted()
        return await loop.run_in_executor(self._threads, lambda: self._read(trial, query, *args))

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
                if item.future.set_running_or_notify_cancel():
                    group.append(item)
                if len(group) == _MAX_OPERATIONS or self._waiting.empty():
                    break
                item = self._waiting.get()
            if group:
                self._commit(group)
            if item is None:
                return

    def _commit(self, group: list[_Write]) -> None:
        trial = any(item.trial for item in group)
        try:
            with (
                self._answering(trial),
                self._timed("write"),
                self.database.begin() as connection,
            ):
                values = [item.operation(connection) for item in group]
        except (RecordsUnavailableError, StoreFullError) as error:
            ends = [item._replace(reserved=False) for item in group if item.reserved]
            full = isinstance(error, StoreFullError)
            if ends and full and self._reserve is not None and self._reserve.spend():
                self._commit(ends)
                group = [item for item in group if not item.reserved]
            # No single operation is to blame, so repeating each alone would only take longer.
            for item in group:
                item.future.set_exception(error)
            return
        except Exception as error:
            if len(group) == 1:
                group[0].future.set_exception(error)
                return
            for item in group:
                self._commit([item])
            return
        for item, value in zip(group, values, strict=True):
            item.future.set_result(value)
        if self._reserve is not None:
            self._reserve.keep()
