"""Two replicas on one PostgreSQL: equal requests at the same time are computed once."""

from __future__ import annotations

import asyncio
import hashlib
import json
import sys
import uuid
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import counting

from vibroimpact_service.jobs.queue import JobQueue
from vibroimpact_service.jobs.records import NewJob
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store


def test_equal_requests_are_computed_once_by_both(
    postgresql: Callable[[], str], tmp_path: Path
) -> None:
    log = tmp_path / "log"
    database, store = postgresql(), Store(str(tmp_path / "store"))

    def queue(name: str) -> JobQueue:
        settings = Settings(
            data=tmp_path / name, database=database, store=store.url, workers=1, running_jobs=4
        )
        return JobQueue(settings, store, counting.WORK)

    def new(n: int) -> NewJob:
        data = json.dumps({"n": n, "chunk": 10, "sleep": 0.02, "log": str(log)}).encode()
        request, result = (hashlib.sha256(data + end).hexdigest() for end in (b"", b"result"))
        return NewJob(
            f"job_{uuid.uuid4().hex}", "ann", "squares", request, result, 0, 5.0, False, block=data
        )

    async def scenario() -> None:
        replicas = [queue("a"), queue("b")]
        for replica in replicas:
            await replica.start()
        try:
            sizes = (100, 110, 120, 130)
            submitted = await asyncio.gather(
                *(
                    replica.submit(new(size))
                    for size in sizes
                    for _ in range(3)
                    for replica in replicas
                )
            )
            # Each is asked of the replica that it was not submitted to.
            others = [replicas[(i + 1) % 2] for i in range(len(submitted))]
            done = await asyncio.gather(
                *(
                    other.wait("ann", job.id, 120)
                    for other, job in zip(others, submitted, strict=True)
                )
            )
            assert [job.state for job in done if job] == ["succeeded"] * len(submitted)
            for size in sizes:
                data = store.results.get(new(size).result)
                assert int(data or b"0") == sum(i * i for i in range(size))
            computed = [job for job in done if job and not job.reused]
            assert len(computed) == len({job.result for job in computed}) == len(sizes)
        finally:
            for replica in replicas:
                await replica.close()

    asyncio.run(scenario())
    begun = [int(line) for line in log.read_text().split()]
    assert len(begun) == sum(-(-size // 10) for size in (100, 110, 120, 130))
