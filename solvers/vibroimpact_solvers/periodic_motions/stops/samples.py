"""Parts of solutions at the nodes of a quadrature, and their peaks between the nodes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Floats, Integers
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.stops import prescribed
from vibroimpact_solvers.periodic_motions.stops.parts import LONG, Nodes, Part, lengths

_CLOSE: Final = 2e-3
"""Part of a form's range by which parabolas through nodes, a quarter of a radian apart, are off."""
_NEWTON: Final = 6
_STILL: Final = 1e-8  # of the way between nodes, whose square is below rounding


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
        decay = np.exp(np.clip(times * part.side.growth[left], -LONG, LONG))
        return np.asarray((decay * sizes) @ lengths(form)[:, left].T)

    def peaks(
        self, form: Floats, level: Floats, seen: Floats, shift: Complexes | None = None
    ) -> Floats:
        """Return the largest values of forms, seen at the nodes (time, form) as they are, (form,).

        Newton's method climbs all peaks between nodes that may be the highest. Amplitudes of a
        shift, (harmonic, form), are added to the forms.
        """
        part, values = self.part, np.ascontiguousarray(seen.T)
        best = values.max(axis=1)
        which, place, at = _climbed(self.nodes.times, values)
        times = self.nodes.times
        first, last = times[np.maximum(place - 1, 0)], times[np.minimum(place + 1, times.size - 1)]
        swing = np.zeros((part.rates.size, len(form))) if shift is None else shift
        form, level, swing = form[which], level[which], swing[:, which]
        slope = prescribed.drift(part.side, np.arange(form.shape[1]), form, form=True)
        # The steady response turns at its own rates: its second derivative is not the form's.
        rates = 1j * part.rates[:, np.newaxis]
        more = (rates * (rates * (part.steady @ form.T + swing) - part.steady @ slope.T)).T
        there, moving = swing.T, (rates * swing).T
        for _ in range(_NEWTON):
            state, moved = part.both(at)
            turned = np.exp(1j * at[:, np.newaxis] * part.rates)
            value = (state * form).sum(axis=1) + level + (turned * there).real.sum(axis=1)
            rate = (moved * form).sum(axis=1) + (turned * moving).real.sum(axis=1)
            bend = (moved * slope).sum(axis=1) + (turned * more).real.sum(axis=1)
            np.fmax.at(best, which, value)
            with np.errstate(divide="ignore", invalid="ignore"):
                way = np.where(bend < 0.0, -rate / bend, 0.0)
            before, at = at, np.clip(at + np.where(np.isfinite(way), way, 0.0), first, last)
            if not (np.abs(at - before) > _STILL * (last - first)).any():
                break
        return np.asarray(best)


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
