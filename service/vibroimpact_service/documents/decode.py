"""Documents to the solvers' systems and problems.

Each kind has a function of its name, which takes a request and its system and returns the
problem. The sizes in the documents were compared with the limits before.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final
from weakref import WeakValueDictionary

import numpy as np

from vibroimpact_schema import laws, motions, requests, slow_flows, systems
from vibroimpact_service.documents import (
    damped,
    derivative_paths,
    digest,
    initial_states,
    loads,
    series,
)
from vibroimpact_service.documents.grid_values import frequencies, grid_values, to_fundamental
from vibroimpact_service.kinds import Kind
from vibroimpact_solvers import attractors as settled
from vibroimpact_solvers import ensemble as ensembles
from vibroimpact_solvers import existence_bands as bands
from vibroimpact_solvers import impact_modes as modes
from vibroimpact_solvers import natural_frequencies as natural
from vibroimpact_solvers import periodic_motions as driven
from vibroimpact_solvers import presets
from vibroimpact_solvers import resonances as held
from vibroimpact_solvers import slow_flow as flows
from vibroimpact_solvers import time_history as histories
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.derivatives import Parameter
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.laws import Hertz, Law, Linear, Power, Rigid
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System, Units
from vibroimpact_solvers.spectrum import Cache, held_bytes


def system(document: systems.AnySystem) -> System:
    """Return the system of a document.

    Raises
    ------
    ModelError
        With the pointer inside the document.
    """
    # Matrices, which are long, are written once for both names.
    bare = document.model_copy(update={"constraints": [], series.FIELD: None})
    structure = digest.content(digest.canonical(bare))
    limiters = [each.model_dump(exclude_none=True) for each in document.constraints]
    beside = digest.dumps([limiters, document.residual_flexibility])
    name = f"{structure} {digest.content(beside)}".encode()
    try:
        return KNOWN.get(name, lambda: _Known(_limited(document, structure))).system
    except OverflowError:
        message = "its numbers are too large for double precision"
        raise ModelError((), message, code="overflow") from None


def constraints(document: systems.AnySystem) -> list[Constraint]:
    """Return the limiters of a system's document."""
    return [constraint(i, c) for i, c in enumerate(document.constraints)]


@dataclass(frozen=True, eq=False, slots=True)
class _Known:
    """A system that is kept with all that was prepared for it."""

    system: System

    @property
    def nbytes(self) -> int:
        """Memory held now: histories prepare more where other contacts occur."""
        if self.system.n <= _SMALL:
            return _SMALL_BYTES
        return held_bytes(self.system, *histories.prepared(self.system))


_SMALL: Final = 64  # degrees of freedom up to which counting would take longer than decoding
_SMALL_BYTES: Final = 2**20
KNOWN: Final = Cache(2**28, most=8)
"""Systems of recent requests, the checks of which and what was prepared for them are paid once."""


_STRUCTURES: Final = WeakValueDictionary[str, System]()
"""By their documents without limiters, the latest of each structure that is kept in `KNOWN`."""


def _limited(document: systems.AnySystem, structure: str) -> System:
    """Return the system of a document, on the body of a known one that has other limiters.

    Modes and contacts are then those of the known one. `structure` names it without limiters.
    """
    known = _STRUCTURES.get(structure)
    of = _whole(document) if known is None else known.limited(constraints(document))
    _STRUCTURES[structure] = of
    rows = document.residual_flexibility
    return of if rows is None else series.in_series(rows, of)


def _whole(document: systems.AnySystem) -> System:
    """Return the system of a document with its damping and its base."""
    of = _decoded(document)
    if document.damping is not None or document.dashpots:
        of = damped.damped(document, of)
    return of if document.influence is None else of.on_base(np.array(document.influence))


def _decoded(document: systems.AnySystem) -> System:
    limiters = constraints(document)
    units = None
    if document.units is not None:
        units = Units(**document.units.model_dump())
    if isinstance(document, systems.MatrixSystem):
        return System(
            _matrix("M", document.M),
            _matrix("K", document.K),
            tuple(limiters),
            C=None if document.C is None else _matrix("C", document.C),
            force=None if document.force is None else np.array(document.force),
            units=units,
        )
    parameters = document.model_dump(exclude={"preset", *systems.Preset.model_fields})
    preset: Callable[..., System] = getattr(presets, document.preset)
    return preset(constraints=limiters, units=units, **parameters)


