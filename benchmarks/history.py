"""Results of runs, kept as files: one for each run of a benchmark, named by its time."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchmarks import harness
from benchmarks.tables import Table

FOLDER = Path(__file__).parent / "results"


@dataclass(frozen=True, slots=True)
class Failure:
    """A table that could not be made.

    Parameters
    ----------
    part : str
        Name of the function; empty for the whole benchmark.
    error : str
    """

    part: str
    error: str


@dataclass(frozen=True, slots=True)
class Run:
    """Tables that one benchmark returned, when and where.

    Parameters
    ----------
    name : str
        The benchmark.
    when : str
        UTC, ISO 8601.
    commit : str
        Of the sources, with ``+`` where they had changes.
    machine : dict
    tables : tuple of Table
    failures : tuple of Failure
    """

    name: str
    when: str
    commit: str
    machine: dict[str, Any]
    tables: tuple[Table, ...]
    failures: tuple[Failure, ...] = ()


def run_of(name: str, tables: Sequence[Table], failures: Sequence[Failure] = ()) -> Run:
    """Return a run made now."""
    when = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    return Run(name, when, _commit(), harness.machine(), tuple(tables), tuple(failures))


def save(run: Run) -> Path:
    """Write a run to its file."""
    folder = FOLDER / run.name
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{run.when.replace(':', '').replace('-', '')}.json"
    document = {
        "name": run.name,
        "when": run.when,
        "commit": run.commit,
        "machine": run.machine,
        "tables": [table.document() for table in run.tables],
        "failures": [asdict(failure) for failure in run.failures],
    }
    path.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return path


def runs(name: str) -> list[Run]:
    """Return the runs of one benchmark, oldest first."""
    return [_read(path) for path in sorted((FOLDER / name).glob("*.json"))]


def _read(path: Path) -> Run:
    document = json.loads(path.read_text(encoding="utf-8"))
    tables = tuple(Table.of(table) for table in document["tables"])
    failures = tuple(Failure(**failure) for failure in document.get("failures", ()))
    name, when, commit, machine = (document[k] for k in ("name", "when", "commit", "machine"))
    return Run(name, when, commit, machine, tables, failures)


def _commit() -> str:
    def git(*arguments: str) -> str:
        command = ["git", "-C", str(FOLDER.parent), *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        return done.stdout.strip()

    changed = "+" if git("status", "--porcelain", "--untracked-files=no") else ""
    return (git("rev-parse", "--short", "HEAD") or "unknown") + changed
