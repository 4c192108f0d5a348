"""Existence bands: time of certified bands against scans, and what scans miss."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from benchmarks.cases import chain, grid, random_structure
from benchmarks.harness import measure
from benchmarks.tables import Goal, Plot, Table
from vibroimpact_solvers import existence_bands, impact_modes, spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.existence_bands import Problem, Result
from vibroimpact_solvers.model import System

RANGE: Final = (0.2, 3.0)


def bands(system: System, start: float = RANGE[0], stop: float = RANGE[1]) -> Result:
    """Plan and solve, as the service does."""
    problem = Problem(system, start, stop, outputs=frozenset({"bands"}))
    return existence_bands.solve(problem, existence_bands.plan(problem))


def scan(system: System, points: int) -> tuple[Floats, Floats]:
    """Return the bands that a uniform grid of frequencies shows."""
    Omega = grid(*RANGE, points)
    problem = impact_modes.Problem(
        system, Omega * (2.0 / np.pi), outputs=frozenset({"exists"}), Omega=Omega
    )
    exists = impact_modes.solve(problem, impact_modes.plan(problem)).exists
    assert exists is not None
    change = np.diff(np.concatenate([[False], exists, [False]]).astype(np.int8))
    return Omega[np.flatnonzero(change == 1)], Omega[np.flatnonzero(change == -1) - 1]


def certified() -> Table:
    """Find bands of members that are motions, proved throughout the range, with their edges."""
    rows = []
    for title, system, goal in (
        ("chain, N=13", chain(13), 0.05),
        ("full M and K, N=50", random_structure(50, 3), 1.0),
    ):
        spectrum.spectrum(system)
        found = bands(system)
        assert found.band_start is not None
        assert found.band_stop is not None
        assert found.band_edge_error is not None
        timed = measure(rounds=3, bands=partial(bands, system))["bands"]
        narrowest = float(np.min(found.band_stop - found.band_start))
        undecided = float(np.sum(found.unresolved_stop - found.unresolved_start))
        rows.append(
            (
                title,
                found.band_start.size,
                narrowest,
                float(found.band_edge_error.max()),
                undecided,
                timed.wall,
                timed.processor,
                goal,
            )
        )
    return Table(
        "Certified existence bands, Ω from 0.2 to 3",
        (
            "structure",
            "bands",
            "narrowest",
            "edge error",
            "undecided width",
            "clock [s]",
            "processor [s]",
            "goal [s]",
        ),
        rows,
        "Natural modes known beforehand.",
        Goal("processor [s]", "goal [s]"),
    )


def against_scans() -> Table:
    """Find the same bands by looking at the members of uniform grids.

    A band is missed where none of its frequencies is looked at, or joined to its neighbour.
    The error is that of the edges found.
    """
    rows: list[tuple[str, str, int | None, float, int, float]] = []
    for title, system in (
        ("chain, N=13", chain(13)),
        ("full M and K, N=50", random_structure(50, 3)),
    ):
        found = bands(system)
        assert found.band_start is not None
        assert found.band_stop is not None
        assert found.band_edge_error is not None
        timed = measure(rounds=3, bands=partial(bands, system))["bands"].processor
        error = float(found.band_edge_error.max())
        rows.append((title, "certified", None, timed, 0, max(error, 1e-16)))
        for points in (10**2, 10**3, 10**4, 10**5):
            start, stop = scan(system, points)
            each = measure(rounds=1, scan=partial(scan, system, points))["scan"].processor
            middles = 0.5 * (start + stop)
            hit = {int(k) for k in np.searchsorted(found.band_start, middles, "right")}
            missed = found.band_start.size - len(hit)
            edges = np.concatenate([start, stop])
            true = np.sort(np.concatenate([found.band_start, found.band_stop]))
            error = float(np.abs(edges[:, np.newaxis] - true).min(axis=1).max(initial=0.0))
            rows.append((title, "scan", points, each, missed, error))
    return Table(
        "Bands by scans",
        ("structure", "method", "points", "processor [s]", "bands missed", "error of edges"),
        rows,
        "The scans use the solvers' own certified check of existence at every point.",
        plots=(
            Plot("processor [s]", "error of edges", "method", "structure", ours="certified"),
            Plot("processor [s]", "bands missed", "method", "structure", "x", ours="certified"),
        ),
    )


TABLES: Final = (certified, against_scans)