def _matrix(name: str, document: Any) -> SymmetricMatrix:
    try:
        match document:
            case systems.DiagonalMatrix():
                return SymmetricMatrix.diagonal(document.diagonal)
            case systems.BandedMatrix():
                return _banded(document)
            case systems.CoordinateMatrix():
                return SymmetricMatrix.sparse(
                    document.shape, document.row, document.col, document.data
                )
            case systems.ScalarMatrix():
                return SymmetricMatrix.diagonal(np.full(document.n, document.scalar))
            case _:
                return SymmetricMatrix.dense(document)
    except ModelError as error:
        raise error.under(name) from None


def _banded(document: systems.BandedMatrix) -> SymmetricMatrix:
    try:
        return SymmetricMatrix.bands({int(k): np.array(v) for k, v in document.bands.items()})
    except ModelError as error:
        raise error.under("bands") from None


def constraint(index: int, document: systems.Constraint) -> Constraint:
    """Return the limiter of a document at its place among those of a system."""
    gap = document.gap
    lower, upper = (gap.lower, gap.upper) if isinstance(gap, systems.Limits) else (gap, gap)
    if (direction := document.direction) is None:
        assert document.dof is not None
        dofs, weights = [document.dof], [1.0]
    else:
        dofs, weights = direction.dofs, direction.weights
    try:
        law = Rigid() if document.law is None else _law(document.law)
        wall = () if document.wall is None else loads.wall(document.wall)
        rest = document.restitution, law, wall
        return Constraint(tuple(dofs), tuple(weights), lower, upper, *rest)
    except ModelError as error:
        raise error.under("constraints", index) from None


def _law(document: laws.Law) -> Law:
    """Return the law of a stop."""
    try:
        match document:
            case laws.RigidLaw():
                return Rigid(document.restitution)
            case laws.LinearLaw():
                return Linear(document.stiffness, document.damping, document.restitution)
            case laws.HertzLaw():
                return Hertz(document.stiffness)
            case laws.PowerLaw():
                return Power(document.stiffness, document.exponent)
    except ModelError as error:
        raise error.under("law") from None


def problem(
    kind: Kind,
    request: Any,
    of: System,
    meter: Callable[[], None] | None = None,
    start: Any = None,
) -> Any:
    """Return the problem of a request of a kind, for its solver.

    Parameters
    ----------
    kind, request, of
        The system is that of the request.
    meter : callable, optional
        Called while checks go on that may take long; may raise to end them.
    start : optional
        What motions start from in place of the initial state of the request, as the `start` of
        `vibroimpact_solvers.sweep.kinds.Continued` returns it.

    Raises
    ------
    ModelError
        With the pointer inside the request.
    """
    options: dict[str, Any] = {} if start is None else {"start": start}
    if isinstance(request, _OF_MANY_STATES):
        options["meter"] = meter
    return globals()[kind.identifier](request, of, **options)


_OF_MANY_STATES: Final = (requests.AttractorsRequest, requests.EnsembleRequest)


def natural_frequencies(request: requests.NaturalFrequenciesRequest, of: System) -> natural.Problem:
    """Return the problem of natural frequencies."""
    stop = request.stop
    if stop is not None:
        stop *= to_fundamental(request.unit, of.units, ("unit",))
    directions = request.directions
    return natural.Problem(
        of,
        request.count,
        stop,
        tuple(request.fixed),
        None if directions is None else _rows(directions, ("directions",)),
        frozenset(request.outputs),
        request.tolerance,
        _parameters(request, of),
    )


def _parameters(request: Any, of: System) -> tuple[Parameter, ...]:
    """Return the parameters by which an answer is differentiated."""
    return () if request.derivatives is None else derivative_paths.parameters(request, of)


def impact_modes(request: requests.ImpactModesRequest, of: System) -> modes.Problem:
    """Return the problem of impact modes."""
    Omega, omega = frequencies(request.frequency, of.units)
    return modes.Problem(
        of,
        omega,
        tuple(request.active or ()),
        frozenset(request.outputs),
        _indices(request.dofs),
        None if request.tau is None else np.array(request.tau),
        request.tolerance,
        # The one that was given: the other is rounded.
        Omega=None if request.frequency.unit == "omega" else Omega,
        parameters=_parameters(request, of),
    )


