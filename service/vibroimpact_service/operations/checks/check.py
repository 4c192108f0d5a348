"""The outcome of a check."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

State = Literal["ok", "warning", "failed"]


@dataclass(frozen=True, slots=True)
class Check:
    """The outcome of a check.

    Parameters
    ----------
    name : str
        What was checked.
    state : {"ok", "warning", "failed"}
        Failed: the service does not start, or does not work.
    seen : str
        What was there.
    advice : str
        What to do; empty where all is well.
    """

    name: str
    state: State
    seen: str
    advice: str = ""


def ok(name: str, seen: str) -> Check:
    """Return the outcome of a check where all is well."""
    return Check(name, "ok", seen)


def warning(name: str, seen: str, advice: str) -> Check:
    """Return the outcome of a check that leaves the service working."""
    return Check(name, "warning", seen, advice)


def failed(name: str, seen: str, advice: str) -> Check:
    """Return the outcome of a check that does not leave the service working."""
    return Check(name, "failed", seen, advice)
