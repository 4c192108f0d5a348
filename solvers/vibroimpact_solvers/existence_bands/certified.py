"""Bands of a family with one bilateral limiter, complete by construction."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.existence_bands.problem import Problem
from vibroimpact_solvers.existence_bands.ranges import Band, Findings, Rejected
from vibroimpact_solvers.existence_bands.result import Edge
from vibroimpact_solvers.kernels import bands
from vibroimpact_solvers.kernels.threads import over_ranges
from vibroimpact_solvers.spectrum import Spectrum

STATEMENT: Final = (
    "proved, apart from errors of the natural modes: bounds over boxes of frequency and time, "
    "with room for rounding; edges are enclosed"
)

_EPS = float(np.finfo(np.float64).eps)
_HEARD = 1e-13  # modes seen less than this, relative to all, change nothing wider than rounding
_SOFT = 1e-6  # natural frequencies down to minus this part of the largest count as zero
_BUDGET = 20_000_000  # boxes for one sign band
_TOGETHER = 64  # sign bands between two reports of progress
_WIDE = 8.0  # times the resolution


@dataclass(frozen=True, slots=True)
class Segment:
    """A decided or undecided range of q = 1/omega inside a sign band.

    Parameters
    ----------
    left, right : float
    status : int
        As in `kernels.bands`.
    witness : float
    limit : int
    error : float
        Absolute error of its ends.
    certified : bool
    """

    left: float
    right: float
    status: int
    witness: float
    limit: int
    error: float = 0.0
    certified: bool = True


class CertifiedBands:
    """Finds the bands of one problem.

    Parameters
    ----------
    problem : Problem
        One active constraint with equal gaps, no load.
    natural : Spectrum
        No unstable modes.
    """

    def __init__(self, problem: Problem, natural: Spectrum) -> None:
        self.problem = problem
        constraints = problem.system.constraints
        rows = natural.along(constraints)
        (self.struck,) = problem.active
        row = rows[self.struck]
        roots = np.where(natural.roots > _SOFT**2 * natural.largest_frequency, natural.roots, 0.0)
        heard = np.abs(row) > _HEARD * np.linalg.norm(row)
        swings, rigid = heard & (roots > 0.0), heard & (roots == 0.0)
        self.roots = np.ascontiguousarray(roots[swings])
        with np.errstate(over="ignore"):
            self.doubt = 4.0 * _EPS + 0.5 * natural.uncertainty / self.roots**2
        # An odd motion reaches as far down as up: the nearer wall counts.
        walls = [(c.lower, c.upper) for c in constraints]
        gaps = np.array([min(w for w in pair if w is not None) for pair in walls])
        alpha = np.outer(gaps / gaps[self.struck], row * row)
        beta = rows * row
        self.alpha, self.beta = (np.ascontiguousarray(x[:, swings]) for x in (alpha, beta))
        self.rigid_alpha, self.rigid_beta = (x[:, rigid].sum(axis=1) for x in (alpha, beta))
        self.weight2 = np.ascontiguousarray(self.beta[self.struck])
        self.q_start = 0.5 * np.pi / problem.stop
        self.q_stop = 0.5 * np.pi / problem.start

    def find(self, tick: Callable[[int, int], None] | None) -> Findings:
        """Return all bands; `tick(done, total)` counts sign bands."""
        found = Findings(resolution=self.problem.resolution, statement=STATEMENT)
        left, right, doubt = self._intervals()
        total = left.size
        for first in range(0, total, _TOGETHER):
            if tick is not None:
                tick(first, total)
            some = slice(first, min(first + _TOGETHER, total))
            for segments, ends, share in self._surveyed(left[some], right[some], doubt[some]):
                self._record(found, segments, ends, share)
        if tick is not None:
            tick(total, total)
        return found

    def _intervals(self) -> tuple[Floats, Floats, Floats]:
        """Return between which neighbouring poles the range lies, and their relative errors."""
        highest = np.floor(self.q_stop * self.roots / np.pi + 0.5).astype(np.int64) + 1
        poles = [
            (2.0 * np.arange(1, count + 1) - 1.0) * (0.5 * np.pi / root)
            for root, count in zip(self.roots, highest, strict=True)
        ]
        doubts = [np.full(p.size, d) for p, d in zip(poles, self.doubt, strict=True)]
        if not poles:
            return np.zeros(1), np.full(1, np.inf), np.full(1, _EPS)
        q, doubt = np.concatenate(poles), np.concatenate(doubts)
        order = np.argsort(q)
        q, doubt = q[order], doubt[order]
        left, right = np.concatenate([[0.0], q[:-1]]), q
        # Poles that coincide have nothing between them that could be resolved.
        apart = right - left > 0.25 * self.problem.resolution * right
        wanted = apart & (right > self.q_start) & (left < self.q_stop)
        return left[wanted], right[wanted], doubt[wanted]

    def _surveyed(
        self, left: Floats, right: Floats, doubt: Floats
    ) -> Iterator[tuple[list[Segment], tuple[float, float], float]]:
        """Yield the segments of sign bands, their ends (zero, pole), and relative errors."""
        results: list[tuple[list[Segment], tuple[float, float]]] = [([], (0.0, 0.0))] * left.size

        def piece(start: int, stop: int) -> None:
            for i in range(start, stop):
                results[i] = self._survey(float(left[i]), float(right[i]))

        over_ranges(piece, left.size, 2e5 * self.roots.size * left.size)
        for (segments, ends), share in zip(results, doubt, strict=True):
            yield segments, ends, float(share)

    def _survey(self, left: float, right: float) -> tuple[list[Segment], tuple[float, float]]:
        zero = 0.0
        if left > 0.0:
            rigid = float(self.rigid_beta[self.struck])
            zero = bands.sign_change(self.roots, self.weight2, rigid, left, right)
        start, stop = max(zero, self.q_start), min(right, self.q_stop)
        if not start < stop:
            return [], (zero, right)
        if left == 0.0 and len(self.alpha) == 1:
            # Every term of the velocity has the sign of the impulse: it cannot turn back.
            return [Segment(start, stop, bands.REAL, 0.0, 0)], (zero, right)
        bounds, status, witness, limit, _ = bands.survey(
            self.roots,
            self.alpha,
            self.beta,
            self.rigid_alpha,
            self.rigid_beta,
            self.struck,
            start,
            stop,
            self.problem.resolution,
            _BUDGET,
        )
        parts = zip(bounds[:-1], bounds[1:], status, witness, limit, strict=True)
        segments = [
            Segment(float(a), float(b), int(found), float(tau), int(index))
            for a, b, found, tau, index in parts
        ]
        return segments, (zero, right)

    def _record(
        self, found: Findings, segments: list[Segment], ends: tuple[float, float], doubt: float
    ) -> None:
        for segment in segments:
            wide = segment.right - segment.left > _WIDE * self.problem.resolution * segment.right
            if segment.status == bands.UNDECIDED and wide:
                found.unresolved.append((_Omega(segment.right), _Omega(segment.left)))
        for segment in closed(segments):
            # Large q is low frequency.
            start = self._edge(segment.right, self.q_stop, self.problem.start)
            stop = self._edge(segment.left, self.q_start, self.problem.stop)
            below, above = self._reasons(segment, ends)
            if segment.status == bands.REAL:
                error = stop * (segment.error / segment.left + doubt)
                found.bands.append(Band(start, stop, below, above, error, segment.certified))
            else:
                witness, place = segment.witness, segment.limit
                kind = Rejected(start, stop, Edge.PENETRATION, segment.certified, witness, place)
                found.rejected.append(kind)

    def _edge(self, q: float, limit: float, given: float) -> float:
        return given if q == limit else _Omega(q)

    def _reasons(self, segment: Segment, ends: tuple[float, float]) -> tuple[Edge, Edge]:
        """Return what members are below and above a band."""
        zero, pole = ends
        below = above = Edge.PENETRATION
        if segment.right == self.q_stop:
            below = Edge.RANGE
        elif segment.right == pole:
            below = Edge.NEGATIVE_IMPULSE
        if segment.left == self.q_start:
            above = Edge.RANGE
        elif segment.left == zero:
            above = Edge.SINGULAR
        return below, above


def _Omega(q: float) -> float:
    return 0.5 * np.pi / q


def closed(segments: list[Segment]) -> list[Segment]:
    """Return the decided segments with the undecided ones between them given to them.

    Between unlike neighbours an edge lies in the middle of the undecided one; between like ones
    the two are joined, no longer certain; at the end of the sign band the neighbour takes it.
    """
    decided: list[Segment] = []
    gap: Segment | None = None
    for segment in segments:
        if segment.status == bands.UNDECIDED:
            gap = segment
            continue
        if gap is not None and decided and decided[-1].status == segment.status:
            before = decided.pop()
            error = max(before.error, segment.error)
            segment = _replaced(before, before.left, segment.right, error, certified=False)
        elif gap is not None:
            half = 0.5 * (gap.right - gap.left)
            if decided:
                before = decided.pop()
                middle, error = gap.left + half, max(before.error, half)
                decided.append(
                    _replaced(before, before.left, middle, error, certified=before.certified)
                )
                segment = _replaced(segment, middle, segment.right, half, certified=True)
            else:
                segment = _replaced(segment, gap.left, segment.right, 2.0 * half, certified=True)
        gap = None
        decided.append(segment)
    if gap is not None and decided:
        last = decided.pop()
        error = max(last.error, gap.right - gap.left)
        decided.append(_replaced(last, last.left, gap.right, error, certified=last.certified))
    return decided


def _replaced(
    segment: Segment, left: float, right: float, error: float, *, certified: bool
) -> Segment:
    return Segment(left, right, segment.status, segment.witness, segment.limit, error, certified)
