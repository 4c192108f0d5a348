"""The kinds of computation as methods: of both clients, and of the builder of requests."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar, overload

from vibroimpact import grids, measurements
from vibroimpact.arguments import hyphenated, names
from vibroimpact.computations.driven import Curves, DrivenComputations, Motions, Settled
from vibroimpact.computations.fields import integer, present
from vibroimpact.computations.histories import History, HistoryComputations, Many, Slow
from vibroimpact.computations.modes import Bands, ModeComputations, Modes, Natural, Resonant

if TYPE_CHECKING:
    from vibroimpact import documents
    from vibroimpact.arguments import Document
    from vibroimpact.computations.fields import Values

    Axis = documents.AxisValues | documents.AxisPoints | documents.AxisSteps
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

    Calibrated = Literal["natural-frequencies", "impact-modes", "time-history"]

Fitted = TypeVar("Fitted")
Grid = TypeVar("Grid")


class Computations(
    ModeComputations[Natural, Modes, Bands, Resonant],
    DrivenComputations[Motions, Curves, Settled],
    HistoryComputations[History, Many, Slow],
    Generic[
        Natural,
        Modes,
        Bands,
        Resonant,
        Motions,
        Curves,
        Settled,
        History,
        Many,
        Slow,
        Fitted,
        Grid,
    ],
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
        self,
        kind: Literal["calibration"],
        request: documents.CalibrationRequest,
        *,
        progress: bool = False,
    ) -> Fitted: ...

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

    def calibration(
        self,
        kind: Calibrated,
        base: documents.CalibratedRequest,
        unknowns: Mapping[str, Any] | Sequence[Mapping[str, Any]],
        data: Sequence[Mapping[str, Any]],
        *,
        starts: int | None = None,
        evaluations: int | None = None,
        seed: int | None = None,
        outputs: Sequence[str] | None = None,
        progress: bool = False,
    ) -> Fitted:
        """Find unknown numbers of a request from measurements of its outputs.

        Parameters
        ----------
        kind : str
            Kind of computation, such as ``"time-history"``.
        base : dict
            A request of that kind, for example from `time_history_request`; its outputs are those
            that are measured.
        unknowns : mapping or sequence of dict
            Path of a number in the base -> where the search starts, (start, lower, upper), or a
            dictionary with start and, where wanted, lower, upper and prior (mean, sigma).
        data : sequence of dict
            Measurements, each with ``output``, such as ``"impacts.time"`` or ``"x"``, ``values`` in
            its shape (nan: not measured), ``sigma``, the standard deviation of the noise, and of
            histories the times ``t``; absent: those of the base.
        starts : int, optional
            Searches at most; default: 8. They end when two agree on a fit that the data permits.
        evaluations : int, optional
            Most evaluations of the model in one search; default: 100.
        seed : int, optional
            Of the points from which searches start; default: made of the data.
        outputs : sequence of str, optional
            covariance, interval, undetermined, residual, chi2, model_fits; default: all.
        progress : bool
            Show a progress bar while a job runs.
        """
        request: Document = {
            "kind": kind,
            "base": dict(base),
            "unknowns": measurements.unknowns(unknowns),
            "data": measurements.measured(data),
        }
        options = present(
            starts=integer("starts", starts),
            evaluations=integer("evaluations", evaluations),
            seed=integer("seed", seed),
            outputs=None if outputs is None else names(outputs),
        )
        answer: Fitted = self._compute("calibration", request | options, progress=progress)
        return answer

    def sweep(
        self,
        kind: Swept,
        base: documents.BaseRequest,
        axes: Mapping[str, Values] | Sequence[Axis],
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
        axes : mapping or sequence of dict
            Path of a number in the base -> its values: an array, (start, stop, num), or a
            dictionary with start, stop and step; they may descend. Or a list of dictionaries with
            their path, as over HTTP. The axes are the first dimensions of the results, in this
            order.
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
            "axes": grids.axes(axes),
        }
        if outputs is not None:
            request["outputs"] = names(outputs)
        if continued:
            request["continue"] = True
        answer: Grid = self._compute("sweep", request, progress=progress)
        return answer
