"""The one table of computations.

To add a kind:

1. Write the solver module; it offers ``plan``, ``solve``, ``split``, ``join`` and the result
   class ``Result``, whose arrays say what they are (`vibroimpact_solvers.arrays.Quantity`).
2. Write its request in `vibroimpact_schema.requests` and its result in
   `vibroimpact_schema.results`.
3. Write the function that makes the solver's problem of the request, in `decode`.
4. Add one row to `KINDS`, and an example to ``openapi/examples``.

Routes, jobs, encodings and the contract follow from the row.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Protocol, cast

from vibroimpact_schema import requests, results
from vibroimpact_service.jobs.work import Tick

if TYPE_CHECKING:
    from vibroimpact_solvers.model import System
    from vibroimpact_solvers.plan import Plan


class Solver(Protocol):
    """What the module of a computation offers."""

    Result: type[Any]

    def plan(self, problem: Any) -> Plan:
        """Decide what will be done."""

    def solve(self, problem: Any, plan: Plan, tick: Tick | None = None) -> Any:
        """Do it; `tick(done, total)` is called often and may raise to stop it."""

    def split(self, problem: Any, plan: Plan, seconds: float) -> list[Any]:
        """Cut a problem into pieces of about that cost."""

    def join(self, problem: Any, plan: Plan, results: Sequence[Any]) -> Any:
        """Put the results of the pieces together."""


@dataclass(frozen=True, slots=True)
class Kind:
    """One computation.

    Parameters
    ----------
    name : str
        As in addresses.
    title : str
        In words.
    request, result : type
        Documents.
    module : str
        The solver's module; imported at first use, because numerical libraries take longer to
        import than the service may take to start.
    decoder : str
        Name of the function in `decode` that makes a problem of a request.
    """

    name: str
    title: str
    request: type[requests.ComputationRequest]
    result: type[results.Result]
    module: str
    decoder: str

    @property
    def solver(self) -> Solver:
        """The solver's module."""
        return cast("Solver", importlib.import_module(self.module))

    def problem(self, request: requests.ComputationRequest, system: System) -> Any:
        """Return the solver's problem of a request."""
        decode = importlib.import_module("vibroimpact_service.decode")
        make = cast("Callable[[Any, Any], Any]", getattr(decode, self.decoder))
        return make(request, system)


KINDS: Final[Mapping[str, Kind]] = {
    kind.name: kind
    for kind in (
        Kind(
            "impact-modes",
            "Impact modes",
            requests.ImpactModesRequest,
            results.ImpactModesResult,
            "vibroimpact_solvers.impact_modes",
            "impact_modes",
        ),
    )
}
