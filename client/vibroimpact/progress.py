"""The progress bar of a waiting job, in a terminal or in a notebook."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

if TYPE_CHECKING:
    from vibroimpact import documents


@contextmanager
def bar(title: str) -> Iterator[Callable[[documents.Job], None]]:
    """Show a bar; yield the function that updates it from the job document."""
    if Console().is_jupyter:
        # In notebooks rich requires ipywidgets.
        yield _notebook_bar(title)
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[phase]}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True)) as progress:
        task = progress.add_task(title, total=None, phase="waiting")

        def show(job: documents.Job) -> None:
            done = job["progress"]
            phase = job["waiting_reason"] or job["phase"]
            progress.update(task, completed=done["done"], total=done["total"], phase=phase)

        yield show


@contextmanager
def counter(title: str) -> Iterator[Callable[[int, int], None]]:
    """Show a bar; yield the function that updates it from the work done and all work."""
    with bar(title) as show:

        def tick(done: int, total: int) -> None:
            progress = {"done": done, "total": total}
            state: Any = {"progress": progress, "waiting_reason": None, "phase": "computing"}
            show(state)

        yield tick


def _notebook_bar(title: str) -> Callable[[documents.Job], None]:
    from IPython.display import HTML, display

    handle = display(HTML(escape(title)), display_id=True)

    def show(job: documents.Job) -> None:
        done = job["progress"]
        phase = job["waiting_reason"] or job["phase"] or ""
        handle.update(
            HTML(
                f"{escape(title)} <progress max='{done['total'] or 1}' value='{done['done']}'>"
                f"</progress> {done['done']}/{done['total']} {escape(phase)}"
            )
        )

    return show
