"""Existence bands of a family with one bilateral limiter, complete by construction."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.existence_bands.problem import Problem
from vibroimpact_solvers.existence_bands.ranges import Band, FrequencyRanges, Rejected
from vibroimpact_solvers.kernels import bands
from vibroimpact_solvers.kernels.threads import over_ranges
from vibroimpact_solvers.plan import Tick, batches
from vibroimpact_solvers.results.existence_bands import Edge
from vibroimpact_solvers.spectrum import Spectrum

STATEMENT: Final = (
    "proved, apart from errors of the natural modes: bounds over boxes of frequency and time, "
    "with a margin for rounding; edges are enclosed"
)

_PARTICIPATES = 1e-13  # modes of smaller relative participation have no effect beyond rounding
_SOFT = 1e-6  # growth rates up to this part of the largest frequency count as zero
_BUDGET = 20_000_000  # boxes for one sign band
_BATCH = 64  # sign bands between two reports of progress
_WIDE = 8.0  # times the resolution: undecided ranges of this width are reported


@dataclass(frozen=True, slots=True)
class Segment:
    """A range of q = 1/omega inside a sign band, decided or not."""

    left: float
    right: float
    status: int  # as in `kernels.bands`
    witness: float
    limit: int
    error: float = 0.0  # absolute error of the ends
    certified: bool = True


class CertifiedBands:
    """Computation of the bands of one problem.

    It has one active constraint with equal gaps, no load and no unstable modes.
    """

    def __init__(self, problem: Problem, natural: Spectrum) -> None:
        self.problem = problem
        constraints = problem.system.constraints
        rows = natural.along(constraints)
        (self.struck,) = problem.active
        row = rows[self.struck]
        roots = np.where(natural.roots > _SOFT**2 * natural.largest_frequency, natural.roots, 0.0)
        participating = np.abs(row) > _PARTICIPATES * np.linalg.norm(row)
        swings, rigid = participating & (roots > 0.0), participating & (roots == 0.0)
        self.roots = np.ascontiguousarray(roots[swings])
        with np.errstate(over="ignore"):
            self.root_error = 4.0 * EPS + 0.5 * natural.uncertainty / self.roots**2
        # An antisymmetric motion reaches equally far on both sides: the nearer wall counts.
        walls = [(c.lower, c.upper) for c in constraints]
        gaps = np.array([min(w for w in pair if w is not None) for pair in walls])
        alpha = np.outer(gaps / gaps[self.struck], row * row)
        beta = rows * row
        self.margin = bands.Margin(
            self.roots,
            np.ascontiguousarray(alpha[:, swings]),
            np.ascontiguousarray(beta[:, swings]),
            alpha[:, rigid].sum(axis=1),
            beta[:, rigid].sum(axis=1),
            self.struck,
        )
        self.weight2 = np.ascontiguousarray(self.margin.beta[self.struck])
        self.q_start = 0.5 * np.pi / problem.stop
        self.q_stop = 0.5 * np.pi / problem.start

    def find(self, tick: Tick | None) -> FrequencyRanges:
        """Return all bands; `tick(done, total)` counts sign bands."""
        ranges = FrequencyRanges(resolution=self.problem.resolution, statement=STATEMENT)
        left, right, error = self._intervals()
        for first, last in batches(left.size, _BATCH, tick):
            some = slice(first, last)
            surveyed = self._surveyed(left[some], right[some])
            for (segments, ends), relative in zip(surveyed, error[some], strict=True):
                self._record(ranges, segments, ends, float(relative))
        return ranges

    def _intervals(self) -> tuple[Floats, Floats, Floats]:
        """Return pairs of neighbouring poles that cover the range, and their relative errors."""
        highest = np.floor(self.q_stop * self.roots / np.pi + 0.5).astype(np.int64) + 1
        poles = [
            (2.0 * np.arange(1, count + 1) - 1.0) * (0.5 * np.pi / root)
            for root, count in zip(self.roots, highest, strict=True)
        ]
        errors = [np.full(p.size, d) for p, d in zip(poles, self.root_error, strict=True)]
        if not poles:
            return np.zeros(1), np.full(1, np.inf), np.full(1, EPS)
        q, error = np.concatenate(poles), np.concatenate(errors)
        order = np.argsort(q)
        q, error = q[order], error[order]
        left, right = np.concatenate([[0.0], q[:-1]]), q
        # Between coinciding poles nothing can be resolved.
        apart = right - left > 0.25 * self.problem.resolution * right
        inside = apart & (right > self.q_start) & (left < self.q_stop)
        return left[inside], right[inside], error[inside]

    def _surveyed(
        self, left: Floats, right: Floats
    ) -> list[tuple[list[Segment], tuple[float, float]]]:
        """Return the segments of sign bands and their ends (zero, pole)."""
        results: list[tuple[list[Segment], tuple[float, float]]] = [([], (0.0, 0.0))] * left.size

        def piece(start: int, stop: int) -> None:
            for i in range(start, stop):
                results[i] = self._survey(float(left[i]), float(right[i]))

        over_ranges(piece, left.size, 2e5 * self.roots.size * left.size)
        return results

    def _survey(self, left: float, right: float) -> tuple[list[Segment], tuple[float, float]]:
        zero = 0.0
        if left > 0.0:
            rigid = float(self.margin.rigid_beta[self.struck])
            zero = bands.sign_change(self.roots, self.weight2, rigid, left, right)
        start, stop = max(zero, self.q_start), min(right, self.q_stop)
        if not start < stop:
            return [], (zero, right)
        if left == 0.0 and len(self.margin.alpha) == 1:
            # All terms of the velocity have the sign of the impulse: it does not turn back.
            return [Segment(start, stop, bands.ADMISSIBLE, 0.0, 0)], (zero, right)
        bounds, *parts_of, _ = bands.survey(
            self.margin, start, stop, self.problem.resolution, _BUDGET
        )
        parts = zip(bounds[:-1], bounds[1:], *parts_of, strict=True)
        segments = [
            Segment(float(a), float(b), int(decision), float(tau), int(index))
            for a, b, decision, tau, index in parts
        ]
        return segments, (zero, right)

    def _record(
        self,
        ranges: FrequencyRanges,
        segments: list[Segment],
        ends: tuple[float, float],
        pole_error: float,
    ) -> None:
        for segment in segments:
            wide = segment.right - segment.left > _WIDE * self.problem.resolution * segment.right
            if segment.status == bands.UNDECIDED and wide:
                ranges.unresolved.append((_Omega(segment.right), _Omega(segment.left)))
        for segment in closed(segments):
            # Large q is low frequency.
            start = self._edge(segment.right, self.q_stop, self.problem.start)
            stop = self._edge(segment.left, self.q_start, self.problem.stop)
            below, above = self._reasons(segment, ends)
            if segment.status == bands.ADMISSIBLE:
                error = stop * (segment.error / segment.left + pole_error)
                ranges.bands.append(Band(start, stop, below, above, error, segment.certified))
            else:
                witness, place = segment.witness, segment.limit
                kind = Rejected(start, stop, Edge.PENETRATION, segment.certified, witness, place)
                ranges.rejected.append(kind)

    def _edge(self, q: float, limit: float, given: float) -> float:
        return given if q == limit else _Omega(q)

    def _reasons(self, segment: Segment, ends: tuple[float, float]) -> tuple[Edge, Edge]:
        """Return why no impact modes exist below and above a band."""
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
    """Return the decided segments, extended over the undecided ones.

    Between unlike segments the edge is put in the middle of the undecided one; like segments are
    joined and no longer certified; at the end of the sign band the neighbour is extended.
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
            segment = replace(before, right=segment.right, error=error, certified=False)
        elif gap is not None:
            half = 0.5 * (gap.right - gap.left)
            if decided:
                before, middle = decided.pop(), gap.left + half
                decided.append(replace(before, right=middle, error=max(before.error, half)))
                segment = replace(segment, left=middle, error=half)
            else:
                segment = replace(segment, left=gap.left, error=2.0 * half)
        gap = None
        decided.append(segment)
    if gap is not None and decided:
        error = max(decided[-1].error, gap.right - gap.left)
        decided[-1] = replace(decided[-1], right=gap.right, error=error)
    return decided
