"""The examples in docstrings of the solvers run and print what they show."""

from __future__ import annotations

import doctest
from importlib import import_module
from pathlib import Path

import pytest

import vibroimpact_solvers

_FOLDER = Path(vibroimpact_solvers.__file__).parent

PUBLIC = (
    "attractors",
    "branches",
    "ensemble",
    "existence_bands",
    "factors",
    "impact_modes",
    "matrices",
    "model",
    "periodic_motions",
    "plan",
    "presets",
    "receptance",
    "resonances",
    "slow_flow",
    "spectrum",
    "stability",
    "sweep",
    "time_history",
)
"""Modules and packages that have an example in their own docstring."""


def _with_examples() -> list[str]:
    names = []
    for path in sorted(_FOLDER.rglob("*.py")):
        if ">>> " in path.read_text(encoding="utf-8"):
            parts = path.relative_to(_FOLDER.parent).with_suffix("").parts
            names.append(".".join(parts).removesuffix(".__init__"))
    return names


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("name", _with_examples())
def test_examples_print_what_they_show(name: str) -> None:
    outcome = doctest.testmod(import_module(name), optionflags=doctest.NORMALIZE_WHITESPACE)
    assert outcome.attempted > 0
    assert outcome.failed == 0


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_module_opens_with_an_example(name: str) -> None:
    text = import_module(f"vibroimpact_solvers.{name}").__doc__ or ""
    assert doctest.DocTestParser().get_examples(text)
