"""The kinds of computation that can be calibrated, and the outputs that can be measured.

To let a kind be calibrated, add a row to `KINDS`. Its measured outputs are those of its result
that have derivatives, or that the row names; where the problem itself has none, they are
differentiated by differences.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any, Final

import numpy as np

from vibroimpact_solvers import (
    impact_modes,
    natural_frequencies,
    periodic_motions,
    time_history,
)
from vibroimpact_solvers.arrays import Field, Floats, declared
from vibroimpact_solvers.errors import ModelError

Places = np.ndarray[Any, np.dtype[np.int64]]
IMPACT: Final = "impact"
"""The dimension whose length the computation alone tells."""
TIMES: Final = "impacts.time"


@dataclass(frozen=True, slots=True)
class BaseKind:
    """A kind of computation that can be calibrated.

    Parameters
    ----------
    solver : module
        Has ``plan``, ``solve`` and ``Result``.
    sizes : callable
        Returns the lengths of the dimensions of the outputs of a problem.
    leading : frozenset of str
        Dimensions along which only the first rows may be measured.
    signs : frozenset of str
        Outputs whose rows have a sign of their own, which measurements do not know.
    absent : mapping
        Output -> the output that it equals where it is absent.
    requested : mapping
        First part of the path of an output -> its name in requests, where that differs.
    without_derivatives : frozenset of str
        Paths of measured outputs that have no derivatives.
    chosen : callable, optional
        ``(result, computed, measured, sigma)`` -> the rows of an output that are measured, in
        their order, and how many of them cannot have been. None: the measured ones come first.
    beside : frozenset of str
        Outputs that the choice needs.
    """

    solver: ModuleType
    sizes: Callable[[Any], Mapping[str, int]]
    leading: frozenset[str] = frozenset()
    signs: frozenset[str] = frozenset()
    absent: Mapping[str, str] = field(default_factory=dict)
    requested: Mapping[str, str] = field(default_factory=dict)
    without_derivatives: frozenset[str] = frozenset()
    chosen: Callable[[Any, Floats, Floats, Floats], tuple[Places, int]] | None = None
    beside: frozenset[str] = frozenset()

    def measured(self) -> dict[str, Field]:
        """Return the outputs that can be measured, by their paths with dots."""
        fields = declared(self.solver.Result).values()
        paths = {each.path for each in fields}
        return {
            each.path.replace("/", "."): each
            for each in fields
            if each.path in self.without_derivatives
            or (f"derivative/{each.path}" in paths and each.path != "harmonics")
        }

    def rates(self, output: str) -> Field:
        """Return the field of the derivatives of an output."""
        path = f"derivative/{output.replace('.', '/')}"
        return next(each for each in declared(self.solver.Result).values() if each.path == path)

    def error(self, output: str, *, rates: bool = False) -> Field:
        """Return the field of the errors of an output or of its derivatives."""
        of = self.rates(output) if rates else self.measured()[output]
        fields = declared(self.solver.Result).values()
        return next(each for each in fields if each.path == of.quantity.error)

    def output(self, path: str) -> str:
        """Return the name of the output in requests that contains a measured one.

        Raises
        ------
        ModelError
            Where it cannot be measured.
        """
        if path not in self.measured():
            message = f"outputs that can be measured are {', '.join(self.measured())}"
            raise ModelError(("output",), message, code="unknown_output")
        first = path.partition(".")[0].removesuffix("_lower")
        return self.requested.get(first, first)

    def check(self, output: str, values: Floats, rows: Places | None, base: Any) -> None:
        """Raise `ModelError` where measurements do not have the shape of an output.

        Parameters
        ----------
        output : str
        values : array
        rows : array of int, optional
            Places of the rows on the first axis.
        base : Problem
            Of this kind.
        """
        self.output(output)
        dims = self.measured()[output].quantity.dims
        if rows is not None and dims[0] != "time":
            message = f"{output} is no history: it has no output times"
            raise ModelError(("t",), message, code="not_a_history")
        sizes = {**self.sizes(base), IMPACT: len(values) if values.ndim else 0}
        if rows is not None:
            sizes["time"] = rows.size
        dims = tuple("frequency" if dim == "solution" else dim for dim in dims)
        wanted = tuple(sizes[dim] for dim in dims)
        fits = values.ndim == len(wanted) and values.shape[1:] == wanted[1:]
        exact = dims[0] not in self.leading
        if fits and exact:
            fits = values.shape[0] == wanted[0]
        if not fits or values.shape[0] > wanted[0]:
            at_most = "" if exact else ", or of fewer rows,"
            message = (
                f"{output} has the shape {_named(dims, wanted)}{at_most} and the values have "
                f"{list(values.shape)}"
            )
            raise ModelError(("values",), message, code="wrong_length")
        if output == TIMES:
            _check_times(values, base.t_end)


def _check_times(times: Floats, t_end: float) -> None:
    """Refuse times of impacts that are no record from 0 to the end of the motion."""
    known = times[np.isfinite(times)]
    if (np.diff(known) < 0.0).any():
        raise ModelError(("values",), "times of impacts ascend", code="not_ascending")
    if known.size and not 0.0 <= known[0] <= known[-1] <= t_end:
        message = f"the record lasts from 0 to t_end = {t_end!r}: an impact lies outside"
        raise ModelError(("values",), message, code="out_of_range")


def _named(dims: tuple[str, ...], sizes: tuple[int, ...]) -> str:
    return f"[{', '.join(f'{dim} {size}' for dim, size in zip(dims, sizes, strict=True))}]"


def _of_modes(problem: natural_frequencies.Problem) -> Mapping[str, int]:
    stops = len(problem.system.constraints)
    directions = 0 if problem.directions is None else len(problem.directions)
    return {
        "mode": problem.most,
        "dof": problem.system.n,
        "constraint": stops,
        "other": stops,
        "direction": directions,
    }


def _of_impact_modes(problem: impact_modes.Problem) -> Mapping[str, int]:
    return {
        "frequency": problem.omega.size,
        "constraint": len(problem.active),
        "dof": problem.output_dofs.size,
        "tau": 0 if problem.tau is None else problem.tau.size,
    }


def _of_histories(problem: time_history.Problem) -> Mapping[str, int]:
    return {"time": problem.times.size, "dof": problem.output_dofs.size}


def _of_periodic_motions(problem: periodic_motions.Problem) -> Mapping[str, int]:
    return {"frequency": problem.Omega.size, "dof": problem.output_dofs.size}


def _nearest_motions(
    result: Any, computed: Floats, measured: Floats, sigma: Floats
) -> tuple[Places, int]:
    """Return the row of the stable, admissible motion at each frequency nearest to the record.

    Where the model has none, the nearest of the others stands for it, so that searches may pass
    such values; how many there are is returned, too.
    """
    stable = (result.solution_stability < 1.0) | result.solution_neutral
    observable = result.solution_exists & stable
    deviations = np.broadcast_to(sigma, measured.shape)
    chosen, lacking = np.zeros(len(measured), dtype=np.int64), 0
    for k, row in enumerate(measured):
        if not np.isfinite(row).any():
            continue  # whichever it is, it is not compared
        here = result.solution_frequency_index == k
        places = np.flatnonzero(observable & here)
        if not places.size:
            places, lacking = np.flatnonzero(here), lacking + 1
        off = np.where(np.isfinite(row), (computed[places] - row) / deviations[k], 0.0)
        chosen[k] = places[np.argmin((off * off).sum(axis=1))]
    return chosen, lacking


KINDS: Final[Mapping[str, BaseKind]] = {
    "natural-frequencies": BaseKind(
        natural_frequencies,
        _of_modes,
        leading=frozenset({"mode"}),
        signs=frozenset({"shape", "participation"}),
    ),
    "impact-modes": BaseKind(
        impact_modes,
        _of_impact_modes,
        absent={"impulse_lower": "impulse", "momentum_lower": "momentum"},
        requested={"momentum": "impulse"},
    ),
    "time-history": BaseKind(time_history, _of_histories, leading=frozenset({IMPACT})),
    "periodic-motions": BaseKind(
        periodic_motions,
        _of_periodic_motions,
        requested={"solution": "extremes"},
        without_derivatives=frozenset({"solution/x_max", "solution/x_min", "solution/rms"}),
        chosen=_nearest_motions,
        beside=frozenset({"exists", "stability"}),
    ),
}


def named(kind: str) -> BaseKind:
    """Return the row of a kind.

    Raises
    ------
    ModelError
        Where it cannot be calibrated.
    """
    if kind not in KINDS:
        message = f"only {', '.join(KINDS)} can be calibrated"
        raise ModelError(("kind",), message, code="unknown_choice")
    return KINDS[kind]
