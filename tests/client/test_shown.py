"""Progress bars in notebooks, and plans as text and as tables."""

from __future__ import annotations

import sys
import types
from typing import Any

import pytest

from vibroimpact import progress
from vibroimpact.plans import Plan

PLAN = Plan(
    steps=[
        {"stage": "spectrum", "method": "dense", "reason": "M & K are full", "count": 1},
        {"stage": "impulse", "method": "scalar", "reason": "one constraint", "count": 3},
    ],
    skips=[{"what": "shape", "why": "not <asked>"}],
    seconds=0.01234,
    cached=False,
    inline=True,
)


def test_a_plan_reads_as_words() -> None:
    assert str(PLAN).splitlines() == [
        "spectrum: dense – M & K are full",
        "impulse: scalar – one constraint",
        "skipped: shape – not <asked>",
        "about 0.012 s of computation, answered directly",
    ]
    assert str(Plan(PLAN | {"cached": True})).endswith("the result is already stored")
    assert str(Plan(PLAN | {"inline": False})).endswith("run as a job")
    assert PLAN["seconds"] == 0.01234


def test_a_plan_is_a_table_in_notebooks() -> None:
    shown = PLAN._repr_html_()
    assert shown.count("<tr>") == 4
    assert "M &amp; K are full" in shown
    assert "not &lt;asked&gt;" in shown


def test_in_a_notebook_the_bar_is_html(monkeypatch: pytest.MonkeyPatch) -> None:
    """Doubles of IPython's display: what is shown first and what it becomes."""
    shown: list[str] = []
    handle = types.SimpleNamespace(update=shown.append)

    def display(first: str, *, display_id: bool) -> Any:
        assert display_id
        shown.append(first)
        return handle

    double = types.ModuleType("IPython.display")
    double.HTML, double.display = str, display  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "IPython", types.ModuleType("IPython"))
    monkeypatch.setitem(sys.modules, "IPython.display", double)
    monkeypatch.setattr(progress, "Console", lambda: types.SimpleNamespace(is_jupyter=True))
    with progress.bar("sweep") as show:
        show({"progress": {"done": 2, "total": 7}, "waiting_reason": None, "phase": "a < b"})
    assert shown[0] == "sweep"
    assert "value='2'" in shown[1]
    assert "max='7'" in shown[1]
    assert "2/7 a &lt; b" in shown[1]
