"""The command that runs benchmarks finds them in a checkout, and says so elsewhere."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer import Typer
from typer.testing import CliRunner

from vibroimpact import bench

ROOT = Path(__file__).parents[2]


def call(*arguments: str) -> tuple[int, str]:
    app = Typer()
    app.command()(bench.bench)
    done = CliRunner().invoke(app, list(arguments))
    return done.exit_code, done.output


def test_lists_what_the_registry_has() -> None:
    code, output = call("--list")
    assert code == 0
    assert output.startswith("defaults: ")
    assert "  scaling.memory\n" in output


def test_unknown_name(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    code, output = call("scalling")
    assert code == 2
    assert output == "No benchmark is called scalling. There is: scaling.\n"


def test_outside_a_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "checkout", lambda *places: None)
    code, output = call("--list")
    assert code == 2
    assert "in a checkout" in output


def test_checkout_is_found_from_anywhere_inside() -> None:
    outside = Path(ROOT.anchor)  # a temporary folder may lie inside the checkout
    assert bench.checkout(ROOT / "docs" / "images") == ROOT
    assert bench.checkout(outside) is None
    assert bench.checkout(outside, ROOT) == ROOT
