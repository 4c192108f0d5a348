"""Access to the database of job records, from the event loop and from threads."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Concatenate, Final, ParamSpec, TypeVar

from sqlalchemy.engine import Connection

from vibroimpact_service.jobs.database import failing, open_database, reader
from vibroimpact_service.jobs.writer import Writer

Value = TypeVar("Value")
Arguments = ParamSpec("Arguments")

_READERS: Final = 4


class RecordAccess:
    """Reads records in a few threads, and writes them in the one thread of `Writer`.

    Queries and operations are functions whose first argument is a connection, such as those of
    `records` and `claims`. All methods raise `RecordsUnavailableError` and `StoreFullError`.

    Parameters
    ----------
    url : str
        URL of the database, whose tables are brought up to date.
    """

    def __init__(self, url: str) -> None:
        self.database = open_database(url)
        self._reader = reader(self.database)
        self._writer = Writer(self.database)
        self._threads = ThreadPoolExecutor(_READERS, "records")

    def submit(
        self,
        operation: Callable[Concatenate[Connection, Arguments], Value],
        *args: Arguments.args,
        **kwargs: Arguments.kwargs,
    ) -> Future[Value]:
        """Queue an operation; its future is done once it is durable."""
        return self._writer.submit(operation, *args, **kwargs)

    def write_now(
        self,
        operation: Callable[Concatenate[Connection, Arguments], Value],
        *args: Arguments.args,
        **kwargs: Arguments.kwargs,
    ) -> Value:
        """Return the value of an operation once it is durable; blocks the calling thread."""
        return self.submit(operation, *args, **kwargs).result()

    async def write(
        self,
        operation: Callable[Concatenate[Connection, Arguments], Value],
        *args: Arguments.args,
        **kwargs: Arguments.kwargs,
    ) -> Value:
        """Return the value of an operation, once it is durable."""
        return await asyncio.wrap_future(self.submit(operation, *args, **kwargs))

    async def read(
        self,
        query: Callable[Concatenate[Connection, Arguments], Value],
        *args: Arguments.args,
        **kwargs: Arguments.kwargs,
    ) -> Value:
        """Return the value of a query."""

        def run() -> Value:
            return self.read_now(query, *args, **kwargs)

        return await asyncio.get_running_loop().run_in_executor(self._threads, run)

    def read_now(
        self,
        query: Callable[Concatenate[Connection, Arguments], Value],
        *args: Arguments.args,
        **kwargs: Arguments.kwargs,
    ) -> Value:
        """Return the value of a query; blocks the calling thread."""
        with failing(), self._reader.connect() as connection:
            return query(connection, *args, **kwargs)

    def close(self) -> None:
        """Finish the writes that wait, and close the database."""
        self._writer.close()
        self._threads.shutdown()
        self.database.dispose()
