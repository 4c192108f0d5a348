"""What parameters change in the equations of a motion: sources between impacts, walls, impulses.

In the coordinates q of the natural modes E of the structure as it is, ``x = E q``,

    (1 + dB) q'' + (D + dD) q' + (L + dA) q = f + df ,    dA = E^T dK E , dB = E^T dM E , … ,

so that modes need no rates of their own, and equal frequencies are no special case: the rates of q
obey the undisturbed equations with the source ``df - dA q - dD q' - dB q''``. The mobility of a
coordinate ``y = r q``, and the velocities by a unit impulse on it, change by ``-r dB r`` and
``-dB r``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.derivatives import MatrixRate, Parameter, touched
from vibroimpact_solvers.kernels.parameter_motion import SHORT, Changes, Sources
from vibroimpact_solvers.time_history.structure import Configuration, Structure

_PRODUCTS: Final = 4.0
"""Products of numbers of a parameter's sources, for each pair, up to which integrals in closed form
cost less than long Gauss sums."""
_FEW_PRODUCTS: Final = 2.0
"""The same, of short ones."""
_List = tuple[Integers, Integers, Floats]
"""Rows of numbers without their zeros: where rows begin, places and values."""


@dataclass(frozen=True, eq=False, slots=True)
class Form:
    """A symmetric form ``R^T S R`` of the modal coordinates, and a diagonal besides."""

    diagonal: Floats  # (mode,), or none
    rows: Floats  # R, (row, mode)
    inner: Floats  # S R, (row, mode)

    @classmethod
    def of(cls, rate: MatrixRate, shapes: Floats, diagonal: Floats) -> Form:
        """Return the form of the rate of a matrix, which itself is diagonal."""
        rows = inner = np.zeros((0, shapes.shape[1]))
        if rate.entries is not None:
            places, block = touched(rate.entries)
            rows = shapes[places]
            inner = block @ rows
        return cls(rate.factor * diagonal if rate.factor else np.zeros(0), rows, inner)

    def terms(self) -> tuple[Floats, Floats]:
        """Return rows a and b, each (term, mode), of which the form is the sum of ``a^T b``."""
        if not self.diagonal.size:
            return self.rows, self.inner
        moved = np.flatnonzero(self.diagonal)
        unit = np.eye(self.diagonal.size)[moved]
        scaled = self.diagonal[moved, np.newaxis] * unit
        return np.concatenate([self.rows, unit]), np.concatenate([self.inner, scaled])

    def at(self, q: Floats) -> Floats:
        """Return its values at coordinates of shape (…, mode)."""
        value = ((q @ self.rows.T) * (q @ self.inner.T)).sum(axis=-1)
        return np.asarray(value + (q**2 @ self.diagonal if self.diagonal.size else 0.0))

    def times(self, q: Floats) -> Floats:
        """Return its product with rows of coordinates, shape (…, mode)."""
        product = (q @ self.inner.T) @ self.rows
        return np.asarray(product + (q * self.diagonal if self.diagonal.size else 0.0))


@dataclass(frozen=True, eq=False, slots=True)
class Terms:
    """What one parameter changes, in modal coordinates and the time of x."""

    K: Form
    M: Form
    force: Floats  # (mode,): of the constant load
    start: Floats  # (2, pair): of the state at t = 0


def of(structure: Structure, parameter: Parameter) -> Terms:
    """Return what a parameter changes."""
    configuration = structure.configuration()
    basis = configuration.basis
    shapes = basis.modes.shapes
    roots = basis.modes.roots * (1.0 + basis.modes.rests)
    K = Form.of(parameter.K, shapes, roots * np.abs(roots))
    M = Form.of(parameter.M, shapes, np.ones(roots.size))
    force = np.zeros(roots.size) if parameter.force is None else parameter.force @ shapes
    for load in parameter.loads:
        if load.frequency == 0.0:
            force = force + load.steady_cosine * shapes[load.dof]
    start = np.zeros((2, basis.pairs))
    if parameter.x is not None or parameter.v is not None:
        none = np.zeros(structure.system.n)
        x = none if parameter.x is None else parameter.x
        v = none if parameter.v is None else parameter.v
        start = structure.state_of(configuration, x, v / structure.scale)
    return Terms(K, M, force, start)


@dataclass(frozen=True, eq=False, slots=True)
class _Rows:
    """Sources of one parameter, a row each: forms, constants and directions of the state."""

    forms: Floats  # (row, 2, pair)
    constants: Floats  # (row,)
    directions: Floats  # (row, 2, pair)
    by_time: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class Bend:
    """What one parameter adds to the second rates of the coordinates, in the time of the basis."""

    rows: tuple[_Rows, ...]
    rates: tuple[Floats, ...]  # (row, mode) each: accelerations by the directions

    @classmethod
    def of(cls, structure: Structure, parameter: Parameter, terms: Terms) -> Bend:
        """Return that of a parameter."""
        basis = structure.configuration().basis
        every = tuple(each for each in _sources(structure, parameter, terms) if each.constants.size)
        return cls(every, tuple(basis.coordinates(each.directions)[1] for each in every))

    def at(self, times: Floats, states: Floats) -> tuple[Floats, Floats]:
        """Return it at states, (sample, mode), and the sums of the magnitudes of its terms.

        Parameters
        ----------
        times : array, shape (sample,)
        states : array, shape (sample, 2, pair)
            Of the motion.
        """
        flat = states.reshape(len(states), -1)
        total, size = np.zeros((2, len(states), self._modes(states)))
        for rows, rates in zip(self.rows, self.rates, strict=True):
            forms = rows.forms.reshape(len(rows.forms), -1)
            value = flat @ forms.T + rows.constants
            each = np.abs(flat) @ np.abs(forms.T) + np.abs(rows.constants)
            if rows.by_time:
                value, each = value * times[:, np.newaxis], each * times[:, np.newaxis]
            total += value @ rates
            size += each @ np.abs(rates)
        return total, size

    def _modes(self, states: Floats) -> int:
        return self.rates[0].shape[1] if self.rates else 1


def sources(
    structure: Structure, parameters: Sequence[Parameter], terms: Sequence[Terms]
) -> Sources:
    """Return the sources of the rates, in the time of the basis."""
    flow = structure.configuration().basis.flow
    lists = [
        [rows for rows in _sources(structure, *pair) if rows.constants.size]
        for pair in zip(parameters, terms, strict=True)
    ]
    every = [rows for each in lists for rows in each]
    counts = [sum(rows.constants.size for rows in each) for each in lists]
    pairs = [np.moveaxis(rows.forms, 1, 2) for rows in every]
    form = _listed(pairs, np.zeros((0, 2)))
    flat = [rows.directions.reshape(len(rows.directions), -1) for rows in every]
    direction = _listed(flat, np.zeros(0))
    closed_from = _closed_from(structure, counts, form, direction)
    return Sources(
        _starts(counts),
        *form,
        *direction,
        np.concatenate([np.zeros(0), *(rows.constants for rows in every)]),
        np.concatenate(
            [np.zeros(0, bool), *(np.full(rows.constants.size, rows.by_time) for rows in every)]
        ),
        float((np.abs(flow.alpha) + flow.nu).max(initial=0.0)),
        closed_from,
        float(closed_from.max(initial=0.0)),
    )


def _closed_from(
    structure: Structure, counts: Sequence[int], form: _List, direction: _List
) -> Floats:
    """Return from how many radians on integrals of each parameter are in closed form."""
    flow = structure.configuration().basis.flow
    radians = np.where(np.array(counts) > 0, np.inf, 0.0)
    if flow.drives.size:
        return radians
    products = np.diff(form[0]) * np.diff(direction[0])
    first = 0
    for p, count in enumerate(counts):
        some = slice(first, first + count)
        named = [
            places[starts[first] : starts[first + count]] for starts, places, _ in (form, direction)
        ]
        if all((each % flow.nu.size < flow.rotations).all() for each in named):
            each = products[some].sum() / flow.nu.size
            radians[p] = 0.0 if each <= _FEW_PRODUCTS else SHORT if each <= _PRODUCTS else np.inf
        first += count
    return radians


def _sources(structure: Structure, parameter: Parameter, terms: Terms) -> Iterator[_Rows]:
    basis = structure.configuration().basis
    unit = 1.0 / structure.scale
    if parameter.K:
        a, b = terms.K.terms()
        yield _Rows(basis.displacement(b), b @ basis.still, basis.kick(-(unit**2) * a))
    if parameter.M:
        a, b = terms.M.terms()
        velocity = basis.velocity(b)
        pushed = velocity[:, 1] @ basis.push
        yield _Rows(basis.rates_of(velocity), pushed, basis.kick(-a))
    if parameter.C:
        yield from _dampings(structure, parameter)
    if terms.force.any():
        direction = basis.kick(unit**2 * terms.force[np.newaxis])
        yield _Rows(np.zeros_like(direction), np.ones(1), direction)
    yield from _loads(structure, parameter)


def _dampings(structure: Structure, parameter: Parameter) -> Iterator[_Rows]:
    """Yield the sources by the damping."""
    modes = structure.configuration().basis.modes
    damping = np.zeros(modes.roots.size) if modes.damping is None else modes.damping.diagonal()
    if parameter.C.factor and modes.damping is not None:
        coupled = parameter.C.factor * (modes.damping - np.diag(damping))
        some = np.flatnonzero(coupled.any(axis=1))
        yield _damped(structure, np.eye(damping.size)[some], coupled[some])
    yield _damped(structure, *Form.of(parameter.C, modes.shapes, damping).terms())


def _damped(structure: Structure, a: Floats, b: Floats) -> _Rows:
    basis = structure.configuration().basis
    return _Rows(basis.velocity(b), np.zeros(len(b)), basis.kick(-a / structure.scale))


def _loads(structure: Structure, parameter: Parameter) -> Iterator[_Rows]:
    """Yield the sources by loads that vary."""
    basis = structure.configuration().basis
    modes, unit = basis.modes, 1.0 / structure.scale
    none = np.zeros((1, modes.ramps.shape[1]))
    for load in parameter.loads:
        direction = basis.kick(unit**2 * modes.shapes[[load.dof]])
        if load.frequency == 0.0:
            if load.cosine:
                slope = np.array([unit * load.cosine])
                yield _Rows(np.zeros_like(direction), slope, direction, by_time=True)
            continue
        cosine, sine = np.zeros((2, 1, modes.frequencies.size))
        k = int(np.searchsorted(modes.frequencies, load.frequency))
        for c, s, grows in (
            (load.steady_cosine, load.steady_sine, False),
            (unit * load.cosine, unit * load.sine, True),
        ):
            if c or s:
                cosine[0, k], sine[0, k] = c, s
                form = basis.load(cosine, sine, none)
                yield _Rows(form, np.zeros(1), direction, by_time=grows)


def changes(
    structure: Structure, parameters: Sequence[Parameter], terms: Sequence[Terms]
) -> Changes:
    """Return the rates of the stops, in the time of the basis."""
    configuration = structure.configuration()
    basis, count = configuration.basis, len(structure.W)
    rows = structure.W @ basis.modes.shapes
    counts, parts = list[int](), list[tuple[Floats, ...]]()
    for parameter, each in zip(parameters, terms, strict=True):
        given = parameter.directions(structure.system.n, range(count))
        turned = given @ basis.modes.shapes
        less = each.M.times(rows)
        lower, upper = parameter.walls(range(count))
        bounce = np.zeros(count)
        for stop in parameter.stops:
            bounce[stop.constraint] += stop.restitution
        mobility = (rows * (2.0 * turned - less)).sum(axis=1)
        some = np.flatnonzero(
            (lower != 0.0) | (upper != 0.0) | (bounce != 0.0) | (turned - less).any(axis=1)
        )
        counts.append(some.size)
        parts.append((
            some.astype(np.float64), -lower[some], upper[some],
            _factor_rates(configuration, bounce, mobility)[some],
            turned[some], (turned - less)[some],
        ))  # fmt: skip
    index, lower, upper, factor, turned, kicked = (
        np.concatenate(each) for each in zip(*parts, strict=True)
    )
    moving = turned.any() or kicked.any()
    turned, kicked = (each if moving else each[:0] for each in (turned, kicked))
    level = basis.level(turned) if moving else np.zeros(index.size)
    return Changes(
        _starts(counts), index.astype(np.int64), np.stack([lower, upper]), factor, level,
        basis.displacement(turned), basis.velocity(turned), basis.kick(kicked),
    )  # fmt: skip


def _factor_rates(configuration: Configuration, bounce: Floats, mobility: Floats) -> Floats:
    """Return the rates of ``(1 + restitution)/mobility``, shape (constraint,)."""
    own = np.asarray(configuration.changes, dtype=np.float64)
    factor = configuration.kernel.walls["factor"][: own.size]
    over = np.divide(1.0, own, out=np.zeros(own.size), where=own > 0.0)
    return np.asarray((bounce - factor * mobility) * over)


def _starts(counts: Sequence[int]) -> Integers:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def _listed(parts: Sequence[Floats], none: Floats) -> _List:
    """Return rows of numbers, or of several each, without zeros; none are no numbers."""
    starts, places, values = [np.zeros(1, np.int64)], [np.zeros(0, np.int64)], [none]
    count = 0
    for part in parts:
        row, place = np.nonzero(part if part.ndim == 2 else part.any(axis=2))
        ends = np.cumsum(np.bincount(row, minlength=len(part)))
        starts.append((count + ends).astype(np.int64))
        places.append(place.astype(np.int64))
        values.append(part[row, place])
        count += row.size
    return np.concatenate(starts), np.concatenate(places), np.concatenate(values)
