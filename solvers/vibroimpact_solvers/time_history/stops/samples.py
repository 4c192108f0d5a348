"""Histories of motions with stops of finite stiffness, and their errors."""

from __future__ import annotations

from typing import Any

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.kernels.contact_phases import SAMPLED
from vibroimpact_solvers.kernels.stopped_scenes import LOADED, OPEN
from vibroimpact_solvers.time_history.problem import Problem
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
        The outputs that are asked for, `x`, `v`, `energy` and `force`, and `error_` and their names
        where errors are estimated.
    """

    def __init__(self, structure: StoppedStructure, problem: Problem) -> None:
        self._structure, self._problem = structure, problem
        self._dofs = problem.output_dofs
        count, stops = problem.times.size, len(structure.rows)
        shapes = {
            "x": (count, self._dofs.size),
            "v": (count, self._dofs.size),
            "energy": (count,),
            "force": (count, stops),
        }
        self.values: dict[str, Any] = {}
        for name in shapes.keys() & problem.outputs:
            self.values[name] = np.empty(shapes[name])
            if problem.estimate:
                self.values[f"error_{name}"] = np.empty(shapes[name])

    def take(self, scene: Scene, rows: Integers, states: Floats, spreads: Floats) -> None:
        """Take the states of some output times, and the sizes of their deviations.

        Parameters
        ----------
        scene : Scene
        rows : array of int
            Of the output times.
        states, spreads : array, shape (time, 2, pair)
        """
        outputs = self._problem.outputs
        basis, modes = scene.basis, scene.basis.modes
        off = None
        if self._problem.estimate:
            # Beyond the horizon deviations grow without bound.
            off = SAMPLED * EPS * np.fmin(spreads, _LARGEST) + scene.placed.mixed(states)
        if outputs & {"x", "v"}:
            q, rate = basis.coordinates(states)
            shapes = modes.shapes[self._dofs]
            if "x" in outputs:
                self.values["x"][rows] = (q + basis.still) @ shapes.T + modes.base[self._dofs]
            if "v" in outputs:
                self.values["v"][rows] = self._structure.scale * (rate @ shapes.T)
            if off is not None:
                self._take_errors(scene, rows, states, off)
        if "energy" in outputs:
            self._take_energies(scene, rows, states, off)
        if "force" in outputs:
            self._take_forces(scene, rows, states, off)

    def _take_errors(self, scene: Scene, rows: Integers, states: Floats, off: Floats) -> None:
        basis, outputs = scene.basis, self._problem.outputs
        shapes = basis.modes.shapes[self._dofs]
        flat = (off + _ROUNDED * EPS * np.abs(states)).reshape(len(states), -1)
        for name, make, factor in (
            ("x", basis.displacement, 1.0),
            ("v", basis.velocity, self._structure.scale),
        ):
            if name in outputs:
                forms = np.abs(make(shapes)).reshape(len(shapes), -1)
                error = factor * (flat @ forms.T)
                if name == "x":
                    still = np.abs(shapes) @ scene.placed.terms
                    error += _ROUNDED * EPS * (still + np.abs(basis.modes.base[self._dofs]))
                self.values[f"error_{name}"][rows] = np.maximum(error, LEAST)

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

    def _take_energies(
        self, scene: Scene, rows: Integers, states: Floats, off: Floats | None
    ) -> None:
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
        self.values["energy"][rows] = energies
        if off is None:
            return
        flat = (off + _ROUNDED * EPS * np.abs(states)).reshape(len(states), -1)
        count = len(placed.vectors)
        du = flat @ np.abs(basis.displacement(placed.vectors)).reshape(count, -1).T
        dv = flat @ np.abs(basis.velocity(placed.vectors)).reshape(count, -1).T * structure.scale
        du = du + _ROUNDED * EPS * (np.abs(placed.vectors) @ placed.terms)
        forms = np.abs(scene.kernel.watched.coordinate[: len(scene.states)])
        dy = flat @ forms.reshape(len(forms), -1).T
        error = (np.abs(push) * du + 0.5 * np.abs(stiffness) * du**2).sum(axis=1)
        error += (np.abs(speed) * dv + 0.5 * dv**2).sum(axis=1)
        error += (k * (np.abs(beyond) + 0.5 * dy) * dy * (beyond != 0.0)).sum(axis=1)
        terms = kinetic + np.abs(u * (0.5 * stiffness * u - free.load)).sum(axis=1)
        self.values["error_energy"][rows] = error + _ROUNDED * EPS * terms + LEAST

    def _take_forces(
        self, scene: Scene, rows: Integers, states: Floats, off: Floats | None
    ) -> None:
        """Take the forces of stops, zero of those that are not loaded."""
        flat = states.reshape(len(states), -1)
        force = np.zeros((len(states), len(scene.states)))
        error = np.zeros_like(force)
        sizes = None
        if off is not None:
            sizes = (off + _ROUNDED * EPS * np.abs(states)).reshape(flat.shape)
        for a, code in enumerate(scene.states):
            if abs(code) != LOADED:
                continue
            form, level = scene.force_form(a)
            force[:, a] = np.maximum(flat @ form.ravel() + level, 0.0)
            if sizes is not None:
                size = abs(level) + float(scene.kernel.walls["size"][scene.force_place(a)])
                error[:, a] = sizes @ np.abs(form).ravel() + _ROUNDED * EPS * size
        self.values["force"][rows] = force
        if off is not None:
            self.values["error_force"][rows] = error
