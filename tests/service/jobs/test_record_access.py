"""Access to records: what comes too late is told so, and so is what a silent server would keep."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text
from sqlalchemy.engine import Connection

from tests.acceptance.faults.proxy import Proxy
from vibroimpact_service.jobs import database
from vibroimpact_service.jobs.database import RecordsUnavailableError, open_database
from vibroimpact_service.jobs.record_access import RecordAccess


def test_what_waits_is_written_and_what_comes_later_is_refused(tmp_path: Path) -> None:
    access = RecordAccess(open_database(f"sqlite:///{tmp_path / 'records.sqlite'}"))
    waiting = [access.submit(lambda c, i=i: c.scalar(text(f"SELECT {i}"))) for i in range(500)]  # type: ignore[misc]
    access.close()
    assert [future.result(0) for future in waiting] == list(range(500))
    with pytest.raises(RecordsUnavailableError):
        access.submit(lambda c: c.scalar(text("SELECT 1"))).result(5)
    access.close()


def one(connection: Connection) -> Any:
    return connection.scalar(text("SELECT 1"))


def seconds_of(call: Callable[[], Any]) -> float:
    """Return after how long a call says that there are no records."""
    began = time.monotonic()
    with pytest.raises(RecordsUnavailableError):
        call()
    return time.monotonic() - began


@pytest.fixture
def proxy(postgresql: Callable[[], str], monkeypatch: pytest.MonkeyPatch) -> Iterator[Proxy]:
    """Return a proxy before a database, of whose silence one is sure sooner than usual."""
    monkeypatch.setattr("vibroimpact_service.jobs.time_limits._PING_SECONDS", 1.0)
    monkeypatch.setitem(database._TCP_LIMITS, "connect_timeout", 2)
    monkeypatch.setattr("vibroimpact_service.store.faults._TRIAL_SECONDS", 1.5)
    proxy = Proxy(postgresql())
    yield proxy
    proxy.close()


def test_not_everybody_waits_for_a_silent_database(proxy: Proxy) -> None:
    """One learns it for jobs and keys; of the others one now and then tries, until one succeeds."""
    jobs, keys = (RecordAccess(open_database(proxy.url)) for _ in range(2))
    assert jobs.write_now(one) == jobs.read_now(one) == keys.read_now(one) == 1
    proxy.cut = True
    proxy.drop()
    assert seconds_of(lambda: jobs.write_now(one)) > 2.0
    with ThreadPoolExecutor(1) as pool:
        trial = pool.submit(seconds_of, lambda: jobs.write_now(one))
        while not jobs._silence._next_trial:
            assert not trial.done()
            time.sleep(0.01)
        before = proxy.accepted
        for call in (jobs.write_now, jobs.read_now, keys.read_now):
            with pytest.raises(RecordsUnavailableError):
                call(one)
        assert proxy.accepted <= before + 1  # that of the trial: nobody else has asked
        assert trial.result() > 1.0
    proxy.cut = False
    while True:
        try:
            assert jobs.read_now(one) == 1
            break
        except RecordsUnavailableError:
            time.sleep(0.05)
    assert jobs.write_now(one) == keys.read_now(one) == 1
    jobs.close()
    keys.close()


def test_what_waits_for_its_turn_does_not_wait_for_a_silent_database_too(proxy: Proxy) -> None:
    access = RecordAccess(open_database(proxy.url))
    access.write_now(one)
    proxy.cut = True
    proxy.drop()
    before = proxy.accepted
    first = access.submit(one)
    time.sleep(0.2)  # it is under way
    later = [access.submit(one) for _ in range(5)]
    for each in (first, *later):
        with pytest.raises(RecordsUnavailableError):
            each.result(60.0)
    assert proxy.accepted <= before + 2  # of the first one, and of those behind it together
    proxy.cut = False
    access.close()


def test_a_lock_that_takes_too_long_is_an_answer(
    postgresql: Callable[[], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vibroimpact_service.store.faults._LONG_SECONDS", 0.1)
    access = RecordAccess(open_database(postgresql()))

    def slow(connection: Connection) -> None:
        connection.execute(text("SET LOCAL statement_timeout = '300ms'"))
        connection.execute(text("SELECT pg_sleep(5)"))

    with pytest.raises(RecordsUnavailableError):
        access.write_now(slow)
    assert not access._silence.known
    access.close()
