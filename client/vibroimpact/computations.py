"""The kinds of computation as methods: of both clients, and of the builder of requests."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from numbers import Integral
from typing import TYPE_CHECKING, Any, Final, Generic, Literal, TypeVar, overload

from vibroimpact import arguments
from vibroimpact.systems import axis, frequencies, has_stiff_stops, names, times

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from vibroimpact import documents
    from vibroimpact.systems import Document

    Values = ArrayLike | Mapping[str, object]
    """An array, (start, stop, num), or a document with start, stop and num or step."""
    Swept = Literal[
        "natural-frequencies",
        "impact-modes",
        "existence-bands",
        "resonances",
        "periodic-motions",
        "time-history",
        "slow-flow",
    ]
    Load = (
        documents.HarmonicLoad
        | documents.SampledLoad
        | documents.BaseMotion
        | documents.HarmonicBase
    )
    Initial = documents.InitialState | documents.InitialMode | float | tuple[ArrayLike, ArrayLike]
    Limiter = documents.PowerLimiter | documents.RigidLimiter

Natural = TypeVar("Natural")
Modes = TypeVar("Modes")
Bands = TypeVar("Bands")
Resonant = TypeVar("Resonant")
Motions = TypeVar("Motions")
Curves = TypeVar("Curves")
Settled = TypeVar("Settled")
History = TypeVar("History")
Many = TypeVar("Many")
Slow = TypeVar("Slow")
Grid = TypeVar("Grid")


class Computations(
    ABC,
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

    @abstractmethod
    def _compute(self, kind: str, request: Mapping[str, Any], *, progress: bool = False) -> Any:
        """Return the answer to a request."""

    def natural_frequencies(
        self,
        system: documents.System,
        count: int | None = None,
        *,
        stop: float | None = None,
        unit: str = "Omega",
        fixed: Sequence[int] = (),
        directions: ArrayLike | None = None,
        outputs: Sequence[str] | None = None,
        tolerance: float | None = None,
        derivatives: Sequence[str] | None = None,
    ) -> Natural:
        """Compute the natural frequencies and mode shapes of a structure, without damping.

        ``result.in_unit(result.Omega, "Hz")`` returns the frequencies in Hz; printed, the result
        is a table of them.

        Parameters
        ----------
        system : dict
            The structure, from `system`, `chain` or another function of `vibroimpact.systems`.
        count : int, optional
            Number of modes, from the lowest; default: 10, or all up to `stop`.
        stop : float, optional
            Instead of `count`: the frequency up to which all modes are returned.
        unit : str
            Unit of `stop`: Omega (angular), Hz or rpm.
        fixed : sequence of int
            Indices of the constraints whose coordinates are held at zero.
        directions : array, shape (direction, dof), optional
            Displacements of all degrees of freedom by unit motions of the base, for effective
            masses.
        outputs : sequence of str, optional
            Quantities to compute: Omega, shape, participation, effective_mass,
            residual_flexibility; default: the first three, and effective masses where
            `directions` are given.
        tolerance : float, optional
            Relative error of the frequencies; the result tells which meet it.
        derivatives : sequence of str, optional
            Paths of numbers by which the outputs are differentiated, such as
            ``"system.K.scale"``; ``result.derivative("Omega", "K.scale")`` returns one.
        """
        if outputs is None and directions is not None:
            outputs = ("Omega", "shape", "participation", "effective_mass")
        options = _present(
            count=_integer("count", count),
            stop=_number("stop", stop),
            unit=None if unit == "Omega" else unit,
            fixed=_indices("fixed", fixed) or None,
            directions=None if directions is None else arguments.rows("directions", directions),
            outputs=None if outputs is None else names(outputs),
            tolerance=_number("tolerance", tolerance),
            derivatives=None if derivatives is None else names(derivatives),
        )
        request: Document = {"system": dict(system)}
        answer: Natural = self._compute("natural-frequencies", request | options)
        return answer

    def impact_modes(
        self,
        system: documents.System,
        frequency: Values,
        *,
        unit: str = "Omega",
        outputs: Sequence[str] = ("impulse", "exists", "reason"),
        active: Sequence[int] | None = None,
        dofs: Sequence[int] | None = None,
        tau: ArrayLike | None = None,
        derivatives: Sequence[str] | None = None,
    ) -> Modes:
        """Compute impact modes, eq. 10.49-10.59 and 10.87-10.89.

        Parameters
        ----------
        system : dict
            The structure, from `system`, `chain` or another function of `vibroimpact.systems`.
        frequency : array, (start, stop, num) or dict
            Fundamental angular frequencies Omega; frequencies omega of the triangle wave with
            ``unit="omega"``, Omega/(2 pi) in Hz or per minute with ``unit="Hz"`` or ``"rpm"``.
        outputs : sequence of str
            Quantities to compute: impulse, exists, reason, shape, waveform, energy, stability,
            harmonics.
        active : sequence of int, optional
            Indices of the constraints that are struck; default: all.
        dofs : sequence of int, optional
            Degrees of freedom of shape and waveform; default: all.
        tau : array, optional
            Triangle-wave times of the waveform.
        derivatives : sequence of str, optional
            Paths of numbers by which the outputs are differentiated, such as
            ``"system.constraints.0.gap"``, ``"system.K.scale"`` or ``"frequency"``;
            ``result.derivative("momentum", "gap")`` returns one.
        """
        request = {
            "system": dict(system),
            "frequency": frequencies(frequency, unit),
            "outputs": names(outputs),
        }
        options = _present(
            active=_indices("active", active),
            dofs=_indices("dofs", dofs),
            tau=_values("tau", tau),
            derivatives=None if derivatives is None else names(derivatives),
        )
        answer: Modes = self._compute("impact-modes", request | options)
        return answer

    def existence_bands(
        self,
        system: documents.System,
        start: float | tuple[float, float],
        stop: float | None = None,
        *,
        unit: str = "Omega",
        outputs: Sequence[str] = ("bands", "rejected"),
        active: Sequence[int] | None = None,
        tolerance: float | None = None,
        resolution: float | None = None,
    ) -> Bands:
        """Find the frequency bands in which impact modes are admissible.

        Parameters
        ----------
        system : dict
            The structure, from `system`, `chain` or another function of `vibroimpact.systems`.
        start, stop : float
            Ends of the frequency range, also as one pair: Omega, or omega, Hz or rpm by `unit`.
        outputs : sequence of str
            Tables to compute: bands, rejected, stability.
        active : sequence of int, optional
            Indices of the constraints that are struck; default: all.
        tolerance : float, optional
            Relative width to which band edges are located.
        resolution : float, optional
            Width, relative to that of the range, from which on all bands and gaps are found:
            narrower ones only by chance, and ``result.error.complete`` is false. Finite-element
            models have so many narrow bands that all of them take long.
        """
        ends = (start, stop) if stop is not None else start
        given = arguments.numbers("the range", ends)
        if len(given) != 2:
            raise TypeError("a range has two ends: start and stop, or one pair of them")
        low, high = given
        request = {
            "system": dict(system),
            "frequency": {"start": low, "stop": high, "unit": unit},
            "outputs": names(outputs),
        }
        options = _present(
            active=_indices("active", active),
            tolerance=_number("tolerance", tolerance),
            resolution=_number("resolution", resolution),
        )
        answer: Bands = self._compute("existence-bands", request | options)
        return answer

    def resonances(
        self, system: documents.System, constraint: int = 0, odd_max: int = 9
    ) -> Resonant:
        """Find the internal resonances of a structure, eq. 10.70-10.76.

        These are the natural frequencies of the structure with the constrained coordinate held
        fixed, divided by odd numbers.

        Parameters
        ----------
        system : dict
            The structure, from `system`, `chain` or another function of `vibroimpact.systems`.
        constraint : int
            Index of the constraint whose coordinate is held fixed.
        odd_max : int
            Highest odd harmonic.
        """
        numbers = {
            "constraint": arguments.integer("constraint", constraint),
            "odd_max": arguments.integer("odd_max", odd_max),
        }
        answer: Resonant = self._compute("resonances", {"system": dict(system)} | numbers)
        return answer

    def periodic_motions(
        self,
        system: documents.System,
        frequency: Values,
        load: Sequence[documents.DriveTerm] = (),
        *,
        unit: str = "Omega",
        sequence: str | Sequence[tuple[int, str]] | None = None,
        constraint: int = 0,
        periods: int = 1,
        phases: ArrayLike | None = None,
        outputs: Sequence[str] | None = None,
        dofs: Sequence[int] | None = None,
        tau: ArrayLike | None = None,
        tolerance: float | None = None,
    ) -> Motions:
        """Find the periodic motions of a driven, damped structure that hits its limiters.

        Parameters
        ----------
        system : dict
            The structure, from `system`, `chain` or another function of `vibroimpact.systems`.
        frequency : array, (start, stop, num) or dict
            Frequencies Omega of the drive, or in Hz or rpm with ``unit="Hz"`` or ``unit="rpm"``.
        load : sequence of dict
            Terms of the drive, from `drive`; empty: free motions of a structure without losses.
        sequence : "symmetric" or sequence of (int, str), optional
            Impacts of one period as (constraint, "upper" or "lower"), or one at each wall of a
            constraint half a period apart; default: one at the upper wall of constraint 0.
        constraint : int
            The one that a symmetric motion strikes.
        periods : int
            Periods of the drive in one period of the motion.
        phases : array, shape (guess, impact), optional
            Phases Omega t of the impacts with which the search for several impacts per period
            begins; one and symmetric impacts need none.
        outputs : sequence of str, optional
            Quantities to compute: exists, extremes, energy, stability, multipliers, waveform;
            default: all, the waveform where `tau` is given.
        dofs : sequence of int, optional
            Degrees of freedom of extremes and waveform; default: all.
        tau : array, optional
            Times t/T of the waveform, from the drive's phase 0.
        tolerance : float, optional
            Relative error of the impulses; the result tells which solutions meet it.
        """
        request = {
            "system": dict(system),
            "frequency": frequencies(frequency, unit),
            "load": arguments.documents("load", load),
        }
        options = _present(
            sequence=sequence
            if sequence is None or isinstance(sequence, str)
            else [
                {"constraint": arguments.integer("constraint", index), "side": side}
                for index, side in sequence
            ],
            constraint=arguments.integer("constraint", constraint) or None,
            periods=None if periods == 1 else arguments.integer("periods", periods),
            start=None if phases is None else {"phases": arguments.rows("phases", phases)},
            outputs=None if outputs is None else names(outputs),
            dofs=_indices("dofs", dofs),
            tau=_values("tau", tau),
            tolerance=_number("tolerance", tolerance),
        )
        answer: Motions = self._compute("periodic-motions", request | options)
        return answer

    def branches(
        self,
        base: documents.PeriodicMotionsRequest,
        path: str,
        start: float,
        stop: float,
        *,
        switch: int = 0,
        stop_at: Sequence[str] = (),
        points: int | None = None,
        step: float | None = None,
        progress: bool = False,
    ) -> Curves:
        """Follow branches of periodic motions over a range of one number of their request.

        Parameters
        ----------
        base : dict
            A request for periodic motions at one frequency, from `periodic_motions_request`.
        path : str
            The number that varies, such as "frequency.values.0" or "system.constraints.0.gap".
        start, stop : float
            Ends of the range.
        switch : int
            How many branches to follow that begin at flips and losses of symmetry.
        stop_at : sequence of str
            Special points at which a branch ends: fold, flip, torus, symmetry, grazing, end.
        points : int, optional
            Most points of a branch.
        step : float, optional
            Longest step: part of the range, change of a phase (rad) or relative one of an impulse.
        progress : bool
            Show a progress bar while a job runs.
        """
        request: Document = {
            "base": dict(base),
            "path": path,
            "start": arguments.number("start", start),
            "stop": arguments.number("stop", stop),
        }
        options = _present(
            switch=arguments.integer("switch", switch) or None,
            stop_at=names(stop_at) or None,
            points=_integer("points", points),
            step=_number("step", step),
        )
        answer: Curves = self._compute("branches", request | options, progress=progress)
        return answer

    def attractors(
        self,
        system: documents.System,
        frequency: float | Mapping[str, Any],
        load: Sequence[documents.DriveTerm],
        x: ArrayLike,
        v: ArrayLike,
        *,
        settle: int | None = None,
        observe: int | None = None,
        longest: int | None = None,
        section: str = "phase",
        points: int | None = None,
        dofs: Sequence[int] | None = None,
        outputs: Sequence[str] | None = None,
        tolerance: float | None = None,
        progress: bool = False,
    ) -> Settled:
        """Find what the motions of a driven structure with stops settle on, and how many do.

        Parameters
        ----------
        system : dict
            The structure, with damping or losses at its stops.
        frequency : float or dict
            Frequency of the drive.
        load : sequence of dict
            The drive, from `drive`.
        x, v : array, shape (motion, dof)
            Displacements and velocities at t = 0, the drive's phase 0.
        settle, observe : int, optional
            Periods of the drive that are left out, and those looked at after them; default: 200
            and 400.
        longest : int, optional
            Largest period, in periods of the drive, that is recognised; default: 16.
        section : str
            Points of the section: "phase", the states at the drive's phase 0, or "impacts".
        points : int, optional
            Most points of the section of each attractor; default: 200.
        dofs : sequence of int, optional
            Degrees of freedom of states and sections; default: all.
        outputs : sequence of str, optional
            section, stability; default: both.
        tolerance : float, optional
            Distance of equal states relative to the amplitude; default: 1e-6.
        progress : bool
            Show a progress bar while a job runs.
        """
        request: Document = {
            "system": dict(system),
            "load": arguments.documents("load", load),
            "frequency": dict(frequency)
            if isinstance(frequency, Mapping)
            else {"values": [arguments.number("frequency", frequency)]},
            "initial": {name: arguments.rows(name, given) for name, given in (("x", x), ("v", v))},
        }
        options = _present(
            settle=_integer("settle", settle),
            observe=_integer("observe", observe),
            longest=_integer("longest", longest),
            section=None if section == "phase" else section,
            points=_integer("points", points),
            dofs=_indices("dofs", dofs),
            outputs=None if outputs is None else names(outputs),
            tolerance=_number("tolerance", tolerance),
        )
        answer: Settled = self._compute("attractors", request | options, progress=progress)
        return answer

    def time_history(
        self,
        system: documents.System,
        initial: Initial,
        t_end: float,
        *,
        t: Values | None = None,
        outputs: Sequence[str] | None = None,
        dofs: Sequence[int] | None = None,
        load: Sequence[Load] | None = None,
        limiter: Limiter | None = None,
        method: str = "exact",
        tolerance: float | None = None,
        digits: int | None = None,
    ) -> History:
        """Compute the motion from an initial state, with its impacts.

        Parameters
        ----------
        system : dict
            The structure, from `system`, `chain` or another function of `vibroimpact.systems`.
        initial : (x, v) or float or dict
            Displacements and velocities at t = 0; or the frequency Omega of an impact mode, on
            which the motion starts; or the document itself.
        t_end : float
            Duration of the motion.
        t : int, array, (start, stop, num) or dict, optional
            Output times, or the number of equally spaced ones from 0 to `t_end`.
        outputs : sequence of str, optional
            Quantities to compute: x, v, impacts, energy, contacts, force; default: contacts and
            impacts and, where `t` is given, x, v and energy; of stops with a stiffness, whose
            contacts are no impacts, contacts and their force.
        dofs : sequence of int, optional
            Degrees of freedom of x and v; default: all.
        load : sequence of dict, optional
            Loads, from `harmonic`, `sampled`, `base_motion` and `base_vibration`.
        limiter : dict, optional
            The force law of soft limiters, from `soft`; default: the laws of the constraints.
        method : str
            "exact", or an integrator of scipy for comparison: RK45, DOP853, Radau, LSODA, …
        tolerance : float, optional
            Required accuracy, relative to the size of the motion; the result states until when
            double precision can meet it.
        digits : int, optional
            Decimal digits to compute with where double precision cannot meet the tolerance.
        """
        if outputs is None:
            outputs = () if t is None else ("x", "v", "energy")
            if has_stiff_stops(system):
                outputs = (*outputs, "contacts", *(() if t is None else ("force",)))
            else:
                outputs = (*outputs, "impacts", "contacts")
        request = {
            "system": dict(system),
            "initial": _initial(initial),
            "t_end": arguments.number("t_end", t_end),
            "outputs": names(outputs),
        }
        options = _present(
            t=_times(t),
            dofs=_indices("dofs", dofs),
            load=None if load is None else arguments.documents("load", load),
            limiter=None if limiter is None else dict(limiter),
            method=None if method == "exact" else method,
            tolerance=_number("tolerance", tolerance),
            digits=_integer("digits", digits),
        )
        answer: History = self._compute("time-history", request | options)
        return answer

    def ensemble(
        self,
        system: documents.System,
        x: ArrayLike,
        v: ArrayLike,
        t_end: float,
        *,
        t: Values | None = None,
        outputs: Sequence[str] | None = None,
        dofs: Sequence[int] | None = None,
        load: Sequence[Load] | None = None,
        limiter: Limiter | None = None,
        method: str = "exact",
        tolerance: float | None = None,
    ) -> Many:
        """Compute the motions from many initial states.

        `Result.each` returns the impacts of every member, ``result.plot()`` draws the basins.

        Parameters
        ----------
        system : dict
            The structure, from `system`, `chain` or another function of `vibroimpact.systems`.
        x, v : array, shape (member, dof)
            Displacements and velocities at t = 0.
        t_end : float
            Duration of the motions.
        t, outputs, dofs, load, limiter, method, tolerance
            As for `time_history`; they hold for all members.
        """
        states: Any = {name: arguments.rows(name, given) for name, given in (("x", x), ("v", v))}
        request = REQUESTS.time_history(
            system,
            states,
            t_end,
            t=t,
            outputs=outputs,
            dofs=dofs,
            load=load,
            limiter=limiter,
            method=method,
            tolerance=tolerance,
        )
        answer: Many = self._compute("ensemble", request)
        return answer

    def slow_flow(
        self,
        system: documents.System,
        model: str,
        variant: str,
        initial: documents.SlowFlowInitial | Mapping[str, float],
        t: Values,
        *,
        outputs: Sequence[str] = ("state", "x", "v", "error"),
    ) -> Slow:
        """Compute a motion with slowly varying impacts, and the error of the description used.

        Parameters
        ----------
        system : dict
            The system of the model, from `oscillator`, `two_mass` or `bouncing_ball`.
        model : str
            ``damped`` (eq. 10.13-10.21), ``two_oscillator`` (10.41-10.46), ``restitution``
            (10.90-10.123), ``bouncing_ball`` (10.124-10.149) or ``oscillator`` (10.1-10.12).
        variant : str
            Description of the motion, such as ``exact``, ``averaged`` or ``corrected``.
        initial : mapping
            Initial conditions, such as ``{"gamma": 0.2}`` or ``{"omega": 5}``.
        t : array, (start, stop, num) or dict
            Output times.
        outputs : sequence of str
            Quantities to compute: state, x, v, impulse, error.
        """
        given: Mapping[str, Any] = initial
        request = {
            "system": dict(system),
            "model": model,
            "variant": variant,
            "initial": {
                name: value if name == "root" else arguments.number(name, value)
                for name, value in given.items()
            },
            "t": times(t, "t"),
            "outputs": names(outputs),
        }
        answer: Slow = self._compute("slow-flow", request)
        return answer

    def sweep(
        self,
        kind: Swept,
        base: documents.BaseRequest,
        axes: Mapping[str, Values],
        outputs: Sequence[str] | None = None,
        *,
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
            dictionary with start, stop and step. The axes are the first dimensions of the
            results, in this order.
        outputs : sequence of str, optional
            Quantities to compute; default: the outputs of the base.
        progress : bool
            Show a progress bar while a job runs.
        """
        request: Document = {
            "kind": kind,
            "base": dict(base),
            "axes": [axis(path, values) for path, values in axes.items()],
        }
        if outputs is not None:
            request["outputs"] = names(outputs)
        answer: Grid = self._compute("sweep", request, progress=progress)
        return answer


