"""Room that an SQLite database keeps on its disk, so that jobs can be ended where that is full."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from sqlalchemy.engine import Engine

from vibroimpact_service.store import private

BYTES: Final = 2**18
"""What some hundred transactions that end jobs take in the database's log."""


class Reserve:
    """A file beside a database that is removed where there is no other room; PostgreSQL has none.

    Parameters
    ----------
    database : Engine
    """

    def __init__(self, database: Engine) -> None:
        name = database.url.database if database.dialect.name == "sqlite" else None
        self._file = Path(f"{name}-reserve") if name else None
        self._kept = False
        self.keep()

    def keep(self) -> None:
        """Write the file where it is missing and there is room; a disk that is full has none."""
        if self._file is None or self._kept:
            return
        try:
            with open(self._file, "wb", opener=private.opener) as file:
                file.write(os.urandom(BYTES))  # zeros might take no room
            self._kept = True
        except OSError:
            self._file.unlink(missing_ok=True)

    def spend(self) -> bool:
        """Remove the file; return whether there was one."""
        if self._file is None or not self._file.exists():
            return False
        self._kept = False
        self._file.unlink(missing_ok=True)
        return True
