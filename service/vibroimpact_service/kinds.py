"""The one table of computations.

To add a kind:

1. Write the solver module, called as the kind; it offers ``plan``, ``solve``, ``split``,
   ``join`` and the result class ``Result``; and ``content``, where chunks are to be shared
   between requests (see `Kind.axis`).
2. Declare the fields of its result in `vibroimpact_solvers.results`, and write its request in
   `vibroimpact_schema.requests`. The document of the result follows from the declaration.
3. Write the function that makes the solver's problem of the request, of that name, in `decode`.
4. Add one row to `KINDS`, and an example to ``openapi/vibroimpact_schema/examples``.
5. To let it be swept, add a row to `vibroimpact_solvers.sweep.kinds.KINDS`.

Routes, jobs, encodings and the contract follow from the row.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Protocol, cast

from vibroimpact_schema import branches as branch_requests
from vibroimpact_schema import calibrations, requests, results, slow_flows, sweeps
from vibroimpact_service import problems
from vibroimpact_service.result_documents import document
from vibroimpact_solvers.results import (
    attractors,
    branches,
    calibration,
    ensemble,
    existence_bands,
    impact_modes,
    natural_frequencies,
    periodic_motions,
    resonances,
    slow_flow,
    time_history,
)

if TYPE_CHECKING:
    from vibroimpact_solvers.plan import Plan, Tick


class Solver(Protocol):
    """What the module of a computation offers.

    Where each chunk of a problem needs the one before, it offers ``follow(chunk, plan, before,
    tick)``, which returns a part of class ``Part`` from the part before (None: it is the first),
    and ``Assembly(problem, sink)``, which puts parts together one by one: its ``add(part)``
    hands their rows on to the sink (`rows.RowFiles`), and in the end ``labels()`` and ``plain()``
    return the arrays and the other fields that are missing. Chunks are then computed in turn,
    and the result is written without ever being in memory.
    """

    Result: type[Any]

    def plan(self, problem: Any) -> Plan:
        """Decide what will be done."""

    def solve(self, problem: Any, plan: Plan, tick: Tick | None = None) -> Any:
        """Do it; `tick(done, total)` is called often and may raise to stop it."""

    def split(self, problem: Any, plan: Plan, seconds: float) -> list[Any]:
        """Cut a problem into those of chunks of about that cost."""

    def content(self, problem: Any) -> bytes:
        """Return what tells a chunk from all others; called where the kind has an axis.

        Chunks with the same content, of requests that are equal apart from their axis, give the
        same numbers to the last bit where the plans of both took the same methods.
        """

    def join(self, problem: Any, plan: Plan, results: Sequence[Any]) -> Any:
        """Put the results of the chunks together."""


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
    extent : str
        Field of the request with which the time of a plan grows most.
    structure : tuple of str
        Path of the structure in a request.
    axis : str, optional
        Field of the request along which `split` cuts and which `content` covers: requests that
        differ in it alone share the chunks that they have in common, which outlive their jobs.
    """

    name: str
    title: str
    request: (
        type[requests.ComputationRequest]
        | type[branch_requests.BranchesRequest]
        | type[calibrations.CalibrationRequest]
        | type[sweeps.SweepRequest]
    )
    result: type[results.Result]
    axis: str | None = None
    extent: str = field(kw_only=True)
    structure: tuple[str, ...] = field(default=("system",), kw_only=True)

    @property
    def identifier(self) -> str:
        """Name of the solver's module, of the function that decodes requests, in operations."""
        return self.name.replace("-", "_")

    @property
    def solver(self) -> Solver:
        """The solver's module; numerical libraries load at its first use, which takes long."""
        return cast("Solver", importlib.import_module(f"vibroimpact_solvers.{self.identifier}"))


KINDS: Final[Mapping[str, Kind]] = {
    kind.name: kind
    for kind in (
        Kind(
            "natural-frequencies",
            "Natural frequencies",
            requests.NaturalFrequenciesRequest,
            document("natural-frequencies", natural_frequencies.Result),
            extent="count",
        ),
        Kind(
            "impact-modes",
            "Impact modes",
            requests.ImpactModesRequest,
            document("impact-modes", impact_modes.Result),
            axis="frequency",
            extent="frequency",
        ),
        Kind(
            "existence-bands",
            "Existence bands",
            requests.ExistenceBandsRequest,
            document("existence-bands", existence_bands.Result),
            extent="frequency",
        ),
        Kind(
            "resonances",
            "Internal resonances",
            requests.ResonancesRequest,
            document("resonances", resonances.Result),
            extent="odd_max",
        ),
        Kind(
            "periodic-motions",
            "Periodic motions",
            requests.PeriodicMotionsRequest,
            document("periodic-motions", periodic_motions.Result),
            extent="frequency",
        ),
        Kind(
            "branches",
            "Branches",
            branch_requests.BranchesRequest,
            document("branches", branches.Result),
            structure=("base", "system"),
            extent="base",
        ),
        Kind(
            "attractors",
            "Attractors",
            requests.AttractorsRequest,
            document("attractors", attractors.Result),
            extent="initial",
        ),
        Kind(
            "time-history",
            "Time history",
            requests.TimeHistoryRequest,
            document("time-history", time_history.Result),
            extent="t",
        ),
        Kind(
            "ensemble",
            "Ensemble",
            requests.EnsembleRequest,
            document("ensemble", ensemble.Result),
            axis="initial",
            extent="initial",
        ),
        Kind(
            "slow-flow",
            "Slow flows",
            slow_flows.SlowFlowRequest,
            document("slow-flow", slow_flow.Result),
            extent="t",
        ),
        Kind(
            "calibration",
            "Calibration",
            calibrations.CalibrationRequest,
            document("calibration", calibration.Result),
            structure=("base", "system"),
            extent="data",
        ),
        Kind(
            "sweep",
            "Sweep",
            sweeps.SweepRequest,
            sweeps.SweepResult,
            axis="axes",
            structure=("base", "system"),
            extent="axes",
        ),
    )
}


def named(name: str, *prefix: str) -> Kind:
    """Return the kind of that name; `prefix` is the path from the body to the name.

    Raises
    ------
    ProblemError
        422 where there is none.
    """
    if name not in KINDS:
        message = f"must be one of {', '.join(KINDS)}"
        raise problems.invalid(problems.pointer(prefix), "unknown_choice", message)
    return KINDS[name]
