"""The structure with its stop open and loaded: pairs, forms, loads, and how states carry over.

States are flat: the first numbers of all pairs of `pairs.Pairs`, then the second ones. They are
deviations from the steady response to the load, in each phase from that of its own structure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.periodic_motions.balance import directions
from vibroimpact_solvers.periodic_motions.frame import Frame
from vibroimpact_solvers.periodic_motions.pairs import Complexes, Pairs
from vibroimpact_solvers.periodic_motions.problem import Impact, Problem
from vibroimpact_solvers.time_history.basis import Basis
from vibroimpact_solvers.time_history.stops.modes import Placed, StoppedModes
from vibroimpact_solvers.time_history.structure import Structure

Load = tuple[Floats, Integers, Complexes]
"""Harmonics, powers of the frequency and amplitudes of forces, as of `Problem.forces`."""


@dataclass(frozen=True, eq=False, slots=True)
class Side:
    """The structure in one state of the stop, in units of the basis' time.

    Parameters
    ----------
    basis : Basis
    pairs : Pairs
    vectors : array, shape (mode, mode)
        Its modes in those of the open structure.
    origin : array, shape (mode,)
        Modal coordinates of the open structure at the zero of the state.
    position, velocity, kick : array, shape (constraint, 2 pair)
        Forms of the limited coordinates, and changes of state by unit impulses on them.
    level : array, shape (constraint,)
        The coordinates at the zero of the state.
    force : array, shape (2 pair,)
        Form of ``k d + c d'``.
    force_level, force_size : float
        Its value at the zero of the state, and the size of what that is the sum of.
    load : array, shape (harmonic, 2, pair), complex
        Change of state per unit of time by the amplitude of each harmonic.
    rate : array, shape (pair,)
        Bounds of the moduli of the rates of the pairs.
    growth : array, shape (pair,)
        Largest real parts of the rates.
    shape_error : float
        Relative error of forms and kicks.
    """

    basis: Basis
    pairs: Pairs
    vectors: Floats
    origin: Floats
    position: Floats
    velocity: Floats
    kick: Floats
    level: Floats
    force: Floats
    force_level: float
    force_size: float
    load: Complexes
    rate: Floats
    growth: Floats
    shape_error: float

    @property
    def size(self) -> int:
        """Number of pairs, those included that pad."""
        return int(self.pairs.alpha.size)

    def propagators(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the numbers e, o, b of ``(a, b) -> (e a + o b, e b + back a)``, (time, pair)."""
        even, odd = self.pairs.propagators(np.ascontiguousarray(times)).swapaxes(0, 1)
        back = odd.copy()
        back[:, self.pairs.rotations] *= -1.0
        back[:, self.pairs.parabolas] = 0.0
        return even, odd, back

    def coordinates_of(self, flat: Floats) -> tuple[Floats, Floats]:
        """Return modal coordinates from the equilibrium and rates of flat states, (…, mode)."""
        return self.basis.coordinates(flat.reshape(*flat.shape[:-1], 2, self.size))


@dataclass(frozen=True, slots=True)
class Stop:
    """A stop of finite stiffness at one of its walls.

    Parameters
    ----------
    impact : Impact
        The constraint and the side.
    stiffness : float
    damping : float
        Force per velocity, by the basis' time.
    wall : float
        Distance of the wall from the zero of the coordinate.
    """

    impact: Impact
    stiffness: float
    damping: float
    wall: float


@dataclass(frozen=True, eq=False, slots=True)
class Phases:
    """A structure with one stop of finite stiffness, open and loaded.

    Parameters
    ----------
    stopped : StoppedModes
    impact : Impact
        The constraint and the side of the stop.
    stiffness : float
    damping : float
        Force per velocity, by the basis' time.
    wall : float
        Distance of the wall from the zero of the coordinate.
    open, loaded : Side
    to_loaded, to_open : array, shape (2 pair, 2 pair)
        How deviations carry over.
    offset : array, shape (2 pair,)
        Loaded state of the open structure's zero.
    forces : array, shape (harmonic, dof), complex
    harmonics : array of float, shape (harmonic,)
    powers : array of int, shape (harmonic,)
    carried : float
        Norm of `to_loaded`.
    frame : Frame, optional
        Of the same harmonics, where displacements are relative to walls that move.
    """

    stopped: StoppedModes
    impact: Impact
    stiffness: float
    damping: float
    wall: float
    open: Side
    loaded: Side
    to_loaded: Floats
    to_open: Floats
    offset: Floats
    forces: Complexes
    harmonics: Floats
    powers: Integers
    carried: float
    frame: Frame | None

    @property
    def scale(self) -> float:
        """Units of the basis' time in one of time."""
        return self.stopped.scale

    @property
    def stop(self) -> Stop:
        """The stop by itself."""
        return Stop(self.impact, self.stiffness, self.damping, self.wall)

    @classmethod
    def of(cls, problem: Problem, method: spectrum.Method) -> Phases:
        """Prepare the structure of a problem with one contact in a cell.

        Raises
        ------
        ModelError
            Where a constant load moves a free body, or the stop leaves one free.
        """
        (impact,) = problem.impacts
        structure = Structure.of(problem.system, method, 2.0 * math.pi / float(problem.Omega[0]))
        stopped = StoppedModes(structure)
        side = ((impact.constraint, impact.side),)
        harmonics, powers, forces, frame = acting(problem.forces(), problem.frame)
        placed = stopped.placed(()), stopped.placed(side)
        check_borne(stopped)
        check_held(stopped, problem)
        open_side = side_of(stopped, placed[0], impact, forces, loaded=False)
        loaded = side_of(stopped, placed[1], impact, forces, loaded=True)
        to_loaded, offset = passage_of(placed[0], open_side, placed[1], loaded)
        to_open, _ = passage_of(placed[1], loaded, placed[0], open_side)
        a = impact.constraint
        return cls(
            stopped, impact, float(stopped.stiffness[a]),
            float(stopped.damping[a]) * stopped.scale, stopped.wall(a, impact.side), open_side,
            loaded, to_loaded, to_open, offset, forces, harmonics, powers,
            float(np.linalg.norm(to_loaded, 2)), frame,
        )  # fmt: skip


