"""Whoever asks: whose jobs and results they see, and what they may do."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final


class Scope(StrEnum):
    """What a key or token can be good for."""

    READ = "read"
    """Look at one's own jobs, results and systems."""
    SUBMIT = "submit"
    """Compute, plan, queue, cancel and store systems."""
    METRICS = "metrics"
    """Read the service's own figures."""
    ADMIN = "admin"
    """Make and revoke keys, read the log of such acts."""


@dataclass(frozen=True, slots=True)
class Allowance:
    """How much somebody may ask for; None: no bound.

    Parameters
    ----------
    requests_per_minute : int, optional
    seconds_per_hour : float, optional
        Planned seconds of computing.
    """

    requests_per_minute: int | None = None
    seconds_per_hour: float | None = None


UNBOUNDED: Final = Allowance()


@dataclass(frozen=True, slots=True)
class Caller:
    """Somebody who was recognised.

    Parameters
    ----------
    owner : str
        Whose jobs, results and systems they see.
    name : str
        What they came with: the id of a key, or of a token's subject. Rates are counted for it.
    scopes : frozenset of Scope
    allowance : Allowance
    """

    owner: str
    name: str
    scopes: frozenset[Scope]
    allowance: Allowance = UNBOUNDED


LOCAL: Final = Caller("local", "local", frozenset(Scope))
"""Everybody, where no keys are needed."""
