"""The asynchronous client against a service of its own; both clients with many jobs."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vibroimpact as vi

STRUCTURE = vi.chain(7, [vi.constraint(2, 0.2)])


def request(num: int) -> dict[str, Any]:
    return vi.impact_modes_request(STRUCTURE, (0.6, 2.4, num))


def test_all_of_it_awaited(tmp_path: Path) -> None:
    async def use() -> None:
        async with vi.AsyncClient(data=tmp_path) as client:
            grids = [(0.6, 2.4, num) for num in (20, 30)]
            results = await asyncio.gather(*(client.impact_modes(STRUCTURE, g) for g in grids))
            assert [result.impulse.size for result in results] == [20, 30]
            job = await client.submit("impact-modes", request(40))
            assert (await job.wait(60, progress=True)).state == "succeeded"
            first = await job.result()
            again = await client.result(first.digest)
            np.testing.assert_array_equal(first.impulse, again.impulse)
            assert (await client.job(job.id)).final
            assert job.id in [each.id async for each in client.jobs(kind="impact-modes")]
            assert (await client.plan("impact-modes", request(40)))["cached"]
            assert "impact-modes" in (await client.version())["kinds"]
            many = await client.submit_many("impact-modes", [request(40), request(50), {}])
            assert (len(many.existing), len(many.inserted), list(many.errors)) == (1, 1, [2])
            ended = [each.state async for each in client.as_completed(many.jobs, 60)]
            assert ended == ["succeeded", "succeeded"]
            gaps = {"system.constraints.0.gap": [0.1, 0.2]}
            swept = await client.sweep("impact-modes", request(20), gaps)
            assert swept.impulse.shape == (2, 20, 1)
            lossy = vi.chain(3, [vi.constraint(0, 0.1, restitution=0.7)])
            with pytest.warns(vi.NeglectedWarning, match="restitution") as caught:
                assert len((await client.impact_modes(lossy, [2.0])).neglected) == 1
            assert [Path(each.filename) for each in caught] == [Path(__file__)]
            slow = await client.submit("impact-modes", request(2_000_000), deadline=600.0)
            assert slow.document["deadline"] is not None
            assert (await slow.cancel()).state in {"cancelled", "running"}

    asyncio.run(use())


def test_it_says_that_it_must_be_opened() -> None:
    client = vi.AsyncClient("http://nowhere")
    with pytest.raises(RuntimeError, match="async with"):
        asyncio.run(client.version())


def test_many_jobs_as_they_end(tmp_path: Path) -> None:
    with vi.Client(data=tmp_path) as client:
        many = client.submit_many("impact-modes", [request(60), {"frequency": 1}, request(70)])
        assert len(many.inserted) == 2
        assert many.errors[1].status == 422
        ended = list(client.as_completed(many.jobs, 60))
        assert {job.id for job in ended} == {job.id for job in many.jobs}
        assert {job.state for job in ended} == {"succeeded"}
