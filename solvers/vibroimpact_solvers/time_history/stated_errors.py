"""Absolute errors of the outputs of a motion, from the estimated error of its state.

The state is known to a length E in the measure of its deviations (`kernels.deviations`). What is
linear in the state is known to E times the length of its form, its *reach*. An impact is earlier or
later by what its coordinate is off, over its speed:

    dt = 2 dy / (v + (v^2 - 2 a dy)^(1/2)) ,    dv = dv_state + a dt ,

a being a bound of the acceleration, and in dv that of the impact and what dt makes of it. Where the
root is not real the impact may be missing: its time is not known, and its speed by
``(v^2 + 2 a dy)^(1/2)`` at most.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from copy import copy
from functools import cached_property
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.kernels.output_errors import impact_errors, state_errors
from vibroimpact_solvers.kernels.rigid_state import Rows
from vibroimpact_solvers.time_history.basis import Basis
from vibroimpact_solvers.time_history.problem import STATES, Problem, tolerance_of
from vibroimpact_solvers.time_history.structure import Configuration, Structure

_NUMBERS: Final = 2**15  # of forms at a time: more would leave the cache of a core
_KEPT: Final = 8  # reaches of a configuration, for as many choices of degrees of freedom
_SUMMED: Final = 8.0  # roundings of the terms of the energy and of constant accelerations
LEAST: Final = 1e-300  # reach of what does not move, so that unknown errors stay unknown
OF_IMPACTS: Final = tuple(f"error_impact_{name}" for name in ("time", "velocity", "impulse"))


class Reach:
    """What a unit error of the state makes of the outputs, in one contact configuration.

    It does not depend on where walls are, and does not hold the structure: configurations that
    differ in their walls share it.

    Parameters
    ----------
    structure : Structure
    configuration : Configuration
    dofs : array of int
        Degrees of freedom of the history.
    """

    def __init__(self, structure: Structure, configuration: Configuration, dofs: Integers) -> None:
        self._basis, self._dofs = configuration.basis, dofs
        self._rows = structure.W @ configuration.basis.modes.shapes
        self._scale, self._ramps = structure.scale, structure.ramps
        self._level = structure.level_energy(configuration)

    @cached_property
    def history(self) -> Floats:
        """Of displacements and velocities, shape (2, dof)."""
        return self._in_parts(self._of, 2)

    @cached_property
    def bend(self) -> Floats:
        """Of accelerations, and the sizes of their constant parts, shape (2, dof)."""
        return self._in_parts(self._bend_of, 2)

    @cached_property
    def base(self) -> Floats:
        """Roundings of what displacements are counted from, shape (dof,)."""
        return np.asarray(EPS * np.abs(self._basis.modes.base[self._dofs]))

    @cached_property
    def coordinates(self) -> Floats:
        """Of the constrained coordinates, their velocities and accelerations, (3, constraint)."""
        return np.concatenate([self._of(self._rows), self._bend_of(self._rows)[:1]])

    @cached_property
    def fastest(self) -> float:
        """How fast accelerations change, relative to their bounds."""
        basis, times = self._basis, self._ramps.times
        rate = self._scale * float(np.hypot(basis.alpha, basis.nu).max(initial=0.0))
        # A load changes from one bound to the other between two samples.
        return max(rate, 2.0 / float(np.diff(times).min())) if times.size else rate

    @cached_property
    def impacts(self) -> Floats:
        """Of the constrained coordinates and loads on them, shape (4, constraint)."""
        return np.stack([*self.coordinates, self._push])

    @property
    def _push(self) -> Floats:
        """Largest accelerations of the constrained coordinates by loads, shape (constraint,)."""
        modes, ramps, rows = self._basis.modes, self._ramps, self._rows
        push = np.abs(rows @ modes.load)
        push += np.hypot(rows @ modes.cosine, rows @ modes.sine).sum(axis=1)
        highest = np.abs(ramps.values).max(axis=0, initial=0.0)
        return np.asarray(push + np.abs(rows @ modes.ramps) @ highest)

    @cached_property
    def energy(self) -> Floats:
        """Of the energy: a bound of its square form, of its linear one, and its level."""
        basis, modes, scale = self._basis, self._basis.modes, self._scale
        stiff = np.sqrt(np.abs(modes.roots * np.abs(modes.roots))) / scale
        one = basis.place >= 0
        # Of a mode that is a pair: the rate is z2 - delta q, and z1 its coordinate times stretch.
        unit = basis.grain[basis.place[one]] / basis.stretch[one]
        drag, spring = (part[one] * unit for part in (basis.delta, stiff))
        trace = drag**2 + spring**2 + 1.0
        square = 0.5 * (trace + np.sqrt((trace - 2.0) ** 2 + 4.0 * drag**2))
        largest = float(square.max(initial=1.0))
        others = np.flatnonzero(~one)
        if others.size:
            rows = np.eye(one.size)[others]
            springs = stiff[others, np.newaxis, np.newaxis] * basis.displacement(rows)
            forms = np.concatenate([basis.velocity(rows), springs]) * _unit(basis)
            sizes = np.abs(forms).reshape(len(forms), -1)
            # The square of the spectral norm is below that of the largest sums.
            largest = max(largest, float(sizes.sum(axis=0).max() * sizes.sum(axis=1).max()))
        linear = lengths(basis, basis.displacement(modes.load[np.newaxis]))
        return np.array([scale**2 * largest, linear[0], abs(self._level)])

    def _in_parts(self, of: Callable[[Floats], Floats], count: int) -> Floats:
        """Return what a function makes of the rows of the dofs, some at a time, (count, dof)."""
        shapes = self._basis.modes.shapes
        rows = max(1, _NUMBERS // max(1, shapes.shape[1]))
        parts = [of(shapes[self._dofs[some]]) for some in _parts(self._dofs.size, rows)]
        return np.concatenate(parts, axis=1) if parts else np.zeros((count, 0))

    def _bend_of(self, rows: Floats) -> Floats:
        """Return the reaches of ``rows . q''``, and the sizes of its constants, (2, row)."""
        basis, square = self._basis, self._scale**2
        velocity = basis.velocity(rows)
        pushed = np.abs(velocity[:, 1]) @ np.abs(basis.push)
        return square * np.stack([lengths(basis, basis.rates_of(velocity)), pushed])

    def _of(self, rows: Floats) -> Floats:
        """Return the reaches of ``rows . q`` and of its velocity, shape (2, row)."""
        basis = self._basis
        place, rate = basis.displacement(rows), basis.velocity(rows)
        speed = self._scale * lengths(basis, rate)
        return np.maximum([lengths(basis, place), speed], LEAST)


class StatedErrors:
    """Absolute errors of the outputs of motions with rigid limiters.

    Parameters
    ----------
    problem : Problem
    structure : Structure
    """

    def __init__(self, problem: Problem, structure: Structure) -> None:
        self._problem, self._structure = problem, structure
        self._reaches: list[Reach] = []

    def of(self, configurations: Iterable[Configuration]) -> StatedErrors:
        """Return those of motions that have been in some configurations."""
        errors = copy(self)
        errors._reaches = [self.reach(one) for one in configurations]
        return errors

    def reach(self, of: Configuration) -> Reach:
        """Return what a unit error of the state makes of the outputs in a configuration."""
        dofs = self._problem.output_dofs
        reach: Reach | None = of.reaches.get(dofs.tobytes())
        if reach is None:
            if len(of.reaches) >= _KEPT:
                of.reaches.clear()
            reach = of.reaches[dofs.tobytes()] = Reach(self._structure, of, dofs)
        return reach

    def history(self, lengths: Floats, a: Floats, largest: Floats, until: Floats) -> dict[str, Any]:
        """Return the errors of x, v, a and the energy, of motions, shape (motion, time, …).

        Parameters
        ----------
        lengths : array, shape (motion, time)
            Of the errors of the states, as in `kernels.rigid_state.History`.
        a : array, shape (motion, time, dof)
            The accelerations, if they are asked for: loads are no part of the states' sizes.
        largest, until : array, shape (motion,)
            `kernels.rigid_state.PROGRESS`: ``largest`` and ``known_until``.
        """
        outputs, times = self._problem.outputs, self._problem.times
        values = dict[str, Any]()
        if not outputs & STATES:
            return values
        state = np.empty(lengths.shape)
        ends = np.ascontiguousarray(largest), np.ascontiguousarray(until)
        state_errors(lengths, times, *ends, tolerance_of(self._problem), state)
        if outputs & {"x", "v"}:
            reaches = self._largest("history")
            for name, reach in zip(("x", "v"), reaches, strict=True):
                if name in outputs:
                    values[f"error_{name}"] = state[..., np.newaxis] * reach
        if "x" in outputs:
            values["error_x"] += self._largest("base")
        if "a" in outputs:
            reach, constant = self._largest("bend")
            values["error_a"] = state[..., np.newaxis] * np.maximum(reach, LEAST)
            values["error_a"] += _SUMMED * EPS * (constant + np.abs(a))
        if "energy" in outputs:
            square, linear, level = self._largest("energy").tolist()
            largest = largest[:, np.newaxis]
            rounded = _SUMMED * EPS * (square * largest**2 + linear * largest + level)
            known = np.where(np.isfinite(state), state, 0.0)
            energy = square * (largest + 0.5 * known) * known + linear * known + rounded
            values["error_energy"] = np.where(np.isfinite(state), energy, np.inf)
        return values

    def impacts(
        self, rows: Rows, counts: Integers, largest: Floats, until: Floats, gaps: Floats
    ) -> dict[str, Any]:
        """Return the errors of times, velocities and impulses of the impacts of motions.

        Parameters
        ----------
        rows : array of `kernels.rigid_state.IMPACT`
            The impacts of all motions, in the units of x.
        counts : array of int, shape (motion,)
        largest, until : array, shape (motion,)
            As in `history`.
        gaps : array, shape (motion,)
            Largest distances of coordinates from their walls at impacts.
        """
        ends = np.ascontiguousarray(largest), np.ascontiguousarray(until)
        motions = (*ends, np.ascontiguousarray(gaps))
        times, velocities, impulses = np.empty((len(OF_IMPACTS), rows.size))
        fastest = max(reach.fastest for reach in self._reaches)
        reaches = np.concatenate([self._largest("impacts"), self._walls])
        impact_errors(
            rows, counts, motions, tolerance_of(self._problem), reaches, fastest,
            (times, velocities, impulses),
        )  # fmt: skip
        return dict(zip(OF_IMPACTS, (times, velocities, impulses), strict=True))

    @cached_property
    def _walls(self) -> Floats:
        """Roundings of walls, and the masses that bounce there, shape (2, constraint)."""
        structure = self._structure
        walls = structure.configuration().kernel.walls
        mass = (1.0 + walls["restitution"]) / np.diagonal(structure.mobility)
        return np.stack([EPS * walls["size"], mass])

    def _largest(self, name: str) -> Floats:
        """Return the largest numbers of some name of all configurations."""
        every: list[Floats] = [getattr(reach, name) for reach in self._reaches]
        return np.asarray(np.maximum.reduce(every)) if len(every) > 1 else every[0]


def unknown_errors(problem: Problem) -> dict[str, Any]:
    """Return errors of a history that are not estimated."""
    outputs, times = problem.outputs, problem.times.size
    shape = times, problem.output_dofs.size
    values = {f"error_{name}": np.full(shape, np.nan) for name in ("x", "v") if name in outputs}
    return values | ({"error_energy": np.full(times, np.nan)} if "energy" in outputs else {})


def _unit(basis: Basis) -> Floats:
    """Return what pairs are by a unit of their measure, shape (2, pair); 0 of those of loads."""
    own = basis.own * (basis.measure > 0.0)
    return np.divide(1.0, np.sqrt(basis.measure), np.zeros(own.shape), where=own > 0.0)


def lengths(basis: Basis, forms: Floats) -> Floats:
    """Return the lengths of forms, shape (row,), by which they grow with the state."""
    return np.asarray(np.sqrt(np.square(forms * _unit(basis)).sum(axis=(1, 2))))


def _parts(count: int, each: int) -> Iterator[slice]:
    for start in range(0, count, each):
        yield slice(start, start + each)
