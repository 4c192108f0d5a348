"""Waves of large structures at many frequencies: few natural modes, a series for all others.

The square frequencies are divided into cells. Around the middle sigma of a cell all natural
modes within a radius d, wider than the cell, are found and proved to be all (`spectrum.window`).
The others, at both sides, make a function that is smooth in the cell:

    (z M - K)^(-1) w = sum_j e_j (e_j . w)/(z - lambda_j)  +  sum_m (sigma - z)^m v_m,
    v_0 = (sigma M - K)^(-1) w',   v_(m+1) = (sigma M - K)^(-1) M v_m,
    w' = w - sum_j M e_j (e_j . w)

The first term of the series is the static correction of modal analysis taken at sigma, the
others its accelerations. As no mode that is left out is closer to sigma than d, what remains
after T terms is at most

    (|z - sigma|/d)^T / (d - |z - sigma|)  (w . M^(-1) w - sum_j (e_j . w)^2)

in magnitude. Factors, modes and series of a cell serve all frequencies and harmonics in it.
Cells depend on nothing but the structure, so that pieces of a job meet the same ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
import scipy.linalg

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.matrices import Solve
from vibroimpact_solvers.model import System
from vibroimpact_solvers.receptance.rows import Rows
from vibroimpact_solvers.receptance.waves import Response
from vibroimpact_solvers.spectrum import Count, Counter, Window

METHOD: Final = "partial"
"""What a plan calls it."""
MODES: Final = 15
"""Natural modes in a cell, if they were spread evenly over the square frequencies."""
EXACT: Final = 1e-20
"""Relative truncation where none is asked for: below rounding, large sums of weights included."""

_EPS = float(np.finfo(np.float64).eps)
_CROWD = 16 * MODES  # modes about a cell from which on it is halved
_DEEPEST = 16  # times that a cell is halved
_VAGUE = 0.1  # of the radius, that roundings of the factors may be worth
_MOST = 2000  # modes about one cell, where halving does not part them


@dataclass(frozen=True, slots=True)
class Reach:
    """How far about a cell natural modes are found, and how long the series is.

    Parameters
    ----------
    factor : int
        Radius over half the cell.
    terms : int
    """

    factor: int
    terms: int

    @classmethod
    def of(cls, tolerance: float | None) -> Reach:
        """Return the cheapest for a relative error of the impulses."""
        depth = EXACT if tolerance is None else max(EXACT, 1e-3 * tolerance)
        factor = 4 if depth < 1e-9 else 2
        return cls(factor, math.ceil(-math.log(depth) / math.log(factor)))


@dataclass(frozen=True, eq=False, slots=True)
class Cell:
    """What is known about waves in one cell; arrays per row are at the places looked at.

    Parameters
    ----------
    shift, radius : float
        Its middle, and the distance within which no natural mode is left out.
    eigenvalues : array, shape (mode,)
    seen : array, shape (constraint, mode)
        The modes found as the struck constraints see them.
    modes : array, shape (place, mode)
    powers : array, shape (term, place, constraint)
        ``radius^m v_m``.
    moments : array, shape (term, constraint, constraint)
        The same, seen by the constraints.
    rest : array, shape (constraint,)
        What the modes left out have of ``w . M^(-1) w``.
    doubt : float
        Absolute error of the eigenvalues.
    """

    shift: float
    radius: float
    eigenvalues: Floats
    seen: Floats
    modes: Floats
    powers: Floats
    moments: Floats
    rest: Floats
    doubt: float

    @property
    def nbytes(self) -> int:
        """Memory held."""
        arrays = (self.eigenvalues, self.seen, self.modes, self.powers, self.moments)
        return sum(array.nbytes for array in arrays)

    def weights(self, z: float) -> tuple[Floats, Floats]:
        """Return the factors of the modes and of the powers in a wave."""
        apart = z - self.eigenvalues
        # A frequency that is a natural one to the last bit; its neighbour is as good.
        apart[apart == 0.0] = _EPS * z
        steps = np.full(len(self.powers), (self.shift - z) / self.radius)
        steps[0] = 1.0
        return 1.0 / apart, np.cumprod(steps)

    def response(self, z: float) -> Response:
        """Return what the constraints feel."""
        near, series = self.weights(z)
        # Contraction term by term: roundings do not depend on what is computed beside.
        value = (self.seen * near) @ self.seen.T + np.tensordot(series, self.moments, 1)
        slope = (self.seen * near**2) @ self.seen.T
        m = np.arange(1, len(series))
        slope += np.tensordot(m * series[:-1] / self.radius, self.moments[1:], 1)
        away = abs(z - self.shift) / self.radius
        left = np.sqrt(np.outer(self.rest, self.rest)) / (self.radius * (1.0 - away))
        error = left * away ** len(series)
        weight = np.abs(self.seen) * near**2
        error += self.doubt * (weight @ np.abs(self.seen).T + left / (self.radius * (1.0 - away)))
        return Response(value, slope, error)


class ModalWaves:
    """Waves by cells.

    Parameters
    ----------
    system : System
    directions : array, shape (dof, constraint)
        ``W^T``.
    bound : float
        Upper bound of the natural frequencies.
    places : array of int
        Degrees of freedom at which rows are looked at, besides those of the constraints.
    reach : Reach
    """

    def __init__(
        self, system: System, directions: Floats, bound: float, places: Integers, reach: Reach
    ) -> None:
        self.system, self.directions, self.bound, self.reach = system, directions, bound, reach
        every = {dof for c in system.constraints for dof in c.dofs}
        self.places = np.array(sorted(every.union(places.tolist())), dtype=np.int64)
        self.size = size(system.n, bound)
        self._counter: Counter | None = None
        self._solve_mass: Solve = system.M.factorize()
        self._own = key(system, directions, self.places, reach)

    def rows(self, frequency: float, rows: Rows) -> Floats:
        """Return some rows of a wave, shape (row, constraint)."""
        z = frequency**2
        cell = self._cell(z)
        near, series = cell.weights(z)
        some = np.searchsorted(self.places, rows.dofs)
        picked = (cell.modes[some] * near) @ cell.seen.T
        picked += np.tensordot(series, cell.powers[:, some], 1)
        return rows.combined(picked)

    def response(self, frequency: float) -> Response:
        """Return what the constraints feel."""
        return self._cell(frequency**2).response(frequency**2)

    def natural(self, low: float, high: float) -> Floats:
        """Return all natural frequencies between two, ascending."""
        found, z = [np.empty(0)], low**2
        while z < high**2:
            cell, end = self._placed(z)
            found.append(cell.eigenvalues[(cell.eigenvalues >= z) & (cell.eigenvalues < end)])
            z = end
        roots = np.sqrt(np.sort(np.concatenate(found)))
        return np.asarray(roots[roots <= high])

    def _cell(self, z: float) -> Cell:
        return self._placed(z)[0]

    def _placed(self, z: float) -> tuple[Cell, float]:
        """Return the cell of a square frequency, and where it ends."""
        for level in range(_DEEPEST + 1):
            width = self.size / 2.0**level
            index = math.floor(z / width)
            index += (index + 1) * width <= z  # where the quotient was rounded down
            name = self._own + f"{level} {index}".encode()
            found: Cell | _Crowd = spectrum.CACHE.get(
                name, partial(self._make, (index + 0.5) * width, width, level)
            )
            if isinstance(found, Cell):
                return found, (index + 1) * width
        raise AssertionError("the finest cells are never crowded")

    def _make(self, shift: float, width: float, level: int) -> Cell | _Crowd:
        """Find the modes about a cell and the series of the others."""
        if self._counter is None:
            self._counter = Counter.of(self.system)
        radius = 0.5 * width * self.reach.factor
        low, high = self._counter.count(shift - radius), self._counter.count(shift + radius)
        if max(low.doubt, high.doubt) > _VAGUE * radius:
            message = f"roundings blur the natural modes around the frequency {math.sqrt(shift):g}"
            raise ConvergenceError(message)
        count = high.below - low.below
        if count > _CROWD and level < _DEEPEST:
            return _Crowd()
        if count > _MOST:
            message = f"{count} natural modes lie around the frequency {math.sqrt(shift):g}"
            raise ConvergenceError(message)
        sigma, solve = self._factors(shift, width)
        found = spectrum.window(self.system, low, high, sigma, solve, self._solve_mass)
        return self._expanded(found, sigma, _inner_radius(low, high, sigma), solve)

    def _factors(self, shift: float, width: float) -> tuple[float, Solve]:
        K, M = self.system.K, self.system.M
        for nudge in (0.0, 1e-3, -1e-3, 1e-2, -1e-2):
            sigma = shift + nudge * width
            try:
                return sigma, K.plus(-sigma, M).factorize()
            except scipy.linalg.LinAlgError:
                continue
        raise ConvergenceError(f"the structure cannot be factorized at {math.sqrt(shift):g}")

    def _expanded(self, found: Window, sigma: float, radius: float, solve: Solve) -> Cell:
        modes, M = found.modes, self.system.M
        heavy = M @ modes
        seen = self.directions.T @ modes
        vector = self._apart(-solve(self.directions - heavy @ seen.T), modes, heavy)
        powers = np.empty((self.reach.terms, self.places.size, seen.shape[0]))
        moments = np.empty((self.reach.terms, seen.shape[0], seen.shape[0]))
        for m in range(self.reach.terms):
            if m:
                vector = self._apart(-radius * solve(M @ vector), modes, heavy)
            powers[m] = vector[self.places]
            moments[m] = self.directions.T @ vector
        whole = np.diagonal(self.directions.T @ self._solve_mass(self.directions))
        rest = np.maximum(whole - (seen**2).sum(axis=1), 4.0 * _EPS * whole)
        doubt = max(float(found.doubt.max(initial=0.0)), 2.0 * _EPS * self.bound**2)
        picked = np.ascontiguousarray(modes[self.places])
        values = found.eigenvalues
        return Cell(sigma, radius, values, seen, picked, powers, moments, rest, doubt)

    @staticmethod
    def _apart(vectors: Floats, modes: Floats, heavy: Floats) -> Floats:
        """Return what is orthogonal to the modes: rounding brings them back, greatly enlarged."""
        return np.asarray(vectors - modes @ (heavy.T @ vectors))


@dataclass(frozen=True, slots=True)
class _Crowd:
    """Stands for a cell that is to be halved."""

    nbytes: int = 0


def touched(n: int, bound: float, frequencies: Floats) -> int:
    """Return how many cells some frequencies lie in, were none of them crowded."""
    return np.unique(np.floor(frequencies**2 / size(n, bound))).size


def size(n: int, bound: float) -> float:
    """Return the width of cells, as a square frequency."""
    return bound**2 * min(1.0, MODES / n)


def key(system: System, directions: Floats, places: Integers, reach: Reach) -> bytes:
    """Return the name under which cells are kept."""
    parts = (system.M.digest(), system.K.digest(), directions.tobytes(), places.tobytes())
    return b"cell" + b"".join(parts) + repr(reach).encode()


def _inner_radius(low: Count, high: Count, sigma: float) -> float:
    """Return the distance from the shift within which the counts prove that all is known."""
    return min(high.at - high.doubt - sigma, sigma - low.at - low.doubt)
