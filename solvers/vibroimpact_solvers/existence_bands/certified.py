"""Existence bands of a family with one bilateral limiter, complete by construction."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.existence_bands.margin import margin_of
from vibroimpact_solvers.existence_bands.problem import Problem
from vibroimpact_solvers.existence_bands.ranges import Band, FrequencyRanges, Rejected
from vibroimpact_solvers.existence_bands.segments import Segment, SignBand, closed
from vibroimpact_solvers.kernels import bands
from vibroimpact_solvers.kernels.threads import over_ranges
from vibroimpact_solvers.plan import Tick, batches
from vibroimpact_solvers.results.existence_bands import Edge
from vibroimpact_solvers.spectrum import Spectrum

PROVED: Final = (
    "certified: bounds over boxes of frequency and time, with proved errors of all natural modes, "
    "rounded outwards; edges are enclosed"
)
ESTIMATED: Final = (
    "estimated: bounds over boxes of frequency and time, rounded outwards, for natural modes whose "
    "errors are estimates"
)

AT_RESOLUTION: Final = (
    "; at a resolution: narrower bands and gaps are found by chance, between the poles about the "
    "frequencies of a grid"
)

_NUMBERS = 2**20  # of phases that are there at once
_BUDGET = 20_000_000  # boxes for one sign band
_BATCH = 64  # sign bands between two reports of progress
_WIDE = 8.0  # times the resolution: undecided ranges of this width are reported


class CertifiedBands:
    """Computation of the bands of one problem.

    It has one active constraint with equal gaps, no load and no unstable modes.
    """

    def __init__(self, problem: Problem, natural: Spectrum) -> None:
        self.problem = problem
        self.q_start = 0.5 * np.pi / problem.stop
        self.q_stop = 0.5 * np.pi / problem.start
        self.margin, self.proved = margin_of(problem, natural)

    def find(self, tick: Tick | None) -> FrequencyRanges:
        """Return all bands; `tick(done, total)` counts sign bands."""
        ranges = FrequencyRanges(resolution=self.problem.edge_width, complete=self.proved)
        ranges.statement = PROVED if self.proved else ESTIMATED
        if self.problem.resolution is None:
            left, right, error = self._intervals()
        else:
            left, right, error = self._intervals_on_grid()
            if not self._cover(left, right):
                share = 1.0 - self.problem.start / self.problem.stop
                ranges.resolution = self.problem.resolution * share
                ranges.statement += AT_RESOLUTION
                ranges.decided, ranges.complete = self._fraction(left, right), False
        for first, last in batches(left.size, _BATCH, tick):
            some = slice(first, last)
            for sign_band in self._surveyed(left[some], right[some], error[some]):
                self._record(ranges, sign_band)
        return ranges

    def _intervals(self) -> tuple[Floats, Floats, Floats]:
        """Return pairs of neighbouring poles that cover the range, and the errors of the second."""
        roots = self.margin.root
        relative = self.margin.root_error / roots + 4.0 * EPS
        highest = np.floor(self.q_stop * roots / np.pi + 0.5).astype(np.int64) + 1
        poles = [
            (2.0 * np.arange(1, count + 1) - 1.0) * (0.5 * np.pi / root)
            for root, count in zip(roots, highest, strict=True)
        ]
        if not poles:
            return np.zeros(1), np.full(1, np.inf), np.zeros(1)
        q = np.concatenate(poles)
        error = q * np.repeat(relative, highest)
        order = np.argsort(q)
        q, error = q[order], error[order]
        left, right = np.concatenate([[0.0], q[:-1]]), q
        # Between coinciding poles nothing can be resolved.
        apart = right - left > 0.25 * self.problem.edge_width * right
        inside = apart & (right > self.q_start) & (left < self.q_stop)
        return left[inside], right[inside], error[inside]

    def _intervals_on_grid(self) -> tuple[Floats, Floats, Floats]:
        """Return pairs of neighbouring poles about frequencies of a grid, and errors as above."""
        q, roots = 0.5 * np.pi / self.problem.grid[::-1], self.margin.root
        if not roots.size:
            return np.zeros(1), np.full(1, np.inf), np.zeros(1)
        relative = self.margin.root_error / roots + 4.0 * EPS
        lefts, rights, errors = [], [], []
        for some in np.array_split(q, math.ceil(q.size * roots.size / _NUMBERS)):
            turns = np.floor(np.outer(some, roots) / np.pi + 0.5)
            quarter = 0.5 * np.pi / roots
            lefts.append(np.maximum(((2.0 * turns - 1.0) * quarter).max(axis=1), 0.0))
            right = (2.0 * turns + 1.0) * quarter
            which = right.argmin(axis=1)
            rights.append(right[np.arange(some.size), which])
            errors.append(rights[-1] * relative[which])
        left, right, error = map(np.concatenate, (lefts, rights, errors))
        new = np.concatenate([[True], np.diff(right) > 0.0])
        apart = right - left > 0.25 * self.problem.edge_width * right
        return left[new & apart], right[new & apart], error[new & apart]

    def _cover(self, left: Floats, right: Floats) -> bool:
        """Whether no pole is left out: each interval begins where the one before ends."""
        if not left.size or left[0] > self.q_start or right[-1] < self.q_stop:
            return False
        return bool((left[1:] == right[:-1]).all())

    def _fraction(self, left: Floats, right: Floats) -> float:
        """Return the fraction of the range, in Omega, that lies between pairs of poles."""
        low = np.maximum(0.5 * np.pi / right, self.problem.start)
        high = 0.5 * np.pi / np.maximum(left, self.q_start)
        covered = np.maximum(np.minimum(high, self.problem.stop) - low, 0.0)
        return min(1.0, float(covered.sum()) / (self.problem.stop - self.problem.start))

    def _surveyed(self, left: Floats, right: Floats, error: Floats) -> list[SignBand]:
        """Return the sign bands between poles, in segments."""
        results: list[SignBand] = [SignBand(0.0, 0.0, 0.0, 0.0)] * left.size

        def piece(start: int, stop: int) -> None:
            for i in range(start, stop):
                results[i] = self._survey(float(left[i]), float(right[i]), float(error[i]))

        over_ranges(piece, left.size, 2e5 * self.margin.root.size * left.size)
        return results

    def _survey(self, left: float, right: float, error: float) -> SignBand:
        zero, zero_error = 0.0, 0.0
        if left > 0.0:
            zero, zero_error = bands.sign_change(self.margin, left, right)
        band = SignBand(zero, right, zero_error, error)
        start, stop = max(zero, self.q_start), min(right, self.q_stop)
        if not start < stop:
            return band
        if left == 0.0 and len(self.margin.alpha) == 1:
            # All terms of the velocity have the sign of the impulse: it does not turn back.
            return replace(band, segments=[Segment(start, stop, bands.ADMISSIBLE, 0.0, 0)])
        bounds, *parts_of, _ = bands.survey(
            self.margin, start, stop, self.problem.edge_width, _BUDGET
        )
        parts = zip(bounds[:-1], bounds[1:], *parts_of, strict=True)
        segments = [
            Segment(float(a), float(b), int(decision), float(tau), int(index))
            for a, b, decision, tau, index in parts
        ]
        return replace(band, segments=segments)

    def _record(self, ranges: FrequencyRanges, band: SignBand) -> None:
        for segment in band.segments:
            wide = segment.right - segment.left > _WIDE * self.problem.edge_width * segment.right
            if segment.status == bands.UNDECIDED and wide:
                ranges.unresolved.append((_Omega(segment.right), _Omega(segment.left)))
        for segment in closed(band):
            # Large q is low frequency.
            start, start_error = self._edge(
                segment.right, segment.right_error, self.q_stop, self.problem.start
            )
            stop, stop_error = self._edge(
                segment.left, segment.left_error, self.q_start, self.problem.stop
            )
            error, certified = max(start_error, stop_error), segment.certified and self.proved
            if segment.status == bands.ADMISSIBLE:
                below, above = self._reasons(segment, band)
                ranges.bands.append(Band(start, stop, below, above, error, certified))
            else:
                where = segment.witness, segment.limit
                ranges.rejected.append(
                    Rejected(start, stop, Edge.PENETRATION, error, certified, *where)
                )

    def _edge(self, q: float, error: float, limit: float, given: float) -> tuple[float, float]:
        """Return an edge as Omega and its absolute error; the ends of the range are exact."""
        if q == limit:
            return given, 0.0
        Omega = _Omega(q)
        return Omega, Omega * (error / max(q - error, 0.5 * q) + 4.0 * EPS)

    def _reasons(self, segment: Segment, band: SignBand) -> tuple[Edge, Edge]:
        """Return why no impact modes exist below and above a band."""
        below = above = Edge.PENETRATION
        if segment.right == self.q_stop:
            below = Edge.RANGE
        elif segment.right == band.pole:
            below = Edge.NEGATIVE_IMPULSE
        if segment.left == self.q_start:
            above = Edge.RANGE
        elif segment.left == band.zero:
            above = Edge.SINGULAR
        return below, above


def _Omega(q: float) -> float:
    return 0.5 * np.pi / q
