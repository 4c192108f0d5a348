"""The data folder of a service, which one process uses at a time."""

from __future__ import annotations

import os
from pathlib import Path
from typing import IO

from vibroimpact_service.store import private


class DataInUseError(RuntimeError):
    """Another service runs on the same data folder."""


def lock(data: Path) -> IO[str]:
    """Lock the data folder for this process, until the file that is returned is closed.

    Only the process that holds the lock may put running jobs of the records back at its start.

    Raises
    ------
    DataInUseError
        Where another process holds the lock.
    """
    private.folder(data)
    if data.stat().st_uid == os.getuid():
        data.chmod(0o700)  # an earlier version made it readable for everybody
    try:
        return private.locked(data / "lock")
    except BlockingIOError:
        raise DataInUseError(f"another service runs on {data}") from None
