"""Requests that work, a file ``<kind>.<name>.json`` each: shown in the contract, run by tests."""

from __future__ import annotations

import json
from functools import cache
from importlib import resources
from typing import Any


def requests(kind: str) -> dict[str, dict[str, Any]]:
    """Return the examples of a kind, by name: {"summary", "request"}."""
    examples = {}
    for file in sorted(resources.files(__name__).iterdir(), key=lambda entry: entry.name):
        prefix, _, rest = file.name.partition(".")
        if prefix == kind and rest.endswith(".json"):
            examples[rest.removesuffix(".json")] = json.loads(file.read_text())
    return examples


def answers(operation: str) -> dict[str, Any]:
    """Return examples of the answers of an operation, by status; they were given by a service."""
    return dict(_answers().get(operation, {}))


@cache
def _answers() -> dict[str, dict[str, Any]]:
    answers = json.loads(resources.files(__name__).joinpath("answers.json").read_text())
    assert isinstance(answers, dict)
    return answers
