"""What systems share that differ in their limiters only, and what is kept beside it."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, wraps
from typing import Protocol, TypeVar

from vibroimpact_solvers.factors import Solve
from vibroimpact_solvers.matrices import SymmetricMatrix


@dataclass(frozen=True, eq=False)
class Body:
    """A structure without its limiters, the same object for all systems that `limited` returns.

    What is computed from the matrices alone is kept beside it (`once_per_body`).
    """

    M: SymmetricMatrix

    @cached_property
    def solve_M(self) -> Solve:
        """The function that solves with M."""
        return self.M.factorize(definite=True)

    def __getstate__(self) -> dict[str, object]:
        """Return what is copied to other processes: without factors, which are quickly made."""
        return {"M": self.M}


class HasBody(Protocol):
    """A system."""

    @property
    def body(self) -> Body:
        """What it shares with systems that differ from it in their limiters only."""


Value = TypeVar("Value")
OfBody = TypeVar("OfBody", bound=HasBody)


def once_per_body(compute: Callable[[OfBody], Value]) -> Callable[[OfBody], Value]:
    """Return a function of the matrices of a system that is computed once for each body.

    Its values must not hold the system.
    """
    kept: weakref.WeakKeyDictionary[Body, Value] = weakref.WeakKeyDictionary()

    @wraps(compute)
    def value(system: OfBody) -> Value:
        try:
            return kept[system.body]
        except KeyError:
            return kept.setdefault(system.body, compute(system))

    return value
