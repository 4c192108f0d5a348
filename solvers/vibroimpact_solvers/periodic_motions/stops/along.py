"""Parts of solutions in which one structure moves, at the nodes of a quadrature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers
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
_LONG: Final = 300.0  # exponents whose exponentials are numbers
_CLOSE: Final = 2e-3
"""Part of a form's range by which parabolas through nodes, a quarter of a radian apart, are off."""
_NEWTON: Final = 6
_STILL: Final = 1e-8  # of the way between nodes, whose square is below rounding
_ROUNDED: Final = 8.0


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
    """

    side: Side
    state: Floats
    steady: Complexes
    rates: Floats
    turned: Complexes
    length: float
    error: Floats

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
        grown = sizes * np.exp(np.clip(growth * self.length, 0.0, _LONG))
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
        rounded = self.side.shape_error + _ROUNDED * EPS
        late = (
            2.0 * EPS * self.length * (np.abs(form) @ (np.abs(self.steady).T * self.rates).sum(1))
        )
        return np.asarray(
            np.sqrt(lengths(form) ** 2 @ error**2) + rounded * np.abs(form) @ sizes + late
        )

    @classmethod
    def at_entry(cls, phases: Phases, cells: Cells, solved: Solutions, k: int) -> Part:
        """Return the state of the open structure where a contact phase begins."""
        f = int(solved.index[k])
        turned = np.exp(1j * solved.phase[k] * phases.harmonics)
        return cls(
            phases.open, solved.entry[k], cells.opened[f] * turned[:, np.newaxis],
            cells.Omega[f] * phases.harmonics, turned, 0.0, solved.left_error[k],
        )  # fmt: skip


def parts(phases: Phases, cells: Cells, solved: Solutions, k: int) -> tuple[Part, Part]:
    """Return the contact phase of a solution, and what follows."""
    f = int(solved.index[k])
    rates = cells.Omega[f] * phases.harmonics

    def part(side: Side, steady: Complexes, since: float, state: Floats, length: float,
             error: Floats) -> Part:  # fmt: skip
        turned = np.exp(1j * (solved.phase[k] * phases.harmonics + rates * since))
        own = steady[f] * turned[:, np.newaxis]
        return Part(side, state, own, rates, turned * cells.factor[f], length, error)

    d, rest = float(solved.d[k]), float(solved.rest[k])
    return (
        part(phases.loaded, cells.loaded, 0.0, solved.loaded[k], d, solved.loaded_error[k]),
        part(phases.open, cells.opened, d, solved.left[k], rest, solved.left_error[k]),
    )


@dataclass(frozen=True, eq=False, slots=True)
class Samples:
    """A part at the nodes of a quadrature.

    Parameters
    ----------
    part : Part
    nodes : Nodes
    states : array, shape (time, 2 pair)
        Whole, with the steady response.
    """

    part: Part
    nodes: Nodes
    states: Floats

    @classmethod
    def of(cls, part: Part, form: Floats) -> Samples:
        """Return a part at nodes that are enough for forms (form, 2 pair)."""
        nodes = part.nodes(form)
        return cls(part, nodes, part.states(nodes.times))

    def ripple(self, form: Floats) -> Floats:
        """Return the sizes of what the nodes leave out of forms, (time, form)."""
        part, left, n = self.part, self.nodes.left, self.part.side.size
        sizes = np.hypot(part.state[left], part.state[left + n])
        times = self.nodes.times[:, np.newaxis]
        decay = np.exp(np.clip(times * part.side.growth[left], -_LONG, _LONG))
        return np.asarray((decay * sizes) @ lengths(form)[:, left].T)

    def peaks(self, form: Floats, level: Floats, seen: Floats) -> Floats:
        """Return the largest values of forms, seen at the nodes (time, form) as they are, (form,).

        Newton's method climbs all peaks between nodes that may be the highest.
        """
        part, values = self.part, np.ascontiguousarray(seen.T)
        best = values.max(axis=1)
        which, place, at = _climbed(self.nodes.times, values)
        times = self.nodes.times
        first, last = times[np.maximum(place - 1, 0)], times[np.minimum(place + 1, times.size - 1)]
        form, level = form[which], level[which]
        slope = prescribed.drift(part.side, np.arange(form.shape[1]), form, form=True)
        # The steady response turns at its own rates: its second derivative is not the form's.
        rates = 1j * part.rates[:, np.newaxis]
        more = (rates * (rates * (part.steady @ form.T) - part.steady @ slope.T)).T
        for _ in range(_NEWTON):
            state, moved = part.both(at)
            np.fmax.at(best, which, (state * form).sum(axis=1) + level)
            turned = np.exp(1j * at[:, np.newaxis] * part.rates)
            bend = (moved * slope).sum(axis=1) + (turned * more).real.sum(axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):
                way = np.where(bend < 0.0, -(moved * form).sum(axis=1) / bend, 0.0)
            before, at = at, np.clip(at + np.where(np.isfinite(way), way, 0.0), first, last)
            if not (np.abs(at - before) > _STILL * (last - first)).any():
                break
        return np.asarray(best)


def lengths(form: Floats) -> Floats:
    """Return the lengths of forms (form, 2 pair) in each pair, (form, pair)."""
    n = form.shape[1] // 2
    return np.asarray(np.hypot(form[:, :n], form[:, n:]))


def _climbed(times: Floats, values: Floats) -> tuple[Integers, Integers, Floats]:
    """Return the forms and nodes of peaks that may be the highest, and about where they are."""
    highest: Booleans = np.ones(values.shape, dtype=bool)
    highest[:, 1:] &= values[:, 1:] > values[:, :-1]
    highest[:, :-1] &= values[:, :-1] >= values[:, 1:]
    which, place = np.nonzero(highest)
    before, after = np.maximum(place - 1, 0), np.minimum(place + 1, times.size - 1)
    value, since, until = (
        values[which, place],
        times[place] - times[before],
        times[after] - times[place],
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        rise = (value - values[which, before]) / since
        fall = (values[which, after] - value) / until
        slope = (rise * until + fall * since) / (since + until)
        way = slope * (since + until) / (2.0 * (rise - fall))
    way = np.where(np.isfinite(way), np.clip(way, -since, until), 0.0)  # none at an end
    guess = value + 0.5 * np.where(way == 0.0, 0.0, slope) * way
    top = np.full(len(values), -np.inf)
    np.maximum.at(top, which, guess)
    range_of_all = values.max(axis=1) - values.min(axis=1)
    some = guess >= (top - _CLOSE * range_of_all)[which]
    return which[some], place[some], (times[place] + way)[some]
