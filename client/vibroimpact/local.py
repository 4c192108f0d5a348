"""Computations without a server."""

from __future__ import annotations

import math
from collections.abc import Mapping
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any, Self

from vibroimpact import kinds
from vibroimpact.arguments import hyphenated, number
from vibroimpact.computations import Computations
from vibroimpact.errors import MissingExtra, from_problem
from vibroimpact.parts import Parts
from vibroimpact.plain import plain
from vibroimpact.plans import Plan
from vibroimpact.results import Result

if TYPE_CHECKING:
    from vibroimpact import documents
    from vibroimpact_schema.entries import Entry


class Local(
    Computations[
        kinds.NaturalFrequencies,
        kinds.ImpactModes,
        kinds.ExistenceBands,
        kinds.Resonances,
        kinds.PeriodicMotions,
        kinds.Branches,
        kinds.Attractors,
        kinds.TimeHistory,
        kinds.Ensemble,
        kinds.SlowFlow,
        kinds.Calibration,
        kinds.Sweep,
    ]
):
    """Computes without a server, with the methods of `Client` for every kind of computation.

    There is no job and no store: nothing continues when the program ends. Results are bit for bit
    those of a service. A process of the program's own computes them, with the memory of a worker
    (``VIBROIMPACT_WORKER_MEMORY_BYTES``); Ctrl-C ends it at once.

    Parameters
    ----------
    seconds : float, optional
        Processor time that each computation may take; default: as much as it needs.

    Raises
    ------
    ValueError
        If `seconds` is not positive.

    Examples
    --------
    >>> result = Local().impact_modes(chain(13, [constraint(5, 0.2)]), [1.4])  # doctest: +SKIP
    """

    def __init__(self, *, seconds: float | None = None) -> None:
        self._seconds = math.inf if seconds is None else number("seconds", seconds)
        if not self._seconds > 0.0:
            raise ValueError(f"seconds must be positive, not {seconds!r}")

    def _compute(self, kind: str, request: Mapping[str, Any], *, progress: bool = False) -> Result:
        if not progress:
            return _result(self._answer("compute", hyphenated(kind), request, None, self._seconds))
        from vibroimpact.progress import counter

        with counter(kind) as tick:
            return _result(self._answer("compute", hyphenated(kind), request, tick, self._seconds))

    def plan(self, kind: documents.Kind, request: documents.Request) -> Plan:
        """Return the steps of a computation and those it skips, with reasons; compute nothing."""
        return Plan(self._answer("plan", hyphenated(kind), request))

    def close(self) -> None:
        """Do nothing: there is nothing to close."""

    def __repr__(self) -> str:
        """Return what it is."""
        return "<Local: computes in a process beside the program>"

    def __enter__(self) -> Self:
        """Return the object."""
        return self

    def __exit__(self, *error: object) -> None:
        """Do nothing."""

    def _answer(self, function: str, *arguments: Any) -> Any:
        module = _module()
        try:
            return getattr(module, function)(*map(plain, arguments))
        except module.RefusedError as error:
            raise from_problem(error.document) from None


def _result(entries: list[Entry]) -> Result:
    return kinds.read(Parts(entries))


def _module() -> ModuleType:
    try:
        return import_module("vibroimpact_service.local")
    except ImportError as error:
        raise MissingExtra("computations without a service", "all", error) from error
