"""The kinds of computation as methods: of both clients, and of the builder of requests."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar, overload

from vibroimpact.arguments import hyphenated, names
from vibroimpact.computations.driven import Curves, DrivenComputations, Motions, Settled
from vibroimpact.computations.histories import History, HistoryComputations, Many, Slow
from vibroimpact.computations.modes import Bands, ModeComputations, Modes, Natural, Resonant
from vibroimpact.grids import axis

if TYPE_CHECKING:
    from vibroimpact import documents
    from vibroimpact.arguments import Document
    from vibroimpact.computations.fields import Values

    Swept = Literal[
        "natural-frequencies",
        "impact-modes",
        "existence-bands",
        "resonances",
        "periodic-motions",
        "attractors",
        "time-history",
        "slow-flow",
    ]

Grid = TypeVar("Grid")


class Computations(
    ModeComputations[Natural, Modes, Bands, Resonant],
    DrivenComputations[Motions, Curves, Settled],
    HistoryComputations[History, Many, Slow],
    Generic[Natural, Modes, Bands, Resonant, Motions, Curves, Settled, History, Many, Slow, Grid],
):
    """One method for each kind of computation: it makes the request document and computes it.

    An answer is a result, an awaitable one, or the request itself; each kind has its own type.
    """

    @overload
    def compute(
        self,
        kind: Literal["natural-frequencies"],
        request: documents.NaturalFrequenciesRequest,
        *,
        progress: bool = False,
    ) -> Natural: ...

    @overload
    def compute(
        self,
        kind: Literal["impact-modes"],
        request: documents.ImpactModesRequest,
        *,
        progress: bool = False,
    ) -> Modes: ...

    @overload
    def compute(
        self,
        kind: Literal["existence-bands"],
        request: documents.ExistenceBandsRequest,
        *,
        progress: bool = False,
    ) -> Bands: ...

    @overload
    def compute(
        self,
        kind: Literal["resonances"],
        request: documents.ResonancesRequest,
        *,
        progress: bool = False,
    ) -> Resonant: ...

    @overload
    def compute(
        self,
        kind: Literal["periodic-motions"],
        request: documents.PeriodicMotionsRequest,
        *,
        progress: bool = False,
    ) -> Motions: ...

    @overload
    def compute(
        self,
        kind: Literal["branches"],
        request: documents.BranchesRequest,
        *,
        progress: bool = False,
    ) -> Curves: ...

    @overload
    def compute(
        self,
        kind: Literal["attractors"],
        request: documents.AttractorsRequest,
        *,
        progress: bool = False,
    ) -> Settled: ...

    @overload
    def compute(
        self,
        kind: Literal["time-history"],
        request: documents.TimeHistoryRequest,
        *,
        progress: bool = False,
    ) -> History: ...

    @overload
    def compute(
        self,
        kind: Literal["ensemble"],
        request: documents.EnsembleRequest,
        *,
        progress: bool = False,
    ) -> Many: ...

    @overload
    def compute(
        self,
        kind: Literal["slow-flow"],
        request: documents.SlowFlowRequest,
        *,
        progress: bool = False,
    ) -> Slow: ...

    @overload
    def compute(
        self, kind: Literal["sweep"], request: documents.SweepRequest, *, progress: bool = False
    ) -> Grid: ...

    def compute(
        self, kind: documents.Kind, request: documents.Request, *, progress: bool = False
    ) -> Any:
        """Compute a request of any kind; where the service queues it, wait for the job.

        Parameters
        ----------
        kind : str
            Kind of computation, such as ``"impact-modes"``.
        request : mapping
            The request document, for example from `impact_modes_request`.
        progress : bool
            Show a progress bar while a job runs.

        Raises
        ------
        ServerError
            If the request is wrong or cannot be computed.
        MissingExtra
            If the computation is to be done in this process and the solvers are not installed.
        """
        return self._compute(kind, request, progress=progress)

    def sweep(
        self,
        kind: Swept,
        base: documents.BaseRequest,
        axes: Mapping[str, Values],
        outputs: Sequence[str] | None = None,
        *,
        continued: bool = False,
        progress: bool = False,
    ) -> Grid:
        """Compute a request at every point of a parameter grid.

        Whatever does not depend on an axis is computed once for all its values.

        Parameters
        ----------
        kind : str
            Kind of computation, such as ``"impact-modes"``.
        base : dict
            A request of that kind, for example from `impact_modes_request`.
        axes : mapping
            Path of a number in the base -> its values: an array, (start, stop, num), or a
            dictionary with start, stop and step; they may descend. The axes are the first
            dimensions of the results, in this order.
        outputs : sequence of str, optional
            Quantities to compute; default: the outputs of the base.
        continued : bool
            Start each point where the last ended, along the first axis, as a test on a shaker
            does: of attractors and time histories. The base's initial state is that of the first
            point, and in time histories the phases of harmonic loads run on.
        progress : bool
            Show a progress bar while a job runs.
        """
        request: Document = {
            "kind": hyphenated(kind),
            "base": dict(base),
            "axes": [axis(path, values) for path, values in axes.items()],
        }
        if outputs is not None:
            request["outputs"] = names(outputs)
        if continued:
            request["continue"] = True
        answer: Grid = self._compute("sweep", request, progress=progress)
        return answer
