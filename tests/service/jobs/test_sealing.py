"""Secrets of webhooks in the records, and what others can read of the data folder."""

from __future__ import annotations

import asyncio
import base64
import os
import sys
import uuid
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
import counting

from vibroimpact_service.jobs import sealing
from vibroimpact_service.jobs.queue import JobQueue
from vibroimpact_service.jobs.records import NewJob
from vibroimpact_service.jobs.sealing import SealedError, Sealing
from vibroimpact_service.jobs.tables import webhooks
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store

SECRET = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw"
LONGEST = "whsec_" + "QUJD" * 22


@pytest.mark.parametrize("secret", [SECRET, LONGEST])
def test_a_sealed_secret_opens_for_its_job_alone(secret: str) -> None:
    made = Sealing(b"the key of this service")
    sealed = made.seal("job_1", secret)
    assert len(sealed) <= webhooks.c.secret.type.length
    assert secret[6:30] not in sealed
    assert base64.b64decode(secret[6:])[:16] not in base64.b64decode(sealed[5:])
    assert made.open("job_1", sealed) == secret
    assert made.seal("job_2", secret) != sealed
    for other, job in ((made, "job_2"), (Sealing(b"the key of another one"), "job_1")):
        with pytest.raises(SealedError):
            other.open(job, sealed)


def test_what_an_earlier_version_recorded_is_read() -> None:
    assert Sealing(b"key").open("job_1", SECRET) == SECRET


def test_replicas_share_what_they_are_given(tmp_path: Path) -> None:
    key = tmp_path / "key.pem"
    key.write_text("private")
    given = [{"webhook_key": "sixteen letters or more"}, {"tls_key": key}, {}]
    sealed = []
    for settings in given:
        one, two = (
            sealing.of_settings(Settings(data=tmp_path / folder, **settings))
            for folder in ("a", "b")
        )
        sealed.append(one.seal("job", SECRET))
        if settings:
            assert two.open("job", sealed[-1]) == SECRET
        else:  # files of their own, which stay
            with pytest.raises(SealedError):
                two.open("job", sealed[-1])
            again = sealing.of_settings(Settings(data=tmp_path / "a"))
            assert again.open("job", sealed[-1]) == SECRET
    assert len(set(sealed)) == 3


@pytest.fixture
def generous() -> Iterator[None]:
    """Let everybody read new files, unless the service says otherwise."""
    before = os.umask(0)
    yield
    os.umask(before)


def test_nobody_else_reads_the_data_folder_nor_a_secret(tmp_path: Path, generous: None) -> None:
    folder = tmp_path / "above" / "data"
    folder.mkdir(parents=True, mode=0o755)  # as version 0.1.0 made it
    settings = Settings(data=folder, workers=1, webhook_private=True)

    async def scenario() -> None:
        store = Store(settings.store_url)
        queue = JobQueue(settings, store, counting.WORK)
        await queue.start()
        try:
            store.requests.put("r" * 64, b"{}")
            hook = ("https://127.0.0.1:9/", SECRET)
            name = f"job_{uuid.uuid4().hex}"
            new = NewJob(name, "ann", "squares", "r" * 64, "s" * 64, 0, 5.0, False, webhook=hook)
            await queue.submit(new)
            with store.results.workspace() as work:
                assert work.stat().st_mode & 0o077 == 0
            assert folder.stat().st_mode & 0o777 == 0o700
            paths = list(folder.rglob("*"))
            assert {path.name for path in paths} >= {"lock", "records.sqlite", "webhook.key"}
            for path in paths:
                expected = 0o700 if path.is_dir() else 0o600
                assert path.stat().st_mode & 0o777 == expected, path
            text = base64.b64decode(SECRET[6:])
            for path in paths:
                if path.is_file():
                    data = path.read_bytes()
                    assert SECRET[6:].encode() not in data, path
                    assert text not in data, path
        finally:
            await queue.close()

    asyncio.run(scenario())
