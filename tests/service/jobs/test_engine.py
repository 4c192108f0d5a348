"""The engine keeps Dask from looking all the time for what nobody asked it to look for."""

from __future__ import annotations

import asyncio

import dask
import distributed.scheduler
import pytest
from distributed import Scheduler

from vibroimpact_service.jobs.engine import calm


def test_workers_tell_seldom_that_they_live() -> None:
    assert distributed.scheduler.heartbeat_interval(2) == 5.0
    assert distributed.scheduler.heartbeat_interval(10_000) > 5.0


@pytest.mark.parametrize("timeout", [None, "1 hour"])
def test_schedulers_look_for_timeouts_only_where_there_are_any(timeout: str | None) -> None:
    names = ("idle-timeout", "no-workers-timeout")
    settings = {f"distributed.scheduler.{name}": timeout for name in names}

    async def looking() -> list[bool]:
        where = {"host": "127.0.0.1", "port": 0, "dashboard_address": "127.0.0.1:0"}
        async with Scheduler(**where) as scheduler:
            calm(scheduler)
            return [scheduler.periodic_callbacks[name].is_running() for name in names]

    with dask.config.set(settings):
        assert asyncio.run(looking()) == [timeout is not None] * 2