def acting(load: Load, frame: Frame | None) -> tuple[*Load, Frame | None]:
    """Return the harmonics that act of a load, and of a frame."""
    harmonics, powers, forces = load
    some = forces.any(axis=1)
    if frame is not None:
        some |= frame.some
        frame = frame.part(some)
    return harmonics[some], powers[some], forces[some], frame


def check_borne(stopped: StoppedModes) -> None:
    """Refuse a constant load that moves a free body."""
    modes = stopped.placed(()).basis.modes
    if np.where(modes.roots == 0.0, modes.load, 0.0).any():
        message = (
            "periodic motions with linear stops are computed of structures that bear their "
            "constant load; this one moves a rigid body"
        )
        raise ModelError(("system", "force"), message, code="free_body")


def check_held(stopped: StoppedModes, problem: Problem) -> None:
    """Refuse a rigid motion that no spring of the sequence resists.

    With K r = 0 and w . r = 0 for all its stops, every motion x has the neighbours x + r, and the
    equations of the period are singular. A motion whose second half mirrors the first has none.
    """
    if problem.symmetric:
        return
    rigid = stopped.placed(()).basis.modes.roots == 0.0
    struck = {impact.constraint for impact in problem.impacts}
    springs = [a for a in sorted(struck) if stopped.stiffness[a] > 0.0]
    if directions(stopped.rows[springs][:, rigid]).shape[1] < rigid.sum():
        message = (
            "nothing resists a rigid motion of the structure, neither its stiffness nor a stop of "
            "the sequence: periodic motions are not determined"
        )
        raise ModelError(("system", "K"), message, code="free_body")


def side_of(
    stopped: StoppedModes, placed: Placed, impact: Impact, forces: Complexes, *, loaded: bool
) -> Side:
    """Return the structure in one state of its stop."""
    basis = placed.basis.without_chains()
    pairs, rows, a, side = Pairs(basis), placed.rows, impact.constraint, impact.side
    position, velocity, kick = basis.displacement(rows), basis.velocity(rows), basis.kick(rows)
    k, c = float(stopped.stiffness[a]), float(stopped.damping[a]) * stopped.scale
    wall = stopped.wall(a, side)
    level = k * (placed.indentations[a] if loaded else side * placed.levels[a] - wall)
    unit, shapes = math.ldexp(1.0, -2 * stopped.exponent), basis.modes.shapes
    both = basis.kick(forces.real @ shapes), basis.kick(forces.imag @ shapes)
    load = np.asarray(unit * (both[0] + 1j * both[1]), dtype=np.complex128)
    turning = np.arange(pairs.nu.size)
    apart = np.abs(pairs.alpha) + np.where(turning < pairs.hyperbolas.stop, pairs.nu, 1.0)
    rate = np.where(turning < pairs.rotations.stop, pairs.speed, apart)
    rounded = 2.0 * EPS * (2.0 * basis.condition - 1.0)
    shape_error = basis.modes.shape_error + basis.vector_error + rounded

    def flat(forms: Floats) -> Floats:
        return np.ascontiguousarray(forms.reshape(len(forms), -1))

    return Side(
        basis, pairs, placed.vectors, placed.origin, flat(position), flat(velocity), flat(kick),
        placed.levels, side * (k * position[a] + c * velocity[a]).ravel(), float(level),
        abs(level) + k * (0.0 if loaded else abs(wall)), load, rate, pairs.growth,
        float(np.max(shape_error)),
    )  # fmt: skip


def passage_of(before: Placed, one: Side, after: Placed, other: Side) -> tuple[Floats, Floats]:
    """Return how states carry over: ``matrix z + offset``, displacements being unchanged."""
    turn = after.vectors.T @ before.vectors
    still = turn @ one.basis.still
    shift = still + after.vectors.T @ (before.origin - after.origin) - other.basis.still
    matrix = np.empty((2 * other.size, 2 * one.size))
    q, rate = one.coordinates_of(np.eye(2 * one.size))
    q, rate = q @ turn.T, rate @ turn.T
    for column in range(2 * one.size):
        look()
        matrix[:, column] = other.basis.pairs_of(q[column], rate[column]).ravel()
    return matrix, other.basis.pairs_of(shift, np.zeros(shift.size)).ravel()
