"""Writing of records: what comes too late is told so."""

from __future__ import annotations

from pathlib import Path

import pytest
from sqlalchemy import text

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
