"""The problem: numbers of a computation that are unknown, and measurements of its outputs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.calibration.kinds import TIMES, BaseKind, named
from vibroimpact_solvers.checks import check_outputs
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import System

KIND: Final = "calibration"
OUTPUTS: Final = (
    "value", "covariance", "interval", "undetermined", "residual", "chi2", "model_fits"
)  # fmt: skip


class Prior(NamedTuple):
    """What is known of an unknown beforehand: a normal distribution."""

    mean: float
    sigma: float


@dataclass(frozen=True, slots=True)
class Unknown:
    """An unknown number of the base.

    Parameters
    ----------
    path : str
        Its name in results: the path in the request.
    start : float
        Where the first search begins.
    lower, upper : float
        Bounds; infinite where there is none.
    prior : Prior, optional
    unit : str
        As of a `vibroimpact_solvers.arrays.Quantity`.
    """

    path: str
    start: float
    lower: float = -math.inf
    upper: float = math.inf
    prior: Prior | None = None
    unit: str = "1"

    @property
    def scale(self) -> float:
        """The size of the unknown, by which steps and directions are measured."""
        if self.start != 0.0:
            return abs(self.start)
        widths = [abs(end) for end in (self.lower, self.upper) if math.isfinite(end)]
        if self.prior is not None:
            widths.append(self.prior.sigma)
        return max(widths, default=0.0) or 1.0

    def check(self) -> None:
        """Raise `ModelError` where the numbers exclude one another."""
        numbers = [self.start, *(self.prior or ())]
        if not all(map(math.isfinite, numbers)) or math.isnan(self.lower) or math.isnan(self.upper):
            raise ModelError((), "a number is not finite", code="not_finite")
        if not self.lower < self.upper:
            message = f"the upper bound {self.upper!r} is not above the lower one, {self.lower!r}"
            raise ModelError(("upper",), message, code="out_of_range")
        if not self.lower <= self.start <= self.upper:
            message = f"{self.start!r} is not between the bounds {self.lower!r} and {self.upper!r}"
            raise ModelError(("start",), message, code="out_of_range")
        if self.prior is not None and not self.prior.sigma > 0.0:
            message = f"the standard deviation is {self.prior.sigma!r}, not positive"
            raise ModelError(("prior", "sigma"), message, code="out_of_range")


@dataclass(frozen=True, eq=False, slots=True)
class Data:
    """Measurements of one output.

    Parameters
    ----------
    output : str
        Its path, such as ``"impacts.time"``.
    values : array
        In the shape of the output; nan where nothing was measured. Of modes and impacts the first
        ones.
    sigma : float or array
        Standard deviation of the noise, one for all or one for each value.
    rows : array of int, optional
        Places of the rows on the axis of the output times; None: all of them.
    """

    output: str
    values: Floats
    sigma: Floats
    rows: np.ndarray[Any, np.dtype[np.int64]] | None = None

    def check(self) -> None:
        """Raise `ModelError` where values and deviations do not fit together."""
        if np.isinf(self.values).any():
            raise ModelError(("values",), "a value is not finite", code="not_finite")
        if not np.isfinite(self.values).any():
            raise ModelError(("values",), "nothing is measured: all are null", code="no_values")
        if self.sigma.ndim and self.sigma.shape != self.values.shape:
            message = f"its shape is {self.sigma.shape}, that of the values {self.values.shape}"
            raise ModelError(("sigma",), message, code="wrong_length")
        if not (np.isfinite(self.sigma).all() and (self.sigma > 0.0).all()):
            message = "the standard deviation of the noise must be positive"
            raise ModelError(("sigma",), message, code="out_of_range")


class Point(NamedTuple):
    """The base at some values of the unknowns."""

    problem: Any
    """Of the base's kind; with its parameters where derivatives are wanted."""
    weights: Floats
    """By what derivatives by its parameters are those by the unknowns, shape (unknown,)."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Unknown numbers of a computation, and measurements that tell them.

    Parameters
    ----------
    kind : str
        Kind of the base, one of `kinds.KINDS`.
    at : callable
        ``(x, rates) -> Point``: the base with the unknowns at x, shape (unknown,), whose outputs
        are differentiated by them where ``rates``; raises `ModelError` if there is none.
    unknowns : tuple of Unknown
    data : tuple of Data
    system : System
        The structure of the base, which has the units.
    starts : int
        Searches, the first from the starts of the unknowns.
    evaluations : int
        Most evaluations of the model in one search.
    seed : int, optional
        Of the other starts; None: made of the measurements.
    outputs : frozenset of str
        Out of `OUTPUTS`.
    """

    kind: str
    at: Callable[[Floats, bool], Point]
    unknowns: tuple[Unknown, ...]
    data: tuple[Data, ...]
    system: System
    starts: int = 8
    evaluations: int = 100
    seed: int | None = None
    outputs: frozenset[str] = frozenset(OUTPUTS)

    def __post_init__(self) -> None:
        check_outputs(self.outputs, OUTPUTS)
        seen: dict[str, int] = {}
        for place, unknown in enumerate(self.unknowns):
            try:
                unknown.check()
            except ModelError as error:
                raise error.under("unknowns", place) from None
            if seen.setdefault(unknown.path, place) != place:
                message = f"it is the same as number {seen[unknown.path]}"
                raise ModelError(("unknowns", place, "path"), message, code="duplicate_path")
        base = self.at(self.start, False).problem
        for place, data in enumerate(self.data):
            try:
                data.check()
                self.base_kind.check(data.output, data.values, data.rows, base)
            except ModelError as error:
                raise error.under("data", place) from None
        self._check_impacts()

    def _check_impacts(self) -> None:
        """Refuse two records of impacts, and columns that nothing says the impacts of."""
        lengths = {
            place: len(data.values)
            for place, data in enumerate(self.data)
            if data.output.startswith("impacts.")
        }
        timed = [place for place in lengths if self.data[place].output == TIMES]
        for place, length in lengths.items():
            if not timed:
                message = "columns of impacts need their times, impacts.time, beside them"
                raise ModelError(("data", place, "output"), message, code="missing_times")
            if length != lengths[timed[0]] or timed[1:] == [place]:
                message = "it is the record of the impacts whose times are given, as long as these"
                raise ModelError(("data", place, "values"), message, code="wrong_length")

    @property
    def base_kind(self) -> BaseKind:
        """The entry of the kind in `KINDS`."""
        return named(self.kind)

    @property
    def start(self) -> Floats:
        """Values from which the first search begins, shape (unknown,)."""
        return np.array([unknown.start for unknown in self.unknowns])

    @property
    def scale(self) -> Floats:
        """Sizes of the unknowns, shape (unknown,)."""
        return np.array([unknown.scale for unknown in self.unknowns])

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper bounds, each shape (unknown,)."""
        low = np.array([unknown.lower for unknown in self.unknowns])
        return low, np.array([unknown.upper for unknown in self.unknowns])

    @property
    def count(self) -> int:
        """Number of measurements."""
        return sum(int(np.isfinite(data.values).sum()) for data in self.data)

    @property
    def priors(self) -> int:
        """Number of priors."""
        return sum(unknown.prior is not None for unknown in self.unknowns)
