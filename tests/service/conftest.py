"""What tests of the service share: settings, a store, and a job queue that is a double."""

from __future__ import annotations

import asyncio
import uuid
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import fsspec
import pytest
import structlog
from starlette.testclient import TestClient

from tests.service.object_store import Server
from vibroimpact_service.app import create_app
from vibroimpact_service.jobs.attempts import Attempt
from vibroimpact_service.jobs.engine import EngineUnavailableError
from vibroimpact_service.jobs.metrics import JobMetrics
from vibroimpact_service.jobs.observation import Backlog, Observation
from vibroimpact_service.jobs.records import KeyReusedError, NewJob
from vibroimpact_service.jobs.tables import JobRow
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store
from vibroimpact_service.use_case import chunks as job_chunks

# Errors as plain text: pictures of all that a traceback holds take seconds each.
structlog.configure(
    processors=[
        structlog.contextvars.merge_contextvars,
        structlog.processors.add_log_level,
        structlog.dev.ConsoleRenderer(exception_formatter=structlog.dev.plain_traceback),
    ]
)


class Engine:
    """No workers."""

    ready = True
    failure = None
    workers = 2

    async def run(self, function: Any, *args: Any, used: Any = None) -> Any:
        raise EngineUnavailableError


class Queue:
    """A job queue in memory, without workers: a job runs when the test says so."""

    def __init__(self, store: Store) -> None:
        self.store = store
        self.rows: dict[str, JobRow] = {}
        self.keys: dict[str, NewJob] = {}
        self.key_results: dict[tuple[str, str], str] = {}
        self.engine = Engine()
        self.metrics = JobMetrics()
        self.faults: dict[str, str] = {}
        self.at_once = False
        self._changed = asyncio.Event()

    async def start(self) -> None:
        """Nothing to start."""

    async def close(self) -> None:
        """Nothing to close."""

    async def checks(self) -> dict[str, str]:
        workers = "ok" if self.engine.ready else self.engine.failure or "starting"
        return {"records": "ok", "store": "ok", "workers": workers} | self.faults

    async def retry_all(
        self, owner: str, chosen: Sequence[str] | None, kind: str | None, most: int
    ) -> list[str]:
        return []

    async def history(self, job: JobRow) -> list[Attempt]:
        return []

    def computes(self, result: str) -> bool:
        return False

    async def request(self, name: str) -> bytes | None:
        return self.store.requests.get(name)

    async def submit(self, new: NewJob) -> JobRow:
        if new.block is not None:
            self.store.requests.put(new.request, new.block)
        if new.key is not None:
            earlier = self.keys.setdefault(new.key, new)
            if earlier.fingerprint != new.fingerprint:
                raise KeyReusedError
            if earlier is not new:
                return self.rows[earlier.id]
        self.rows[new.id] = JobRow(
            seq=len(self.rows) + 1,
            id=new.id,
            owner=new.owner,
            kind=new.kind,
            request=new.request,
            result=new.result,
            state="succeeded" if new.reused else "queued",
            phase="done" if new.reused else "waiting",
            priority=new.priority,
            seconds=new.seconds,
            done=0,
            total=1,
            attempts=0,
            reused=new.reused,
            created=1e9,
            started=None,
            finished=None,
            claim_owner=None,
            claim_until=None,
            version=1,
            error=None,
            deadline=None if new.deadline is None else 1e9 + new.deadline,
            name=new.name,
        )
        if self.at_once:
            self.run(new.id)
        return self.rows[new.id]

    def run(self, job: str) -> None:
        """Do the work of a job in this thread, as its driver would."""
        row = self.rows[job]
        arguments = (self.store.url, row.kind, row.request, row.result)
        try:
            names = job_chunks.WORK.split(*arguments)
            for index in range(len(names)):
                job_chunks.WORK.solve(*arguments, [index])
            job_chunks.WORK.join(*arguments, names)
        except Exception as error:
            self.change(job, state="failed", error=job_chunks.WORK.explain(error))
        else:
            self.change(job, state="succeeded", done=1)

    def change(self, job: str, **values: Any) -> None:
        """Change a row and wake whoever waits for it."""
        row = self.rows[job]
        self.rows[job] = replace(row, version=row.version + 1, **values)
        self._changed.set()

    async def keep_key(self, owner: str, key: str, result: str) -> None:
        if self.key_results.setdefault((owner, key), result) != result:
            raise KeyReusedError

    async def get(self, owner: str, job: str) -> JobRow | None:
        row = self.rows.get(job)
        return row if row is not None and row.owner == owner else None

    async def positions(self, jobs: Sequence[JobRow]) -> dict[str, int]:
        queued = [row.seq for row in self.rows.values() if row.state == "queued"]
        return {j.id: sum(s < j.seq for s in queued) for j in jobs if j.state == "queued"}

    async def list(
        self, owner: str, state: str | None, kind: str | None, before: int | None, limit: int
    ) -> list[JobRow]:
        found = [
            row
            for row in reversed(self.rows.values())
            if row.owner == owner
            and state in (None, row.state)
            and kind in (None, row.kind)
            and (before is None or row.seq < before)
        ]
        return found[:limit]

    async def cancel(self, owner: str, job: str) -> JobRow | None:
        if not self.rows[job].final:
            self.change(job, state="cancelled")
        return self.rows[job]

    async def wait(
        self, owner: str, job: str, seconds: float, since: int | None = None
    ) -> JobRow | None:
        try:
            async with asyncio.timeout(seconds):
                while not self.rows[job].final and since in (None, self.rows[job].version):
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            pass
        return self.rows[job]

    async def unfinished(self, owner: str, most: int) -> int:
        mine = [row for row in self.rows.values() if row.owner == owner and not row.final]
        return min(most, len(mine))

    async def observe(self) -> Observation:
        counts = Counter((r.kind, r.owner, r.state) for r in self.rows.values() if not r.final)
        return Observation([Backlog(*alike, jobs, 7.0) for alike, jobs in counts.items()])

    def waiting_reason(self, job: JobRow, position: int) -> str | None:
        return "it is next" if job.state == "queued" else None


