"""Callers: their owner, their scopes and their limits."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final


class Scope(StrEnum):
    """What a key or token permits."""

    READ = "read"
    """Read jobs, results and systems of the owner."""
    SUBMIT = "submit"
    """Compute, plan, queue, cancel and store systems."""
    METRICS = "metrics"
    """Read the service's own figures."""
    ADMIN = "admin"
    """Make and revoke keys, read the audit log."""


@dataclass(frozen=True, slots=True)
class Caller:
    """An authenticated caller.

    Parameters
    ----------
    owner : str
        Owner of the jobs, results and systems that the caller may use.
    name : str
        Id of the key, or of the token's subject; rates are counted for it.
    scopes : frozenset of Scope
    requests_per_minute : int, optional
        Absent: any number.
    seconds_per_hour : float, optional
        Computing time; absent: any time.
    """

    owner: str
    name: str
    scopes: frozenset[Scope]
    requests_per_minute: int | None = None
    seconds_per_hour: float | None = None


LOCAL: Final = Caller("local", "local", frozenset(Scope))
"""Every caller of a service without keys, who has no limits."""
