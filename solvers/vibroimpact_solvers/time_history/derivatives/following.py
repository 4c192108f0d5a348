"""Rates of a motion with its parameters, followed from impact to impact; and shaken ones.

The motion is followed again between its known impacts (`kernels.parameter_motion`), and once more
for each sample of errors, with every number that enters off by some roundings of random sign: the
initial state, frequencies, coordinates, walls, sources, and the state after each free motion. The
differences, divided by that number of roundings, are errors of the rates.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.derivatives import Parameter
from vibroimpact_solvers.kernels import parameter_motion as kernel
from vibroimpact_solvers.kernels.rigid_state import Rows
from vibroimpact_solvers.time_history.derivatives import terms as of_parameters
from vibroimpact_solvers.time_history.derivatives.terms import Terms
from vibroimpact_solvers.time_history.structure import Structure

SAMPLES: Final = 2
"""Shaken motions."""
SHAKEN: Final = 16.0
"""Roundings by which their numbers are off."""
_SAFETY: Final = 4.0
_BLOCK: Final = 2**21  # numbers of states at output times that are in memory at once
FACTOR: Final = _SAFETY / SHAKEN
"""What differences are multiplied by: errors do not exceed the product."""


@dataclass(frozen=True, eq=False, slots=True)
class Impacts:
    """The impacts of a motion that its rates pass through, in the time of the basis."""

    time: Floats
    constraint: Integers
    side: Integers

    @classmethod
    def of(cls, rows: Rows, scale: float) -> Impacts:
        """Take the columns of a table in the units of x."""
        return cls(
            rows["time"] * scale,
            np.ascontiguousarray(rows["constraint"]),
            np.ascontiguousarray(rows["side"]),
        )


@dataclass(eq=False, slots=True)
class Followed:
    """One motion with its rates: that of the problem, or a shaken one."""

    arguments: tuple[Any, ...]
    events: kernel.Events
    z: Floats
    progress: Any
    noise: float

    def states(self, times: Floats, room: kernel.Room, block: Floats) -> int:
        """Go on, and write states at output times as many as fit; return their number."""
        state = kernel.State(self.z, self.progress, times, block)
        flow, stops, sources, changes = self.arguments
        return kernel.follow(flow, stops, sources, changes, self.events, state, room, self.noise)


class Following:
    """The rates of one motion.

    Parameters
    ----------
    structure : Structure
    parameters : sequence of Parameter
    start : array, shape (2, pair)
        The state at t = 0.
    impacts : Impacts
    times : array, shape (sample,)
        Ascending output times, in the time of the basis.
    """

    def __init__(
        self,
        structure: Structure,
        parameters: Sequence[Parameter],
        start: Floats,
        impacts: Impacts,
        times: Floats,
    ) -> None:
        self._structure, self._times = structure, times
        self.terms: list[Terms] = [of_parameters.of(structure, each) for each in parameters]
        basis = structure.configuration().basis
        z = np.stack([start, *(each.start for each in self.terms)])
        given = structure.configuration().kernel
        watched, walls = given.watched, given.walls
        stops = kernel.Stops(
            watched.coordinate, watched.velocity, watched.kick, watched.kick_rate,
            np.stack([-walls["lower"], walls["upper"]]), walls["factor"].copy(),
        )  # fmt: skip
        sources = of_parameters.sources(structure, parameters, self.terms)
        changes = of_parameters.changes(structure, parameters, self.terms)
        self._count, self._impacts = len(parameters), impacts
        plain = basis.flow, stops, sources, changes
        sizes = _sizes(structure, z)  # before the state goes on
        self.motions = [self._followed(plain, z, 0.0)]
        for column in range(SAMPLES):
            shaken = _Shaken(structure, column)
            start = shaken.start(z, sizes)
            self.motions.append(self._followed(shaken.arguments(plain), start, SHAKEN))
        shape = 2, basis.pairs
        self._room = kernel.Room(
            np.empty(shape), np.empty((kernel.MANY, *shape)), np.empty(shape), np.empty(shape),
            np.empty(shape), np.empty((self._count, *shape)), _gauss(kernel.FEW),
            _gauss(kernel.MANY), basis.signs,
        )  # fmt: skip

    def _followed(self, arguments: tuple[Any, ...], z: Floats, noise: float) -> Followed:
        given = self._impacts
        rates = np.full((3, given.time.size, self._count), np.nan)
        events = kernel.Events(given.time, given.constraint, given.side, rates)
        return Followed(arguments, events, z, np.zeros(1, kernel.PROGRESS), noise)

    def blocks(self) -> Iterator[tuple[slice, list[Floats]]]:
        """Yield states at output times, (sample, 1 + parameter, 2, pair), of all motions.

        They end where no motion reaches the next impact.
        """
        shape = self.motions[0].z.shape
        each = max(1, _BLOCK // (len(self.motions) * int(np.prod(shape))))
        room = [np.empty((min(each, self._times.size), *shape)) for _ in self.motions]
        first = 0
        while True:
            written = min(
                one.states(self._times, self._room, block)
                for one, block in zip(self.motions, room, strict=True)
            )
            if written:
                yield slice(first, first + written), [block[:written] for block in room]
            first += written
            if written < each or first == self._times.size:
                return

    @property
    def passed(self) -> int:
        """How many impacts all motions have passed."""
        return min(int(one.progress["impact"][0]) for one in self.motions)


@lru_cache(maxsize=4)
def _gauss(count: int) -> Floats:
    """Return places in [0, 1] and weights of a Gauss sum, shape (2, node)."""
    places, weights = np.polynomial.legendre.leggauss(count)
    symmetric = 0.5 * (places - places[::-1])
    return np.stack([0.5 * (1.0 + symmetric), 0.5 * weights])


@lru_cache(maxsize=16)
def _drawn(column: int, count: int) -> Floats:
    """Return roundings of random sign, shape (count,); longer ones begin alike."""
    signs = np.random.default_rng(column).integers(0, 2, count, dtype=np.int64)
    drawn = (2.0 * signs - 1.0) * (SHAKEN * EPS)
    drawn.setflags(write=False)
    return np.asarray(drawn)


def _sizes(structure: Structure, z: Floats) -> Floats:
    """Return what a state and its rates at t = 0 are rounded relative to: their lengths."""
    basis = structure.configuration().basis
    own = basis.own
    carried = basis.whole(z, level=0.0) - own * z
    if len(basis.carried):
        carried[0] += basis.carried[0]
    squares = np.stack([basis.measure * own * z**2, basis.measure * carried**2])
    lengths = np.sqrt(squares.sum(axis=(2, 3))).sum(axis=0)
    each = 2.0 * lengths / np.sqrt(max(1.0, own.sum()))
    grain = np.stack([basis.grain, np.ones(basis.pairs)])
    known = np.maximum(basis.doubts[0], 1.0) * np.hypot(z[:, :1], z[:, 1:])
    return np.asarray(each[:, np.newaxis, np.newaxis] * own * grain + (1.0 - own) * known)


class _Shaken:
    """Numbers of a motion off by roundings of random sign."""

    def __init__(self, structure: Structure, column: int) -> None:
        self._structure, self._column, self._drawn = structure, column, 0

    def _signs(self, shape: tuple[int, ...]) -> Floats:
        """Return roundings of random sign; they go on from those that were taken last."""
        size = math.prod(shape)
        first, last = self._drawn, self._drawn + size
        signs = _drawn(self._column, 1 << max(10, last.bit_length()))
        self._drawn = last
        return signs[first:last].reshape(shape)

    def _off(self, values: Floats, by: float = 1.0) -> Floats:
        if not values.size:
            return values
        return np.asarray(values * (1.0 + by * self._signs(values.shape)))

    def arguments(
        self, plain: tuple[Any, kernel.Stops, kernel.Sources, kernel.Changes]
    ) -> tuple[Any, ...]:
        """Return the structure and its rates, off by roundings and by the errors of modes."""
        flow, stops, sources, changes = plain
        configuration = self._structure.configuration()
        basis, errors = configuration.basis, configuration.kernel.errors
        walls, size = configuration.kernel.walls, SHAKEN * EPS
        still = np.arange(flow.nu.size) >= flow.hyperbolas_end
        drifts = np.where(still, 0.0, errors.drifts[self._column])
        flow = flow._replace(nu=flow.nu + size * drifts, alpha=self._off(flow.alpha))
        kick = stops.kick + size * errors.kicks[self._column]
        stops = kernel.Stops(
            stops.coordinate + size * errors.coordinates[self._column],
            stops.velocity + size * errors.velocities[self._column],
            kick, basis.drift(kick), stops.walls + self._signs(stops.walls.shape) * walls["size"],
            self._off(stops.factor),
        )  # fmt: skip
        by = 2.0 * (1.0 + (basis.modes.shape_error + basis.vector_error) / EPS)
        sources = sources._replace(
            form_value=self._off(sources.form_value, by),
            direction_value=self._off(sources.direction_value, by),
            constant=self._off(sources.constant, by),
        )
        changes = changes._replace(
            factor=self._off(changes.factor, by), level=self._off(changes.level, by),
            coordinate=self._off(changes.coordinate, by),
            velocity=self._off(changes.velocity, by), kick=self._off(changes.kick, by),
        )  # fmt: skip
        return flow, stops, sources, changes

    def start(self, z: Floats, sizes: Floats) -> Floats:
        """Return the state and its rates at t = 0, off by roundings of these sizes."""
        basis = self._structure.configuration().basis
        own, still = basis.own, basis.doubts[1]
        off = self._signs(z.shape) * sizes
        if len(basis.carried):  # what loads carry too far is missing in what is free
            off -= basis.whole((1.0 - own) * off, level=0.0)
            off[0] += self._signs((1,)) * still * basis.carried[0]
        return np.asarray(z + off)
