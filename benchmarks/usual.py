"""What is usual for hot kernels, in ``usual.json``, and what differs from it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

_FILE: Final = Path(__file__).with_suffix(".json")


@dataclass(frozen=True, slots=True)
class Verdict:
    """What was found of one kernel.

    Parameters
    ----------
    name : str
    found, usual : float or None
        Work of the kernel over that of its reference; None where one of both is not known.
    margin : float
        Times the usual that is too much.
    """

    name: str
    found: float | None
    usual: float | None
    margin: float

    @property
    def good(self) -> bool:
        """Whether the kernel is as quick as usual."""
        if self.found is None or self.usual is None:
            return False
        return self.found <= self.usual * self.margin

    def __str__(self) -> str:
        if self.usual is None:
            return f"{self.name}: nothing usual is known, take it with --usual"
        if self.found is None:
            return f"{self.name}: was not measured"
        times = self.found / self.usual
        what = "" if self.good else f", too slow: at most {self.margin}"
        return f"{self.name}: {self.found:.4g} of its reference, {times:.2f} times the usual{what}"


def compared(
    found: Mapping[str, float], usual: Mapping[str, float], margin: float
) -> list[Verdict]:
    """Compare what was found with what is usual: of every kernel that either of both knows."""
    names = dict.fromkeys([*usual, *found])
    return [Verdict(name, found.get(name), usual.get(name), margin) for name in names]


def told(verdicts: list[Verdict]) -> int:
    """Print the verdicts; return how many are bad, at most 1."""
    for verdict in verdicts:
        print(verdict)
    return int(not all(verdict.good for verdict in verdicts))


def load(what: str) -> dict[str, float]:
    """Return the usual ratios, of ``"instructions"`` or of ``"times"``."""
    known: dict[str, float] = json.loads(_FILE.read_text())[what] if _FILE.exists() else {}
    return known


def save(what: str, found: Mapping[str, float]) -> None:
    """Keep ratios as the usual ones."""
    known = json.loads(_FILE.read_text()) if _FILE.exists() else {}
    known[what] = {name: float(f"{ratio:.4g}") for name, ratio in found.items()}
    _FILE.write_text(json.dumps(known, indent=2) + "\n")
