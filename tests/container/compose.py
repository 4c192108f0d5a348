"""What a compose file says of its containers, with variables put in."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

_VARIABLE = re.compile(r"\$\{([A-Z_]+)(?:(:[-?])([^}]*))?\}")


def interpolated(text: str, variables: Mapping[str, str]) -> str:
    """Put variables into a text, as Compose does: ``${A}``, ``${A:-default}``, ``${A:?message}``.

    Raises
    ------
    KeyError
        Where one that is required has no value.
    """

    def value(match: re.Match[str]) -> str:
        name, operator, rest = match.groups()
        given = variables.get(name, "")
        if operator == ":-":
            return given or rest
        if operator == ":?" and not given:
            raise KeyError(f"{name}: {rest}")
        return given

    return _VARIABLE.sub(value, text)


def read(path: Path, variables: Mapping[str, str]) -> dict[str, Any]:
    """Read a compose file."""
    # Comments are not interpolated.
    text = re.sub(r"^\s*#.*$", "", path.read_text(), flags=re.M)
    document: dict[str, Any] = yaml.safe_load(interpolated(text, variables))
    return document


def number_of_bytes(text: str) -> int:
    """Return the bytes of a size such as ``2g`` or ``512m``."""
    units = {"k": 2**10, "m": 2**20, "g": 2**30}
    return int(text[:-1]) * units[text[-1]] if text[-1] in units else int(text)


def seconds(text: str) -> float:
    """Return the seconds of a duration such as ``15s``."""
    assert text.endswith("s")
    return float(text[:-1])