class _Requests(
    Computations[
        "documents.NaturalFrequenciesRequest",
        "documents.ImpactModesRequest",
        "documents.ExistenceBandsRequest",
        "documents.ResonancesRequest",
        "documents.PeriodicMotionsRequest",
        "documents.BranchesRequest",
        "documents.AttractorsRequest",
        "documents.TimeHistoryRequest",
        "documents.EnsembleRequest",
        "documents.SlowFlowRequest",
        "documents.SweepRequest",
    ]
):
    def _compute(self, kind: str, request: Mapping[str, Any], *, progress: bool = False) -> Any:
        return dict(request)


REQUESTS: Final = _Requests()
"""Its methods return the request documents that the same methods of the clients send."""


def _present(**fields: Any) -> Document:
    """Return the fields that have a value; those without one keep the service's default."""
    return {name: value for name, value in fields.items() if value is not None}


def _indices(name: str, given: Iterable[int] | None) -> list[int] | None:
    return None if given is None else arguments.integers(name, given)


def _number(name: str, given: float | None) -> float | None:
    return None if given is None else arguments.number(name, given)


def _integer(name: str, given: int | None) -> int | None:
    return None if given is None else arguments.integer(name, given)


def _values(name: str, given: ArrayLike | None) -> list[float] | None:
    return None if given is None else arguments.numbers(name, given)


def _times(given: Any) -> Any:
    """Return the output times of a motion: a number of them, a list, or a grid."""
    if given is None or isinstance(given, Integral):
        return None if given is None else {"num": int(given)}
    document = times(given, "t")
    return document["values"] if set(document) == {"values"} else document


def _initial(initial: Initial) -> Document:
    """Return the initial state: a document, the frequency of an impact mode, or (x, v)."""
    if isinstance(initial, Mapping):
        return dict(initial)
    if isinstance(initial, int | float):
        return {"impact_mode": {"Omega": float(initial)}}
    if isinstance(initial, str | bytes) or not hasattr(initial, "__len__") or len(initial) != 2:
        raise TypeError(
            "initial must be (x, v), a document, or the frequency of an impact mode, not "
            f"{initial!r:.60}"
        )
    x, v = initial
    return {"x": _values("x", x), "v": _values("v", v)}
