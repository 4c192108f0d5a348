"""Calibrations: the unknown numbers of a request, its measurements, and the problems at a point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from vibroimpact_schema import calibrations, systems
from vibroimpact_service.documents import decode, varying
from vibroimpact_service.documents.grid_values import grid_values
from vibroimpact_service.documents.varying import Varying
from vibroimpact_service.kinds import KINDS
from vibroimpact_solvers import calibration, sweep
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import System

_HISTORIES: Final = ("x", "v", "a", "energy")
"""Outputs of time histories at the output times."""


class _Factor(NamedTuple):
    """A factor of a matrix, which is 1 in the request."""

    matrix: str

    def put(self, base: Any, value: float) -> Any:
        """Return the request with the matrix times a number."""
        matrix = getattr(base.system, self.matrix)
        return varying.replaced(base, ("system", self.matrix), _times(matrix, value))


def problem(request: calibrations.CalibrationRequest, system: System) -> calibration.Problem:
    """Return the problem of a calibration.

    Raises
    ------
    ModelError
        With a pointer to the unknown or the data that is wrong, or into the base.
    """
    root = request.root
    kind = calibration.named(root.kind)
    numbers = [_number(root.base, place, each.path) for place, each in enumerate(root.unknowns)]
    outputs = set(kind.beside)
    for place, entry in enumerate(root.data):
        try:
            outputs.add(kind.output(entry.output))
        except ModelError as error:
            raise error.under("data", place) from None
    base, data = _measured(root.base.model_copy(update={"outputs": sorted(outputs)}), root.data)
    paths = tuple(each.path for each in root.unknowns)
    at = _At(root.kind, base, paths, tuple(numbers), system)
    return calibration.Problem(
        root.kind,
        at,
        tuple(map(_unknown, root.unknowns, numbers)),
        tuple(data),
        system,
        root.starts,
        root.evaluations,
        root.seed,
        frozenset(root.outputs),
    )


def _number(base: Any, place: int, path: str) -> Varying | _Factor:
    """Return the number at the path of an unknown."""
    where = ("unknowns", place)
    try:
        match path.split("."):
            case ["system", "M" | "K" | "C" as name, "scale"]:
                return _factor(base.system, name)
        number = varying.number(base, path)
    except ModelError as error:
        raise error.under(*where) from None
    if number.whole:
        raise ModelError((*where, "path"), f"{path} is a whole number", code="not_a_number")
    return number


def _factor(system: systems.AnySystem, name: str) -> _Factor:
    if not isinstance(system, systems.MatrixSystem):
        message = "the structure is a preset, which has no matrices: vary its parameters"
        raise ModelError(("path",), message, code="unknown_path")
    if getattr(system, name) is None:
        message = f"the structure has no matrix {name}"
        raise ModelError(("path",), message, code="unknown_path")
    return _Factor(name)


def _unknown(document: calibrations.Unknown, number: Varying | _Factor) -> calibration.Unknown:
    unit = "1" if isinstance(number, _Factor) else sweep.meaning(number.path)[0]
    prior = document.prior
    return calibration.Unknown(
        document.path,
        document.start,
        -np.inf if document.lower is None else document.lower,
        np.inf if document.upper is None else document.upper,
        None if prior is None else calibration.Prior(prior.mean, prior.sigma),
        unit,
    )


@dataclass(frozen=True, slots=True)
class _At:
    """The base at values of the unknowns."""

    kind: str
    base: Any
    paths: tuple[str, ...]
    numbers: tuple[Varying | _Factor, ...]
    system: System

    def __call__(self, x: Floats, rates: bool) -> calibration.Point:
        """Return the base at a point; with its parameters where they are wanted."""
        values = x.tolist()
        try:
            changed, own = self.base, False
            # Factors multiply the other numbers, whatever the order of the unknowns is.
            for factor in (False, True):
                for number, value in zip(self.numbers, values, strict=True):
                    if isinstance(number, _Factor) == factor:
                        changed = self._put(changed, number, value)
                        own = own or _of_structure(number)
            if rates:
                changed = changed.model_copy(update={"derivatives": list(self.paths)})
            system = decode.system(changed.system) if own else self.system
            made = decode.problem(KINDS[self.kind], changed, system)
        except ModelError as error:
            raise error.under("base") from None
        return calibration.Point(made, self._weights(x))

    def _put(self, base: Any, number: Varying | _Factor, value: float) -> Any:
        if isinstance(number, Varying):
            number.fits(base, value)
        return number.put(base, value)

    def _weights(self, x: Floats) -> Floats:
        """Return by what derivatives by numbers of the changed base are those by the unknowns."""
        weights = np.ones(x.size)
        for place, number in enumerate(self.numbers):
            if not isinstance(number, _Factor):
                continue
            # The matrix of the changed base is the factor times the one of the numbers.
            weights[place] = weights[place] / x[place] if x[place] else np.nan
            for other, entry in enumerate(self.paths):
                if other != place and entry.startswith(f"system.{number.matrix}."):
                    weights[other] *= x[place]
        return weights


def _of_structure(number: Varying | _Factor) -> bool:
    return isinstance(number, _Factor) or number.path[0] == "system"


def _times(matrix: Any, factor: float) -> Any:
    """Return a matrix of a document times a number."""
    match matrix:
        case systems.DiagonalMatrix():
            return matrix.model_copy(
                update={"diagonal": [factor * each for each in matrix.diagonal]}
            )
        case systems.BandedMatrix():
            bands = {k: [factor * each for each in band] for k, band in matrix.bands.items()}
            return matrix.model_copy(update={"bands": bands})
        case systems.CoordinateMatrix():
            return matrix.model_copy(update={"data": [factor * each for each in matrix.data]})
        case systems.ScalarMatrix():
            return matrix.model_copy(update={"scalar": factor * matrix.scalar})
        case _:
            return [[factor * each for each in row] for row in matrix]


def _measured(
    base: Any, documents: Sequence[calibrations.MeasuredOutput]
) -> tuple[Any, list[calibration.Data]]:
    """Return the base with the times of all measurements, and these."""
    own = getattr(base, "t", None)
    grid = None if own is None else grid_values(own, base.t_end)
    given = [each.t for each in documents if each.t is not None]
    data, times = [], None
    if given and "t" in type(base).model_fields:
        parts = [np.array(t) for t in given]
        times = np.unique(np.concatenate(parts if grid is None else [*parts, grid]))
        base = base.model_copy(update={"t": times.tolist()})
    for place, each in enumerate(documents):
        try:
            rows = _places(each, grid, times, getattr(base, "t_end", 0.0))
            values, sigma = _array(each.values, "values"), _array(each.sigma, "sigma")
        except ModelError as error:
            raise error.under("data", place) from None
        data.append(calibration.Data(each.output, values, sigma, rows))
    return base, data


def _places(
    measured: calibrations.MeasuredOutput, grid: Floats | None, times: Floats | None, t_end: float
) -> Any:
    """Return the places of the rows of measurements among all times; None: they are all rows."""
    if measured.t is not None:
        if times is None:
            message = "the base is no history: it has no output times"
            raise ModelError(("t",), message, code="not_a_history")
        return _rows(np.array(measured.t), times, t_end)
    if measured.output not in _HISTORIES:
        return None
    if grid is None:
        message = "a history needs the times t of its values"
        raise ModelError(("t",), message, code="missing_t")
    return None if times is None else np.searchsorted(times, grid)


def _rows(t: Floats, times: Floats, t_end: float) -> Any:
    """Return the places of times among all of them."""
    if (np.diff(t) <= 0.0).any():
        raise ModelError(("t",), "the times do not ascend", code="not_ascending")
    if t[0] < 0.0 or t[-1] > t_end:
        message = f"the times are not between 0 and t_end = {t_end!r}"
        raise ModelError(("t",), message, code="out_of_range")
    return np.searchsorted(times, t)


def _array(values: Any, name: str) -> Floats:
    """Return nested lists as an array; null is nan."""
    try:
        return np.array(values, dtype=np.float64)
    except ValueError:
        message = "rows have different lengths"
        raise ModelError((name,), message, code="wrong_length") from None