@pytest.fixture(scope="module")
def s3(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[], str]]:
    """Return the function that makes a bucket and returns the URL of a store in it."""
    server = Server(tmp_path_factory.mktemp("s3") / "log")
    given = {
        "AWS_ENDPOINT_URL": server.url,
        "AWS_ACCESS_KEY_ID": "test",
        "AWS_SECRET_ACCESS_KEY": "test",
        "AWS_DEFAULT_REGION": "us-east-1",
    }

    def url() -> str:
        bucket = f"bucket-{uuid.uuid4().hex}"
        fsspec.filesystem("s3").mkdir(bucket)
        return f"s3://{bucket}/vibroimpact"

    # File systems are kept by fsspec, with the server of the module before.
    fsspec.get_filesystem_class("s3").clear_instance_cache()
    with pytest.MonkeyPatch.context() as patch:
        for name, value in given.items():
            patch.setenv(name, value)
        yield url
    server.process.kill()
    server.process.wait(10)


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(
        data=tmp_path,
        max_body_bytes=2**20,
        max_dofs=500,
        hosts=("testserver",),
        # The first request loads libraries, which takes long while the machine does other things.
        max_waiting_seconds=60.0,
        # The memory of this process is that of all tests before this one.
        inline_memory_bytes=2**50,
        # Jobs go to the queue, which computes them when the test says so.
        on_submission_seconds=0.0,
    )


@pytest.fixture
def store(settings: Settings) -> Store:
    return Store(settings.store_url)


@pytest.fixture
def queue(store: Store) -> Queue:
    return Queue(store)


@pytest.fixture
def http(settings: Settings, queue: Queue) -> Iterator[TestClient]:
    """Return a client of the application, in this process and without workers."""
    with TestClient(create_app(settings, queue)) as client:  # type: ignore[arg-type]
        yield client


@pytest.fixture
def chain() -> dict[str, Any]:
    """Return the document of a chain with one stop."""
    return {"preset": "chain", "n": 13, "constraints": [{"dof": 5, "gap": 0.2}]}


@pytest.fixture
def request_body(chain: dict[str, Any]) -> dict[str, Any]:
    """Return a small request of impact modes."""
    return {"system": chain, "frequency": {"start": 1.0, "stop": 2.0, "num": 5}}
