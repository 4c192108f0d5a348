"""Short ways to solve slow flows, and their reference numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from vibroimpact_solvers import slow_flow
from vibroimpact_solvers.model import System
from vibroimpact_solvers.slow_flow import Initial, Problem, Result

Reference = Callable[[str, str], dict[str, Any]]
EVERYTHING = frozenset(slow_flow.OUTPUTS)


@pytest.fixture
def values(reference: Reference) -> Callable[[str], dict[str, Any]]:
    """Return the function name -> values of an entry."""

    def found(name: str) -> dict[str, Any]:
        entry: dict[str, Any] = reference("slow_flow", name)["values"]
        return entry

    return found


@pytest.fixture(scope="session")
def solved() -> Callable[..., Result]:
    """Return the function that solves a slow flow."""

    def solving(
        system: System,
        model: str,
        variant: str,
        t: Any,
        outputs: frozenset[str] = EVERYTHING,
        **initial: Any,
    ) -> Result:
        times = np.atleast_1d(np.asarray(t, dtype=float))
        problem = Problem(system, model, variant, Initial(**initial), times, outputs)
        return slow_flow.solve(problem, slow_flow.plan(problem))

    return solving


@pytest.fixture(scope="session")
def order() -> Callable[[Any, Any], float]:
    """Return the function (sizes, errors) -> order: the slope of a line through the logarithms."""
    return lambda sizes, errors: float(np.polyfit(np.log(sizes), np.log(errors), 1)[0])