def existence_bands(request: requests.ExistenceBandsRequest, of: System) -> bands.Problem:
    """Return the problem of existence bands."""
    grid = request.frequency
    factor = to_fundamental(grid.unit, of.units)
    return bands.Problem(
        of, grid.start * factor, grid.stop * factor, tuple(request.active or ()),
        frozenset(request.outputs), request.tolerance, request.resolution,
    )  # fmt: skip


def resonances(request: requests.ResonancesRequest, of: System) -> held.Problem:
    """Return the problem of internal resonances."""
    return held.Problem(
        of, request.constraint, request.odd_max, frozenset(request.outputs), request.tolerance
    )


def periodic_motions(request: requests.PeriodicMotionsRequest, of: System) -> driven.Problem:
    """Return the problem of periodic motions."""
    Omega, _ = frequencies(request.frequency, of.units)
    sequence = request.sequence
    return driven.Problem(
        of,
        Omega,
        tuple(loads.force(term, place, of) for place, term in enumerate(request.load)),
        request.periods,
        sequence
        if isinstance(sequence, str)
        else tuple(driven.Impact(i.constraint, 1 if i.side == "upper" else -1) for i in sequence),
        request.constraint,
        None if request.start is None else _rows(request.start.phases, ("start", "phases")),
        frozenset(request.outputs),
        _indices(request.dofs),
        None if request.tau is None else np.array(request.tau),
        request.tolerance,
    )


def attractors(
    request: requests.AttractorsRequest,
    of: System,
    meter: Callable[[], None] | None = None,
    start: tuple[Floats, Floats] | None = None,
) -> settled.Problem:
    """Return the problem of attractors."""
    Omega, _ = frequencies(request.frequency, of.units)
    x, v = initial_states.many(request.initial, of, meter) if start is None else start
    return settled.Problem(
        of,
        Omega,
        x,
        v,
        tuple(loads.force(term, place, of) for place, term in enumerate(request.load)),
        request.settle,
        request.observe,
        request.longest,
        request.section,
        request.points,
        frozenset(request.outputs),
        _indices(request.dofs),
        request.tolerance,
        meter,
    )


def _rows(rows: Sequence[Sequence[float]], where: tuple[str, ...]) -> Floats:
    """Return rows of equal length as an array."""
    if any(len(row) != len(rows[0]) for row in rows):
        raise ModelError(where, "all rows need as many numbers", code="wrong_length")
    return np.array(rows, dtype=np.float64)


def time_history(
    request: requests.TimeHistoryRequest, of: System, start: histories.State | None = None
) -> histories.Problem:
    """Return the problem of a time history."""
    initial = initial_states.one(request.initial, of) if start is None else start
    with loads.as_sent(request, of):
        return histories.Problem(
            of,
            initial,
            digits=request.digits,
            parameters=_parameters(request, of),
            **_motion(request, of),
        )


def ensemble(
    request: requests.EnsembleRequest, of: System, meter: Callable[[], None] | None = None
) -> ensembles.Problem:
    """Return the problem of an ensemble."""
    x, v = initial_states.many(request.initial, of, meter)
    with loads.as_sent(request, of):
        return ensembles.Problem(of, x, v, **_motion(request, of), report=meter)


def _motion(request: requests.MotionRequest, of: System) -> dict[str, Any]:
    """Return what motions have in common, whatever they start from."""
    limiter = None
    if isinstance(request.limiter, motions.PowerLimiter):
        given = request.limiter
        limiter = histories.Power(given.exponent, given.stiffness, given.scale)
    return {
        "t_end": request.t_end,
        "t": None if request.t is None else grid_values(request.t, request.t_end),
        "dofs": _indices(request.dofs),
        "outputs": frozenset(request.outputs),
        "tolerance": request.tolerance,
        "load": tuple(
            load
            for place, term in enumerate(request.load or ())
            for load in loads.decoded(term, place, of)
        ),
        "limiter": limiter,
        "method": request.method,
    }


def slow_flow(request: slow_flows.SlowFlowRequest, of: System) -> flows.Problem:
    """Return the problem of a slow flow."""
    return flows.Problem(
        of,
        request.model,
        request.variant,
        flows.Initial(**request.initial.model_dump()),
        grid_values(request.t),
        frozenset(request.outputs),
        request.tolerance,
    )


def _indices(given: Sequence[int] | None) -> np.ndarray[Any, np.dtype[np.int64]] | None:
    return None if given is None else np.array(given, dtype=np.int64)
