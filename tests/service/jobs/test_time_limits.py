"""Transactions that nobody ends keep their rows from the others only so long."""

from __future__ import annotations

import time
from collections.abc import Callable

import psycopg
import pytest
import sqlalchemy as sa

from vibroimpact_service.jobs import time_limits
from vibroimpact_service.jobs.database import open_database


def test_transactions_that_the_server_forgot_are_ended(postgresql: Callable[[], str]) -> None:
    url = postgresql()
    engine = open_database(url)
    # The server keeps no limit of these: one of the service, one of somebody else, and one of the
    # service that may take as long as it needs.
    names = (time_limits.NAME, "another", f"{time_limits.NAME} without limits")
    others = [psycopg.connect(url.replace("+psycopg", ""), application_name=name) for name in names]
    try:
        for each in others:
            each.execute("SELECT 1")
        time.sleep(0.3)
        with engine.connect() as connection:
            assert time_limits.end_forgotten(connection) == 0
            assert time_limits.end_forgotten(connection, 0.2) == 1
        with pytest.raises(psycopg.OperationalError):
            others[0].execute("SELECT 1")
        for each in others[1:]:
            each.execute("SELECT 1")
    finally:
        for each in others:
            each.close()
        engine.dispose()


def test_transactions_without_limits_say_so(postgresql: Callable[[], str]) -> None:
    engine = open_database(postgresql())
    with engine.begin() as connection:
        time_limits.remove_limits(connection)
        shown = connection.execute(sa.text("SHOW application_name")).scalar_one()
        assert shown == f"{time_limits.NAME} without limits"
    engine.dispose()


def test_there_is_nothing_to_end_in_a_file() -> None:
    engine = sa.create_engine("sqlite://")
    with engine.connect() as connection:
        assert time_limits.end_forgotten(connection) == 0
    engine.dispose()
