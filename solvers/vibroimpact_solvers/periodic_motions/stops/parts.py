"""Parts of solutions in which one structure moves: their states, errors and quadratures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.periodic_motions.frame import Frame
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.stops import prescribed
from vibroimpact_solvers.periodic_motions.stops.phases import Phases, Side
from vibroimpact_solvers.periodic_motions.stops.prescribed import Cells
from vibroimpact_solvers.periodic_motions.stops.solutions import Solutions

_NODES: Final = 12
_PLACES: Final = 0.5 * (np.polynomial.legendre.leggauss(_NODES)[0] + 1.0)
_WEIGHTS: Final = 0.5 * np.polynomial.legendre.leggauss(_NODES)[1]
_TURN: Final = 2.0  # radians of what turns fastest in a panel
_SILENT: Final = 1e-15  # of a form, what needs no nodes
_NUMBERS: Final = 2**16  # nodes times pairs, at most
_LEAST: Final = 500  # nodes that are always allowed
LONG: Final = 300.0
"""Exponent whose exponential is a number, and its inverse, too."""
ROUNDED: Final = 8.0
"""Roundings of a sum."""


@dataclass(frozen=True, eq=False, slots=True)
class Nodes:
    """A quadrature over a part of a motion.

    Parameters
    ----------
    times, weights : array, shape (time,)
    left : array of int
        Pairs that are too fast for the nodes.
    """

    times: Floats
    weights: Floats
    left: Integers


@dataclass(frozen=True, eq=False, slots=True)
class Part:
    """A part of one solution, in which one structure moves.

    Parameters
    ----------
    side : Side
    state : array, shape (2 pair,)
    steady : array, shape (harmonic, 2 pair), complex
        With the drive's phase at the beginning.
    rates, turned : array, shape (harmonic,)
        Rates of the load, and what its amplitudes are multiplied by at the beginning.
    length : float
    error : array, shape (pair,)
        Of the state.
    frame : Frame, optional
        Of what moves with the walls, with the drive's phase at the beginning.
    """

    side: Side
    state: Floats
    steady: Complexes
    rates: Floats
    turned: Complexes
    length: float
    error: Floats
    frame: Frame | None = None

    def carried(self, times: Floats, amplitudes: Complexes) -> Floats:
        """Return what has these amplitudes at the beginning, shape (harmonic, …), at times."""
        return np.asarray((np.exp(1j * times[:, np.newaxis] * self.rates) @ amplitudes).real)

    def carried_error(self, amplitudes: Complexes) -> Floats:
        """Return roundings of what is carried."""
        return np.asarray(EPS * (ROUNDED + 2.0 * self.length * self.rates) @ np.abs(amplitudes))

    def wall_speed(self, constraint: int) -> float:
        """Return a bound of the velocity of a wall, by the basis' time."""
        if self.frame is None:
            return 0.0
        return float(self.rates @ np.abs(self.frame.walls[:, constraint]))

    def states(self, times: Floats) -> Floats:
        """Return whole states, with the steady response, at times, (time, 2 pair)."""
        flow = self.side.propagators(times)
        moved = prescribed.apply(flow, np.broadcast_to(self.state, (times.size, self.state.size)))
        return np.asarray(
            moved + (np.exp(1j * times[:, np.newaxis] * self.rates) @ self.steady).real
        )

    def both(self, times: Floats) -> tuple[Floats, Floats]:
        """Return whole states and their rates, (time, 2 pair)."""
        flow = self.side.propagators(times)
        moved = prescribed.apply(flow, np.broadcast_to(self.state, (times.size, self.state.size)))
        rates = prescribed.drift(self.side, np.arange(self.state.size), moved, form=False)
        turned = np.exp(1j * times[:, np.newaxis] * self.rates)
        return (
            np.asarray(moved + (turned @ self.steady).real),
            np.asarray(rates + ((turned * (1j * self.rates)) @ self.steady).real),
        )

    def nodes(self, form: Floats) -> Nodes:
        """Return times and weights of a quadrature that is exact for forms (form, 2 pair).

        So it is but for what is fast and of little weight, if all is too much.
        """
        n, growth, rate = self.side.size, self.side.growth, self.side.rate
        sizes = lengths(form) * np.hypot(self.state[:n], self.state[n:])
        grown = sizes * np.exp(np.clip(growth * self.length, 0.0, LONG))
        steady = np.abs(self.steady).sum(axis=0)
        whole = grown.sum(axis=1) + lengths(form) @ np.hypot(steady[:n], steady[n:])
        share = (grown / np.maximum(whole, 1e-300)[:, np.newaxis]).max(axis=0)
        # Pairs by descending rate; what of them, and for how long, is more than rounding.
        order = np.argsort(-rate, kind="stable")
        seen = np.log(np.maximum(share[order], 1e-300) * n / _SILENT)
        own, fades = growth[order], np.where(growth[order] < 0.0, -growth[order], 0.0)
        lasts = np.where(fades > 0.0, seen / np.maximum(fades, 1e-300), np.inf)
        lasts = np.clip(np.where((seen <= 0.0) & (own <= 0.0), 0.0, lasts), 0.0, self.length)
        most = max(_LEAST, _NUMBERS // max(n, 1))
        low, high = 0, n
        while low < high:
            first = (low + high) // 2
            if self._panels(rate[order[first:]], lasts[first:])[1].sum() * _NODES <= most:
                high = first
            else:
                low = first + 1
        left = np.zeros(n, dtype=bool)
        left[order[:low]] = lasts[:low] > 0.0
        ends, counts = self._panels(rate[order[low:]], lasts[low:])
        starts = np.concatenate([[0.0], ends[:-1]])
        inner = [
            begin + (end - begin) * np.arange(count) / count
            for begin, end, count in zip(starts, ends, counts.tolist(), strict=True)
        ]
        edges = np.concatenate([*inner, [self.length]])
        widths = np.diff(edges)[:, np.newaxis]
        times, weights = edges[:-1, np.newaxis] + widths * _PLACES, widths * _WEIGHTS
        # Both ends are nodes of no weight: peaks are often there.
        times = np.concatenate([edges[:1], times.ravel(), edges[-1:]])
        return Nodes(times, np.concatenate([[0.0], weights.ravel(), [0.0]]), np.flatnonzero(left))

    def _panels(self, rates: Floats, lasts: Floats) -> tuple[Floats, Integers]:
        """Return ends of stretches and their numbers of panels, for pairs by descending rate."""
        load = float(self.rates.max(initial=0.0))
        until = np.append(np.maximum.accumulate(lasts) if lasts.size else lasts, self.length)
        width = np.diff(until, prepend=0.0)
        fastest = np.maximum(np.append(rates, 0.0), load)
        some = width > 1e-12 * self.length
        some[-1] |= not some.any()
        ends = until[some]
        ends[-1] = self.length
        counts = np.ceil(np.diff(ends, prepend=0.0) * fastest[some] / _TURN)
        return ends, np.maximum(np.minimum(counts, 1e9), 1.0).astype(np.int64)

    def error_of(self, form: Floats) -> Floats:
        """Return errors of forms (form, 2 pair) along the part, (form,)."""
        growth = np.maximum(self.side.growth * self.length, 0.0)
        error = self.error * np.exp(np.minimum(growth, 700.0))
        sizes = np.abs(self.state) + np.abs(self.steady).sum(axis=0)
        rounded = self.side.shape_error + ROUNDED * EPS
        late = (
            2.0 * EPS * self.length * (np.abs(form) @ (np.abs(self.steady).T * self.rates).sum(1))
        )
        spread = np.sqrt(lengths(form) ** 2 @ error**2)
        return np.asarray(spread + rounded * np.abs(form) @ sizes + late)

    @classmethod
    def at_entry(cls, phases: Phases, cells: Cells, solved: Solutions, k: int) -> Part:
        """Return the state of the open structure where a contact phase begins."""
        f = int(solved.index[k])
        turned = np.exp(1j * solved.phase[k] * phases.harmonics)
        return cls(
            phases.open, solved.entry[k], cells.opened[f] * turned[:, np.newaxis],
            cells.Omega[f] * phases.harmonics, turned, 0.0, solved.left_error[k],
            None if phases.frame is None else phases.frame.at(turned),
        )  # fmt: skip


def parts(phases: Phases, cells: Cells, solved: Solutions, k: int) -> tuple[Part, Part]:
    """Return the contact phase of a solution, and what follows."""
    f = int(solved.index[k])
    rates = cells.Omega[f] * phases.harmonics

    def part(side: Side, steady: Complexes, since: float, state: Floats, length: float,
             error: Floats) -> Part:  # fmt: skip
        turned = np.exp(1j * (solved.phase[k] * phases.harmonics + rates * since))
        own = steady[f] * turned[:, np.newaxis]
        frame = None if phases.frame is None else phases.frame.at(turned)
        return Part(side, state, own, rates, turned * cells.factor[f], length, error, frame)

    d, rest = float(solved.d[k]), float(solved.rest[k])
    return (
        part(phases.loaded, cells.loaded, 0.0, solved.loaded[k], d, solved.loaded_error[k]),
        part(phases.open, cells.opened, d, solved.left[k], rest, solved.left_error[k]),
    )


def lengths(form: Floats) -> Floats:
    """Return the lengths of forms (form, 2 pair) in each pair, (form, pair)."""
    n = form.shape[1] // 2
    return np.asarray(np.hypot(form[:, :n], form[:, n:]))
