"""The progress bar of a waiting job."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn


@contextmanager
def bar(title: str) -> Iterator[Callable[[dict[str, Any]], None]]:
    """Show a bar; what is yielded takes the job document as it changes."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[phase]}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns) as progress:
        task = progress.add_task(title, total=None, phase="waiting")

        def show(job: dict[str, Any]) -> None:
            done = job["progress"]
            phase = job["waiting_reason"] or job["phase"]
            progress.update(task, completed=done["done"], total=done["total"], phase=phase)

        yield show
