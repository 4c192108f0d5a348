"""The driven structure: its pairs, its load by harmonics, and the coordinates that are watched."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers
from vibroimpact_solvers.kernels.limit_check import Coordinates
from vibroimpact_solvers.kernels.periodic import Response
from vibroimpact_solvers.periodic_motions.balance import Balance, unloaded
from vibroimpact_solvers.periodic_motions.groups import turned
from vibroimpact_solvers.periodic_motions.mixing import Mixing
from vibroimpact_solvers.periodic_motions.pairs import Complexes, Pairs
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.time_history.basis import Basis
from vibroimpact_solvers.time_history.structure import Structure


@dataclass(frozen=True, eq=False, slots=True)
class Driven:
    """A driven structure in the units of time of its basis.

    Parameters
    ----------
    basis : Basis
        Every mode, or complex mode, by itself.
    pairs : Pairs
        Those of the basis.
    scale : float
        Units of the basis' time in one of time.
    position, velocity, kick : array, shape (constraint, 2, pair)
        Forms of the limited coordinates, and changes of state by unit impulses on them.
    level : array, shape (constraint,)
        The coordinates under the constant load.
    level_error : array, shape (constraint,)
    mobility : array, shape (constraint, constraint)
        ``W M^-1 W^T``.
    harmonics : array of float, shape (harmonic,)
        Multiples of the drive's frequency, ascending.
    powers : array of int, shape (harmonic,)
        Those of the drive's frequency that multiply its amplitudes.
    forces : array, shape (harmonic, dof), complex
        Amplitudes of the load at the frequency 1.
    load : array, shape (harmonic, 2, pair), complex
        Change of state per unit of time by the amplitude of each harmonic.
    shape_error : float
        Relative error of forms and kicks, apart from what mixes modes.
    vector_error : float
        The latter, of complex modes, relative to their lengths.
    mixing : Mixing
    doubts : array, shape (2, constraint, pair)
        Absolute errors of the forms of position and velocity by it, of both numbers of each pair.
    free : array of bool, shape (constraint,)
        Whether impulses on a constraint move a rigid-body mode, which by itself never comes back.
    balance : Balance
        The rigid-body modes.
    """

    structure: Structure
    basis: Basis
    pairs: Pairs
    scale: float
    position: Floats
    velocity: Floats
    kick: Floats
    level: Floats
    level_error: Floats
    mobility: Floats
    harmonics: Floats
    powers: Integers
    forces: Complexes
    load: Complexes
    shape_error: float
    vector_error: float
    mixing: Mixing
    doubts: Floats
    free: Booleans
    balance: Balance

    @property
    def summed(self) -> float:
        """Rounding of sums over the pairs, of random sign, relative to their terms."""
        return EPS * math.sqrt(self.pairs.moving.size)

    @classmethod
    def of(cls, problem: Problem, method: spectrum.Method) -> Driven:
        """Prepare the structure of a problem.

        Raises
        ------
        PlanError
            Where a constant load drives a rigid-body mode that no impact pushes back, or damping
            makes modes almost equal.
        """
        system = problem.system
        structure = Structure.of(system, method, 2.0 * math.pi / float(problem.Omega[0]))
        configuration = structure.configuration()
        equal = turned(structure, configuration.basis.modes)
        modes, basis = equal.modes, configuration.basis.without_chains()
        if equal.groups:
            basis = Basis(modes, structure.exponent, chains=False)
        basis = unloaded(basis)
        rows = structure.W @ modes.shapes
        # A mode with a node at a constraint is not coupled at all; rounding of its participation
        # would put a multiplier next to a pole of the equation that the multipliers solve.
        rows[equal.silent] = 0.0
        harmonics, powers, forces = problem.forces()
        unit = math.ldexp(1.0, -2 * structure.exponent)
        load = unit * (
            basis.kick(forces.real @ modes.shapes) + 1j * basis.kick(forces.imag @ modes.shapes)
        )
        falls = np.where(modes.roots == 0.0, modes.load, 0.0)
        falls = unit * basis.kick(falls[np.newaxis])[0]
        rounded = 2.0 * EPS * (2.0 * basis.condition - 1.0)  # complex modes are inverted, too
        shape_error = modes.shape_error - modes.neglected + rounded  # `mixing` has it
        eigenvalues = modes.roots * np.abs(modes.roots)
        stiff = np.where(eigenvalues == 0.0, np.inf, np.abs(eigenvalues))
        loose = (
            2.0 * (shape_error + basis.vector_error + modes.neglected)
            + 4.0 * EPS
            + modes.errors / stiff
        )
        keep = (load != 0.0).any(axis=(1, 2))
        pairs, position, velocity = Pairs(basis), basis.displacement(rows), basis.velocity(rows)
        mixing = Mixing.of(structure, basis, pairs, equal)
        kick, doubts = basis.kick(rows), np.zeros((2, len(rows), 0))
        if mixing:
            doubts = mixing.of_forms(np.stack([position, velocity]))
            # Nor are complex modes whose participations are rounding.
            sizes = np.linalg.norm([position, velocity], axis=2)
            silent = (sizes <= doubts).all(axis=0)[:, np.newaxis].repeat(2, axis=1)
            position[silent] = velocity[silent] = kick[silent] = 0.0
            doubts[:, silent[:, 0]] *= 2.0
        balance = Balance.of(basis, falls, pairs, kick)
        balance.check(problem)
        return cls(
            structure,
            basis,
            pairs,
            structure.scale,
            position,
            velocity,
            kick,
            structure.level(structure.configuration()),
            np.abs(structure.W @ modes.shapes) @ (np.abs(basis.still) * loose),
            structure.mobility,
            harmonics[keep],
            powers[keep],
            forces[keep],
            load[keep],
            shape_error,
            basis.vector_error,
            mixing,
            doubts,
            ((rows != 0.0) & (modes.roots == 0.0)).any(axis=1),
            balance,
        )

    def watched(self, walls: Floats) -> Coordinates:
        """Return the coordinates as the check of free motions takes them; walls (2, constraint)."""
        pairs = self.pairs
        size = pairs.third_derivatives(self.position)
        acceleration = self.rates_of(self.velocity)
        growth = np.maximum(pairs.growth, 0.0)
        return Coordinates(
            self.position, self.velocity, acceleration, size, growth, self.level, walls,
            self.balance.trend(),
        )  # fmt: skip

    def impulse_response(
        self, length: Floats, rest: Floats, sign: float, kicks: Floats
    ) -> Response:
        """Return the responses to kicks, one per cell, with what balances those of rigid bodies.

        See `Pairs.impulse_response`.
        """
        response = self.pairs.impulse_response(length, rest, sign, kicks)
        if sign > 0.0:
            self.balance.complete(response, length, kicks, self.pairs.drift)
        return response

    def rates_of(self, forms: Floats) -> Floats:
        """Return the forms of the time derivatives of forms, loads apart."""
        return self.basis.rates_of(forms)

    @property
    def walls(self) -> Floats:
        """Positions of lower and upper walls, shape (2, constraint); infinite: there is none."""
        lower, upper = self.structure.limits
        return np.ascontiguousarray([-lower, upper])
