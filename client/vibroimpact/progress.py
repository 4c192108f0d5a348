"""The progress bar of a waiting job, in a terminal or in a notebook."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn


@contextmanager
def bar(title: str) -> Iterator[Callable[[dict[str, Any]], None]]:
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
    with Progress(*columns) as progress:
        task = progress.add_task(title, total=None, phase="waiting")

        def show(job: dict[str, Any]) -> None:
            done = job["progress"]
            phase = job["waiting_reason"] or job["phase"]
            progress.update(task, completed=done["done"], total=done["total"], phase=phase)

        yield show


def _notebook_bar(title: str) -> Callable[[dict[str, Any]], None]:
    from IPython.display import HTML, display

    handle = display(HTML(escape(title)), display_id=True)

    def show(job: dict[str, Any]) -> None:
        done = job["progress"]
        phase = job["waiting_reason"] or job["phase"] or ""
        handle.update(
            HTML(
                f"{escape(title)} <progress max='{done['total'] or 1}' value='{done['done']}'>"
                f"</progress> {done['done']}/{done['total']} {escape(phase)}"
            )
        )

    return show
