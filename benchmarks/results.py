"""Stored results: one file for each table, the newest measurement of it."""

from __future__ import annotations

import json
import subprocess
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from pydantic import TypeAdapter

from benchmarks import harness
from benchmarks.tables import Table

FOLDER = Path(__file__).parent / "results"


@dataclass(frozen=True, slots=True)
class Measurement:
    """A table measured once, or the reason why it could not be measured.

    Parameters
    ----------
    benchmark, part : str
        The benchmark, and its table by the name of the function that measures it.
    when : str
        UTC, ISO 8601.
    commit : str
        Of the sources, with ``+`` where they had changes.
    machine : dict
    table : Table, optional
    failure : str
        The error, where there is no table.
    """

    benchmark: str
    part: str
    when: str
    commit: str
    machine: dict[str, Any]
    table: Table | None = None
    failure: str = ""

    @classmethod
    def now(cls, benchmark: str, part: str, outcome: Table | str) -> Measurement:
        """Return what was measured now on this machine: a table, or an error."""
        when = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        surroundings = (benchmark, part, when, _commit(), harness.machine())
        if isinstance(outcome, str):
            return cls(*surroundings, failure=outcome)
        return cls(*surroundings, table=outcome)

    def save(self) -> Path:
        """Write it to the file of its table, in place of the one before."""
        path = FOLDER / self.benchmark / f"{self.part}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps(asdict(self), indent=1, ensure_ascii=False)
        path.write_text(text + "\n", encoding="utf-8")
        return path


def load(benchmark: str, part: str) -> Measurement | None:
    """Return the newest measurement of a table, None where there is none."""
    path = FOLDER / benchmark / f"{part}.json"
    return _DOCUMENT.validate_json(path.read_bytes()) if path.exists() else None


_DOCUMENT: Final = TypeAdapter(Measurement)


def _commit() -> str:
    def git(*arguments: str) -> str:
        command = ["git", "-C", str(FOLDER.parent), *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        return done.stdout.strip()

    changed = "+" if git("status", "--porcelain", "--untracked-files=no") else ""
    return (git("rev-parse", "--short", "HEAD") or "unknown") + changed
