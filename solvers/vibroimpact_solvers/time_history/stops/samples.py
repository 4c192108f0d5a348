"""Histories of motions with stops of finite stiffness, and their errors."""

from __future__ import annotations

from typing import Any

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.kernels.contact_phases import SAMPLED
from vibroimpact_solvers.kernels.stopped_scenes import LOADED, OPEN
from vibroimpact_solvers.time_history.problem import MOVED, Problem
from vibroimpact_solvers.time_history.stops.configurations import StoppedStructure
from vibroimpact_solvers.time_history.stops.scenes import Scene

_ROUNDED = 8.0  # roundings of an output
_LARGEST = 1e150  # of deviations
LEAST = 5e-324
"""No error is zero where anything moved."""


class Samples:
    """Outputs at the output times, filled in as the motion goes on.

    Parameters
    ----------
    structure : StoppedStructure
    problem : Problem

    Attributes
    ----------
    values : dict
        The outputs that are asked for, `x`, `v`, `a`, `energy` and `force`, and `error_` and their
        names where errors are estimated.
    """

    def __init__(self, structure: StoppedStructure, problem: Problem) -> None:
        self._structure, self._problem = structure, problem
        self._dofs = problem.output_dofs
        count, stops = problem.times.size, len(structure.rows)
        shapes = {
            "x": (count, self._dofs.size),
            "v": (count, self._dofs.size),
            "a": (count, self._dofs.size),
            "energy": (count,),
            "force": (count, stops),
        }
        size = self._dofs.size
        self._history = [
            (name, slice(place * size, (place + 1) * size))
            for place, name in enumerate(MOVED)
            if name in problem.outputs
        ]
        self.values: dict[str, Any] = {}
        for name in shapes.keys() & problem.outputs:
            self.values[name] = np.empty(shapes[name])
            if problem.estimate:
                self.values[f"error_{name}"] = np.empty(shapes[name])

    def take(self, scene: Scene, rows: Any, states: Floats, spreads: Floats) -> None:
        """Take the states of some output times, and the sizes of their deviations.

        Parameters
        ----------
        scene : Scene
        rows : slice or array of int
            Of the output times.
        states, spreads : array, shape (time, 2 pair)
        """
        outputs, sizes = self._problem.outputs, None
        if self._problem.estimate:
            # Beyond the horizon deviations grow without bound.
            sizes = np.fmin(spreads, _LARGEST)
            sizes *= SAMPLED * EPS
            sizes += (_ROUNDED * EPS) * np.abs(states)
            if scene.placed.mixing is not None:
                pairs = states.reshape(len(states), 2, -1)
                missed = np.broadcast_to(scene.placed.mixed(pairs), pairs.shape)
                sizes += missed.reshape(states.shape)
        if self._history:
            forms = scene.history_forms(self._dofs, self._structure.scale)
            values = states @ forms.values.T
            values += forms.offset
            errors = None
            if sizes is not None:
                errors = sizes @ forms.sizes.T
                errors += _ROUNDED * EPS * forms.terms
            for name, part in self._history:
                self.values[name][rows] = values[:, part]
                if errors is not None:
                    self.values[f"error_{name}"][rows] = np.maximum(errors[:, part], LEAST)
        if "energy" in outputs:
            self._take_energies(scene, rows, states.reshape(len(states), 2, -1), sizes)
        if "force" in outputs:
            self._take_forces(scene, rows, states, sizes)

    def _indentations(self, scene: Scene, states: Floats) -> Floats:
        """Return how far coordinates are beyond walls, 0 of open stops, (time, constraint)."""
        structure, placed = self._structure, scene.placed
        forms = scene.kernel.watched.coordinate[: len(scene.states)]
        moved = states.reshape(len(states), -1) @ forms.reshape(len(forms), -1).T
        beyond = np.zeros(moved.shape)
        for a, code in enumerate(scene.states):
            side = 1 if code > 0 else -1
            if abs(code) == LOADED:
                beyond[:, a] = side * moved[:, a] + placed.indentations[a]
            elif code != OPEN:
                beyond[:, a] = side * (moved[:, a] + placed.levels[a]) - structure.wall(a, side)
        return beyond

    def _take_energies(self, scene: Scene, rows: Any, states: Floats, flat: Floats | None) -> None:
        """Take the energies of the structure, of its constant load and of indented stops."""
        structure, basis, placed = self._structure, scene.basis, scene.placed
        free = structure.structure.configuration().basis.modes
        q, rate = basis.coordinates(states)
        u = (q + basis.still) @ placed.vectors.T + placed.origin
        speed = structure.scale * (rate @ placed.vectors.T)
        stiffness = structure.eigenvalues.astype(np.float64)
        push = stiffness * u - free.load
        beyond, k = self._indentations(scene, states), structure.stiffness
        kinetic = 0.5 * (speed**2).sum(axis=1)
        elastic = (u * (0.5 * stiffness * u - free.load)).sum(axis=1)
        energies = kinetic + elastic + 0.5 * (beyond**2 @ k)
        series = structure.series.flexibility
        if series is not None:
            force = k * beyond * np.sign([*scene.states])
            energies += 0.5 * ((force @ series) * force).sum(axis=1)
        self.values["energy"][rows] = energies
        if flat is None:
            return
        count = len(placed.vectors)
        du = flat @ np.abs(basis.displacement(placed.vectors)).reshape(count, -1).T
        dv = flat @ np.abs(basis.velocity(placed.vectors)).reshape(count, -1).T * structure.scale
        du = du + _ROUNDED * EPS * (np.abs(placed.vectors) @ placed.terms)
        forms = np.abs(scene.kernel.watched.coordinate[: len(scene.states)])
        dy = flat @ forms.reshape(len(forms), -1).T
        error = (np.abs(push) * du + 0.5 * np.abs(stiffness) * du**2).sum(axis=1)
        error += (np.abs(speed) * dv + 0.5 * dv**2).sum(axis=1)
        error += (k * (np.abs(beyond) + 0.5 * dy) * dy * (beyond != 0.0)).sum(axis=1)
        if series is not None:
            more = np.abs(series) @ (k * dy * (beyond != 0.0)).T
            error += ((np.abs(force) + 0.5 * k * dy).T * more).sum(axis=0)
        terms = kinetic + np.abs(u * (0.5 * stiffness * u - free.load)).sum(axis=1)
        self.values["error_energy"][rows] = error + _ROUNDED * EPS * terms + LEAST

    def _take_forces(self, scene: Scene, rows: Any, states: Floats, sizes: Floats | None) -> None:
        """Take the forces of stops, zero of those that are not loaded."""
        force = np.zeros((len(states), len(scene.states)))
        error = np.zeros_like(force)
        for a, code in enumerate(scene.states):
            if abs(code) != LOADED:
                continue
            form, level = scene.force_form(a)
            force[:, a] = np.maximum(states @ form.ravel() + level, 0.0)
            if sizes is not None:
                size = abs(level) + float(scene.kernel.walls["size"][scene.force_place(a)])
                error[:, a] = sizes @ np.abs(form).ravel() + _ROUNDED * EPS * size
        self.values["force"][rows] = force
        if sizes is not None:
            self.values["error_force"][rows] = error
