"""The set of motions that a motion in extended precision encloses.

All of them are ``z + G r``, with the centre z, a matrix G of doubles, and ``|r_j| <= 1``: a
zonotope. A map whose derivative is within some errors of J anywhere in the set takes it to
``f(z) + J G r``, so that deviations grow as the motion lets them; each rounding and error is
bounded and added in columns of its own. When there are too many columns, those that matter least
are replaced by the box around them (A. Girard, Reachability of uncertain linear systems using
zonotopes, 2005).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import flint
import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.time_history.extended.precision import Real, above

_EPS: Final = 2.0**-52
_SURE: Final = 1.0 + 1e-12
_COLUMNS: Final = 8
"""Most columns per coordinate,"""
_FEWEST: Final = 192
"""and of few coordinates."""
_SQUARINGS: Final = 3
_ORDER: Final = 14


class Enclosure:
    """Deviations from the centre of a motion, in the size of its states.

    Parameters
    ----------
    radii : sequence of arb
        Of the coordinates at the beginning.
    """

    def __init__(self, radii: Sequence[Real]) -> None:
        self._unit = flint.arb(2) ** (-flint.ctx.prec)
        self._G = np.diag(self._in_units(radii))

    def _in_units(self, radii: Sequence[Real]) -> Floats:
        return np.array([above(radius / self._unit) for radius in radii])

    def _sums(self) -> Floats:
        return np.asarray(np.abs(self._G).sum(axis=1) * _SURE)

    @property
    def box(self) -> list[Real]:
        """Bounds of the deviations of all coordinates."""
        return [self._unit * flint.arb(r) for r in self._sums().tolist()]

    @property
    def size(self) -> Real:
        """A bound of the size of all deviations."""
        return self._unit * flint.arb(float(np.linalg.norm(self._sums())) * _SURE)

    def map(self, J: Floats, errors: Floats, radii: Sequence[Real]) -> None:
        """Apply a map to all motions.

        Parameters
        ----------
        J, errors : array, shape (coordinate after, coordinate before)
            The derivative is within these errors of it.
        radii : sequence of arb
            Of the image of the centre.
        """
        rounding = 2.0 * max(J.shape) * _EPS
        off = (rounding * np.abs(J) + errors) @ self._sums() * _SURE + self._in_units(radii)
        G, n = J @ self._G, len(J)
        most = max(_COLUMNS * n, _FEWEST)
        if G.shape[1] > most - n:
            sizes = np.abs(G)
            felt = (sizes / np.maximum(sizes.sum(axis=1) + off, 1e-300)[:, np.newaxis]).max(axis=0)
            order = np.argsort(felt)
            kept = most * 3 // 4
            off += sizes[:, order[:-kept]].sum(axis=1) * _SURE
            G = G[:, order[-kept:]]
        G = np.hstack([G, np.diag(off * _SURE)])
        exponent = max(0, math.frexp(float(np.abs(G).max(initial=0.0)))[1])
        self._G = np.ldexp(G, -exponent) + np.copysign(1e-300, G) * (G != 0.0)
        self._unit *= flint.arb(2) ** exponent


def flow(A: Floats, time: float) -> tuple[Floats, Floats]:
    """Return ``exp(A time)`` for ``|A| time <= 4``, and bounds of its errors.

    Series for an eighth of the time and three squarings round by less than ``200 (n + 2) 2^-52``
    of the same sums of magnitudes, which are ``exp(|A| time)``; what the series leave out is next
    to nothing.
    """
    part, whole = A * (time * 2.0**-_SQUARINGS), np.eye(len(A))
    sums = [whole, whole]
    for k in range(_ORDER, 0, -1):
        sums = [whole + P @ E / k for P, E in zip((part, np.abs(part)), sums, strict=True)]
    for _ in range(_SQUARINGS):
        sums = [E @ E for E in sums]
    left_out = 2e3 * float(np.abs(part).sum(axis=1).max()) ** (_ORDER + 1) / math.factorial(_ORDER)
    return sums[0], sums[1] * (200.0 * (len(A) + 2) * _EPS) + left_out
