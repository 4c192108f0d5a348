"""Existence bands: certified ones against scans, and what scans miss."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Final

import numpy as np

from benchmarks import beams
from benchmarks.cases import chain, grid, random_structure, solve
from benchmarks.harness import measure
from benchmarks.tables import Goal, Plot, Table
from vibroimpact_solvers import existence_bands, spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.existence_bands import Problem, Result
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

_RANGE: Final = (0.2, 3.0)
_BEFORE: Final = {24: 13.3}
"""Seconds of the same bands by 0.2.0, for a beam of 24 degrees of freedom."""


def bands(system: System, start: float = _RANGE[0], stop: float = _RANGE[1]) -> Result:
    """Plan and solve, as the service does."""
    problem = Problem(system, start, stop, outputs=frozenset({"bands"}))
    return existence_bands.solve(problem, existence_bands.plan(problem))


def scan(system: System, points: int) -> tuple[Floats, Floats]:
    """Return the bands that a uniform grid of frequencies shows."""
    Omega = grid(*_RANGE, points)
    exists = solve(system, Omega, frozenset({"exists"})).exists
    assert exists is not None
    change = np.diff(np.concatenate([[False], exists, [False]]).astype(np.int8))
    return Omega[np.flatnonzero(change == 1)], Omega[np.flatnonzero(change == -1) - 1]


def bands_by_scans() -> Table:
    """Find the same bands by looking at impact modes on uniform grids.

    A band is missed where none of its frequencies is looked at, or joined to its neighbour.
    The error is that of the edges that are found.
    """
    rows: list[tuple[Any, ...]] = []
    for title, system, goal in (
        ("chain, N=13", chain(13), 0.05),
        ("full M and K, N=50", random_structure(50, 3), 1.0),
    ):
        certified = bands(system)
        assert certified.band_start is not None
        assert certified.band_stop is not None
        assert certified.band_edge_error is not None
        timed = measure(rounds=3, bands=partial(bands, system))["bands"].processor
        error = float(certified.band_edge_error.max())
        rows.append((title, "Vibroimpact, certified", None, timed, 0, max(error, 1e-16), goal))
        for points in (10**2, 10**3, 10**4, 10**5):
            start, stop = scan(system, points)
            each = measure(rounds=1, scan=partial(scan, system, points))["scan"].processor
            middles = 0.5 * (start + stop)
            hit = {int(k) for k in np.searchsorted(certified.band_start, middles, "right")}
            missed = certified.band_start.size - len(hit)
            edges = np.concatenate([start, stop])
            true = np.sort(np.concatenate([certified.band_start, certified.band_stop]))
            error = float(np.abs(edges[:, np.newaxis] - true).min(axis=1).max(initial=0.0))
            rows.append((title, "scan", points, each, missed, error, None))
    return Table(
        "Bands by scans",
        (
            "structure",
            "method",
            "points",
            "processor [s]",
            "bands missed",
            "error of edges",
            "goal [s]",
        ),
        rows,
        "The scans use the solvers' own certified check of existence at every point.",
        Goal("processor [s]", "goal [s]"),
        plots=(Plot("processor [s]", "error of edges", "method", "structure"),),
    )


class _Kept:
    """Work whose results are kept."""

    def __init__(self, work: Callable[[], Result]) -> None:
        self.work, self.results = work, list[Result]()

    def __call__(self) -> None:
        self.results.append(self.work())


def bands_of_beams() -> Table:
    """Prove all bands of cantilevers between the first natural frequency and 1.3 times it."""
    rows: list[tuple[Any, ...]] = []
    for elements, goal in ((3, None), (6, None), (12, 1.5), (25, 30.0)):
        M, K = (SymmetricMatrix.dense(A) for A in beams.matrices(elements))
        n = 2 * elements
        system = System(M, K, (Constraint.at(n - 2, 0.01),))
        natural = spectrum.spectrum(system, spectrum.choose(system)).roots
        first, last = float(natural[0]), float(natural[-1])
        work = _Kept(partial(bands, system, first, 1.3 * first))
        timed = measure(rounds=1 if n > 24 else 3, sample=0.0, work=work)["work"].processor
        starts = work.results[-1].band_start
        count = 0 if starts is None else starts.size
        rows.append((n, last / first, count, timed, goal, _BEFORE.get(n)))
    return Table(
        "Bands of beams",
        ("degrees of freedom", "largest over first", "bands", "processor [s]", "goal", "0.2.0 [s]"),
        rows,
        "Cantilevers of Euler-Bernoulli elements with stops at the tip; the second column is the "
        "ratio of their natural frequencies. Complete: every band is proved, and none is missed. "
        "Two cores share the work.",
        Goal("processor [s]", "goal"),
    )
