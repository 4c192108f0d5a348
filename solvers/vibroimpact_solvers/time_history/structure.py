"""A structure in each of its contact configurations: its modes, and the coordinates watched."""

from __future__ import annotations

import itertools
import math
import weakref
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from typing import Any, Final

import numpy as np
import scipy.linalg
import scipy.sparse

from vibroimpact_solvers import condensation, spectrum
from vibroimpact_solvers.arrays import Booleans, Floats, Integers
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.kernels import rigid_state
from vibroimpact_solvers.kernels.deviations import SAFETY
from vibroimpact_solvers.kernels.flow import Watched
from vibroimpact_solvers.kernels.modal import Modal, handed_over
from vibroimpact_solvers.matrices import Form, SymmetricMatrix
from vibroimpact_solvers.model import System
from vibroimpact_solvers.spectrum import Spectrum
from vibroimpact_solvers.time_history import modal_damping
from vibroimpact_solvers.time_history.basis import Basis, Modes, exponent_of
from vibroimpact_solvers.time_history.loads import (
    SLOW_TURN,
    Harmonic,
    HarmonicLoads,
    Load,
    Ramps,
    constant,
    turns_slowly,
)
from vibroimpact_solvers.time_history.modal_damping import ModalDamping

_EPS: Final = float(np.finfo(np.float64).eps)
_TERMS: Final = 100_000  # that are in memory at once
_UNCOUPLED: Final = 64.0 * _EPS  # of its terms, where a mobility or a force is rounding
_DEPENDENT: Final = 1e12  # condition of mobilities, in units of their roots
_REFINED: Final = 8  # passes, each of which gains four digits or more
Contact = tuple[int, int]
"""A constraint at rest at a wall: its index, and 1 for the upper or -1 for the lower wall."""


_Key = tuple[spectrum.Method, tuple[Load, ...], frozenset[Load], float]
_PREPARED: weakref.WeakKeyDictionary[System, dict[_Key, Structure]] = weakref.WeakKeyDictionary()


def prepared(system: System) -> tuple[Structure, ...]:
    """Return what is kept for a system object, as long as that lives."""
    return tuple(_PREPARED.get(system, {}).values())


@dataclass(frozen=True, eq=False)
class Configuration:
    """The structure with given constraints in contact: its modal basis, and what is watched.

    Parameters
    ----------
    basis : Basis
    contacts : tuple
        The constraints in contact, whose coordinates are held fixed.
    answers : array, shape (contact, free constraint)
        Impulses of the contacts on unit impulses at upper walls, and their negatives at lower ones.
    idle : frozenset of Contact
        Contacts without a force, whatever the state is: bodies that touch and fly together.
    free : tuple of int
        The other constraints, in the order in which they are watched; contact forces are
        watched after them.
    kernel : rigid_state.Structure
        What the compiled loop takes.
    reaches : dict
        What is known of errors of the outputs at some degrees of freedom (`stated_errors.Reach`).
    """

    basis: Basis
    contacts: tuple[Contact, ...]
    answers: Floats
    idle: frozenset[Contact]
    free: tuple[int, ...]
    kernel: rigid_state.Structure
    reaches: dict[bytes, Any] = field(default_factory=dict)

    @property
    def forces(self) -> tuple[Floats, Floats]:
        """The forms of the contact forces, shape (contact, 2, pair), and their levels."""
        first, kernel = len(self.free), self.kernel
        return kernel.watched.coordinate[first:], kernel.walls["lower"][first:]

    @cached_property
    def arguments(self) -> tuple[Any, ...]:
        """The same as `kernels.rigid_motion.follow` takes it."""
        return rigid_state.handed_over(self.kernel)


class Structure:
    """A system and its contact configurations, prepared when they are first needed.

    Parameters
    ----------
    system : System
    method : Method
        How its natural modes are computed.
    t_end : float
        Length of the motion; sets the unit of time where nothing vibrates.
    load : tuple of Load
    """

    def __init__(
        self, system: System, method: spectrum.Method, t_end: float, load: tuple[Load, ...] = ()
    ) -> None:
        self.system = system
        self.harmonic_loads = HarmonicLoads.of(load, system.n)
        self._slow = self.harmonic_loads.frequencies * t_end < SLOW_TURN
        self.ramps = Ramps.of(load, system.n)
        self.natural: Spectrum = spectrum.spectrum(system, method)
        n, count = system.n, len(system.constraints)
        self.W = system.directions(range(count))
        self.limits = (
            np.array(
                [
                    [np.inf if w is None else w for w in (c.lower, c.upper)]
                    for c in system.constraints
                ]
            )
            .reshape(count, 2)
            .T.copy()
        )
        self.force = constant(load, n)
        if system.force is not None:
            self.force = self.force + system.force
        turning = self.harmonic_loads.frequencies[~self._slow]
        self.exponent = exponent_of(np.concatenate([self.natural.roots, turning]), t_end)
        self.scale = math.ldexp(1.0, self.exponent)
        self._configurations: dict[frozenset[Contact], Configuration] = {}
        self._modal: dict[tuple[Contact, ...], tuple[Any, ...]] = {}
        self._modes = self._without_contacts()
        rows = self.W @ self._modes.shapes
        self.mobility = np.asarray(rows @ rows.T)

    @classmethod
    def of(
        cls, system: System, method: spectrum.Method, t_end: float, load: tuple[Load, ...] = ()
    ) -> Structure:
        """Return the structure prepared before for the same system object, or prepare it."""
        known = _PREPARED.setdefault(system, {})
        slow = frozenset(term for term in load if turns_slowly(term, t_end))
        turning = any(
            isinstance(term, Harmonic) and term.frequency > 0.0 for term in {*load} - slow
        )
        unit = 0.0 if turning or system.K.data.any() else t_end  # that alone gives the unit of time
        key = (method, load, slow, unit)
        structure = known.get(key)
        if structure is None:
            structure = cls(system, method, t_end, load)
            known.clear()  # they are large; loads seldom alternate
            known[key] = structure
        return structure  # another thread may have cleared it by now

    def configuration(self, contacts: frozenset[Contact] = frozenset()) -> Configuration:
        """Return the configuration with some constraints in contact."""
        configuration = self._configurations.get(contacts)
        if configuration is None:
            fixed = tuple(sorted(contacts))
            self._require_independent(fixed)
            modes = self._with_contacts(fixed) if fixed else self._modes
            configuration = self._watched(Basis(modes, self.exponent), fixed)
            self._configurations[contacts] = configuration
        return configuration

    def _require_independent(self, contacts: tuple[Contact, ...]) -> None:
        """Refuse contacts of which one is a combination of the others: forces are not unique."""
        held = [index for index, _ in contacts]
        among, sizes = self.mobility[np.ix_(held, held)], np.sqrt(self.mobility.diagonal()[held])
        if len(held) > 1 and np.linalg.cond(among / np.outer(sizes, sizes)) > _DEPENDENT:
            which = ", ".join(map(str, held))
            message = f"the constraints {which} depend on one another and rest at the same time"
            raise ConvergenceError(f"{message}: how they share their force is not known")

    def displacements(
        self, configuration: Configuration, z: Floats, *, level: bool = True
    ) -> tuple[Floats, Floats]:
        """Return displacements and velocities (in the basis' time) of a state, each (dof,)."""
        basis, modes = configuration.basis, configuration.basis.modes
        x, v = np.stack(basis.coordinates(z)) @ modes.shapes.T
        still = modes.base + modes.shapes @ basis.still if basis.still.any() else modes.base
        return (x + still if level else x), v

    def magnitudes(self, configuration: Configuration, z: Floats) -> tuple[Floats, Floats]:
        """Return the sums of the magnitudes of what `displacements` are made of, each (dof,)."""
        modes = configuration.basis.modes
        x, v = np.stack(configuration.basis.magnitudes(z)) @ np.abs(modes.shapes).T
        return x + np.abs(modes.base), v

    def state_of(
        self, configuration: Configuration, x: Floats, v: Floats, loads: Floats | None = None
    ) -> Floats:
        """Return the state of displacements and velocities (in the basis' time).

        loads is their state; absent where x and v are a deviation.
        """
        basis, modes = configuration.basis, configuration.basis.modes
        place = x if loads is None else x - modes.base
        q, rate = np.stack([place, v]) @ modes.weighted  # one pass over a large matrix
        return basis.pairs_of(q if loads is None else q - basis.still, rate, loads)

    def level(self, configuration: Configuration) -> Floats:
        """Return the free coordinates at the zero of the state, shape (constraint,)."""
        rows = self.W[list(configuration.free)]
        modes = configuration.basis.modes
        return np.asarray(configuration.basis.level(rows @ modes.shapes) + rows @ modes.base)

    @property
    def shapes(self) -> Floats:
        """The modes without contacts as columns, shape (dof, mode)."""
        return self._modes.shapes

    @cached_property
    def narrowest_gap(self) -> float:
        """The smallest distance between the two walls of a coordinate, infinite for one wall."""
        return float(self.limits.sum(axis=0).min(initial=np.inf))

    def modal(self, configuration: Configuration, dofs: Integers) -> tuple[Any, ...]:
        """Return how kernels convert states and displacements of some dofs (`kernels.modal`)."""
        known = self._modal.get(configuration.contacts)
        if known is None:
            known = self._modal[configuration.contacts] = handed_over(self._modes_of(configuration))
        if dofs.size == self.system.n and bool((dofs[1:] > dofs[:-1]).all()):
            return known
        sizes, (weighted, shapes, *matrices), base, *rest = known
        return sizes, (weighted, shapes[dofs], *matrices), base[dofs], *rest

    def _modes_of(self, configuration: Configuration) -> Modal:
        basis, (lower, upper) = configuration.basis, self.limits
        modes, base = basis.modes, basis.modes.base
        level = base @ (0.5 * (self.system.K @ base) - self.force)
        roots = modes.roots * (1.0 + modes.rests)
        return Modal(
            self.scale, float(level), modes.weighted, modes.shapes, base, basis.still,
            basis.stretch, basis.delta, roots * np.abs(roots), modes.load, basis.place,
            basis.others, basis.made_by_others(), basis.start_of_others(), self.W, lower, upper,
        )  # fmt: skip

    def mass_solve(self, b: Floats) -> Floats:
        """Return ``M^-1 b``; what has no mass follows."""
        return np.asarray(condensation.solve_mass(self.system)(b))

    def _without_contacts(self) -> Modes:
        natural, system = self.natural, self.system
        shapes = natural.modes
        weighted = system.M @ shapes
        rests = np.zeros(natural.roots.size) if natural.rounding is None else natural.rounding
        still = np.zeros(system.n)
        rounded = natural.norms + (_EPS if natural.rounding is None else 0.0)
        errors = natural.uncertainty if natural.errors is None else natural.errors
        errors = errors + rounded * np.abs(natural.eigenvalues)
        shape_error = natural.norms
        if natural.angles is not None:
            shape_error += float(natural.angles.max(initial=0.0))
        rigid = natural.roots == 0.0
        errors[rigid] = _left_by_rounding(system.K, shapes[:, rigid])
        return self._equations(
            natural.roots, rests, shapes, still, weighted, errors, shape_error, exact=natural.proved
        )

    def _equations(
        self,
        roots: Floats,
        rests: Floats,
        shapes: Floats,
        base: Floats,
        weighted: Floats,
        errors: Floats,
        shape_error: float,
        *,
        exact: bool = False,
    ) -> Modes:
        """Return the modal equations of some modes, exact ones erring by their entries alone."""
        system = self.system
        damped = ModalDamping(None, np.zeros(roots.size), np.zeros((0, 0)))
        if system.C is not None:
            shapes = _with_separate_rigid_modes(system.C, roots, shapes)
            rigid = roots == 0.0
            errors[rigid] = errors[rigid].sum()  # each of them may be any of those before
            weighted = system.M @ shapes
            damped = modal_damping.of_modes(system, shapes, roots, exact=exact)
        force = self.force - (system.K @ base if base.any() else 0.0)
        # A load that is only rounding must not drive a rigid-body mode away.
        load = force @ shapes
        load[np.abs(load) <= 1e-13 * (np.abs(force) @ np.abs(shapes))] = 0.0
        harmonic_loads = self.harmonic_loads
        cosine, sine = shapes.T @ harmonic_loads.cosine, shapes.T @ harmonic_loads.sine
        ramps, begin = self.ramps, self.ramps.segment(0.0) if self.ramps.count else 0
        return Modes(
            roots, rests, damped.matrix, load, harmonic_loads.frequencies, self._slow, cosine, sine,
            shapes.T @ ramps.directions, ramps.state(begin, 0.0), shapes, base, weighted, errors,
            damped.errors, shape_error + damped.neglected, damped.neglected,
        )  # fmt: skip

    def _with_contacts(self, contacts: tuple[Contact, ...]) -> Modes:
        """Return the modes of the structure with the constrained coordinates held fixed."""
        system = self.system
        W = self.W[[index for index, _ in contacts]]
        M, K = system.M.to_dense(), system.K.to_dense()
        Z: Floats
        solved: Floats
        if system.massless.size:
            condensed = condensation.of(system)
            Z = condensed.whole(scipy.linalg.null_space(W[:, condensed.massive]))
        else:
            Z = scipy.linalg.null_space(W)
        solved = self.mass_solve(np.ascontiguousarray(W.T))
        # The base is orthogonal to the rest in M, and so has no part in the inertia.
        base = self._placed(contacts, W, solved)
        eigenvalues, vectors = scipy.linalg.eigh(Z.T @ K @ Z, Z.T @ M @ Z)
        shapes = Z @ vectors
        # Terms may be larger than their sums: of a rigid body that nothing else is left of, and of
        # what has no mass.
        magnitudes = np.abs(shapes)
        terms = (magnitudes * (np.abs(K) @ magnitudes)).sum(axis=0)
        scale = float(np.maximum(np.abs(eigenvalues), terms).max(initial=0.0))
        rounding = max(16.0, math.sqrt(system.n)) * _EPS * scale
        eigenvalues[np.abs(eigenvalues) <= rounding] = 0.0
        roots = np.sign(eigenvalues) * np.sqrt(np.abs(eigenvalues))
        errors = np.full(roots.size, rounding / SAFETY)
        return self._equations(
            roots, np.zeros(roots.size), shapes, base, system.M @ shapes, errors, _EPS
        )

    def _placed(self, contacts: tuple[Contact, ...], W: Floats, solved: Floats) -> Floats:
        """Return the combination of the columns ``M^-1 W^T`` that is at the walls, shape (dof,).

        Of coordinates that are nearly the same a few digits would be lost: what is left is computed
        exactly, until nothing changes.
        """
        base, among = np.zeros(W.shape[1]), W @ solved
        for _ in range(_REFINED):
            left = [self._left(contact, base) for contact in contacts]
            moved = base + solved @ np.linalg.solve(among, left)
            if (moved == base).all():
                break
            base = moved
        return base

    def _left(self, contact: Contact, x: Floats) -> float:
        """Return how far the coordinate of a contact is from its wall, rounded once."""
        terms = self.system.constraints[contact[0]].coordinate
        y = sum((Fraction(w) * Fraction(float(x[dof])) for dof, w in terms), Fraction(0))
        return float(Fraction(self.wall(contact)) - y)

    def wall(self, contact: Contact) -> float:
        """Return where the coordinate of a contact is."""
        index, side = contact
        constraint = self.system.constraints[index]
        wall = constraint.upper if side > 0 else constraint.lower
        assert wall is not None
        return side * wall

    def _watched(self, basis: Basis, contacts: tuple[Contact, ...]) -> Configuration:
        system, modes = self.system, basis.modes
        fixed = {index for index, _ in contacts}
        free = tuple(i for i in range(len(system.constraints)) if i not in fixed)
        W = self.W[list(free)]
        rows = W @ modes.shapes
        level = basis.level(rows) + W @ modes.base
        forms, slopes, kicks = basis.displacement(rows), basis.velocity(rows), basis.kick(rows)
        limits = [system.constraints[i] for i in free]
        lower = np.array([np.inf if c.lower is None else c.lower for c in limits]) + level
        upper = np.array([np.inf if c.upper is None else c.upper for c in limits]) - level
        sizes = np.array(
            [max(abs(w) for w in (c.lower, c.upper) if w is not None) for c in limits]
        ) + np.abs(level)
        restitution = np.array([c.restitution for c in limits])
        idle = np.zeros(0, dtype=np.bool_)
        if contacts:
            press, press_level, idle = self._contact_force_forms(basis, contacts)
            forms = np.concatenate([forms, press])
            slopes = np.concatenate([slopes, basis.rates_of(press)])
            kicks = np.concatenate([kicks, np.zeros_like(press)])
            lower = np.concatenate([lower, press_level])
            upper = np.concatenate([upper, np.full(len(contacts), np.inf)])
            sizes = np.concatenate([sizes, np.abs(press_level)])
            restitution = np.concatenate([restitution, np.full(len(contacts), -1.0)])
        mobility = np.zeros((restitution.size, restitution.size))
        mobility[: len(free), : len(free)] = rows @ rows.T
        factor, rest = _quotients(slopes[: len(free)], kicks[: len(free)], restitution)
        fill = np.zeros(len(contacts))
        factor, rest = (np.concatenate([part, fill]) for part in (factor, rest))
        jumps = (slopes * basis.drift(kicks)).sum(axis=(1, 2))
        answers = self._answers(free, contacts)
        opens = _opening(forms[len(free) :], kicks[: len(free)], answers)
        if contacts and basis.longest < np.inf:  # sums of growing kicks would lose their digits
            opens[:] = rigid_state.MAYBE
        opens[:, (answers[idle] != 0.0).any(axis=0)] = rigid_state.MAYBE  # they are struck, too
        walls = np.empty(restitution.size, rigid_state.WALL)
        walls["lower"], walls["upper"], walls["restitution"] = lower, upper, restitution
        walls["size"], walls["factor"], walls["factor_rest"] = sizes, factor, rest
        walls["acceleration"] = jumps
        walls["opens_lower"] = walls["opens_upper"] = 0
        walls["opens_lower"][: len(free)], walls["opens_upper"][: len(free)] = opens
        high, size, low = (np.ascontiguousarray(part) for part in basis.weight(forms))
        watched = Watched(forms, slopes, kicks, basis.drift(kicks), size, high, low)
        form_errors, slope_errors, kick_errors = basis.form_errors(forms, slopes, kicks)
        drift = float(np.abs(basis.drifts).max(initial=0.0))
        doubts, still = basis.doubts
        own = kick_errors, form_errors, slope_errors, basis.own, basis.measure, doubts
        carried = basis.carried, basis.load_places, still
        errors = basis.signs, basis.drifts, *own, *carried, drift
        kernel = rigid_state.Structure(
            basis.flow, watched, walls, mobility, rigid_state.Errors(*errors)
        )
        without_force = frozenset(itertools.compress(contacts, idle))
        return Configuration(basis, contacts, answers, without_force, free, kernel)

    def _answers(self, free: tuple[int, ...], contacts: tuple[Contact, ...]) -> Floats:
        """Return the impulses by which contacts keep closed, shape (contact, free constraint)."""
        if not contacts or not free:
            return np.zeros((len(contacts), len(free)))
        held = [index for index, _ in contacts]
        sides = np.array([side for _, side in contacts], dtype=np.float64)
        among = self.mobility[np.ix_(held, held)] * np.outer(sides, sides)
        coupling = self.mobility[np.ix_(held, free)]
        sizes = np.sqrt(np.outer(self.mobility.diagonal()[held], self.mobility.diagonal()[[*free]]))
        coupling = np.where(np.abs(coupling) <= _UNCOUPLED * sizes, 0.0, coupling)
        return np.asarray(-np.linalg.solve(among, sides[:, np.newaxis] * coupling))

    def _contact_force_forms(
        self, basis: Basis, contacts: tuple[Contact, ...]
    ) -> tuple[Floats, Floats, Booleans]:
        """Return the forms of the contact forces, their levels, and where all are rounding."""
        system, modes = self.system, basis.modes
        W = self.W[[index for index, _ in contacts]]
        sides = np.array([side for _, side in contacts], dtype=np.float64)
        solve = condensation.solve_mass(system)
        solved = solve(np.ascontiguousarray(W.T))
        # The wall's force along W is -(W M^-1 W^T)^-1 W M^-1 (f - K x - C v); a coordinate is
        # pressed with side times its negative.
        onto = sides[:, np.newaxis] * np.linalg.solve(W @ solved, solved.T)
        by_x = -(system.K @ np.ascontiguousarray(onto.T)).T
        level = onto @ self.force + by_x @ modes.base
        rows = by_x @ modes.shapes
        sizes, stiffness = np.abs(onto), _magnitudes(system.K)
        by_x_sizes = (stiffness @ np.ascontiguousarray(sizes.T)).T
        idle = np.abs(level) <= _UNCOUPLED * (
            sizes @ np.abs(self.force) + by_x_sizes @ np.abs(modes.base)
        )
        # A shape has roundings of others' size: where it is zero, they are all of it.
        largest = np.abs(modes.shapes).max(axis=1, initial=0.0, keepdims=True)
        idle &= (np.abs(rows) <= _UNCOUPLED * (by_x_sizes @ largest)).all(axis=1)
        forms = basis.displacement(rows)
        level = level + basis.level(rows)
        if system.C is not None:
            by_v = -(system.C @ np.ascontiguousarray(onto.T)).T @ modes.shapes
            forms = forms + math.ldexp(1.0, basis.exponent) * basis.velocity(by_v)
            by_v_sizes = (_magnitudes(system.C) @ np.ascontiguousarray(sizes.T)).T
            idle &= (np.abs(by_v) <= _UNCOUPLED * (by_v_sizes @ largest)).all(axis=1)
        harmonic = self.harmonic_loads
        parts = harmonic.cosine, harmonic.sine, self.ramps.directions
        for part in parts:
            idle &= (np.abs(onto @ part) <= _UNCOUPLED * (sizes @ np.abs(part))).all(axis=1)
        forms = forms + basis.load(*(onto @ part for part in parts))
        forms[idle], level[idle] = 0.0, 0.0  # roundings would open them, or not let them open
        return forms, level, idle


def _magnitudes(A: SymmetricMatrix) -> SymmetricMatrix:
    """Return the matrix of the magnitudes of all entries."""
    return SymmetricMatrix(np.abs(A.data), A.form, A.pattern)


def _with_separate_rigid_modes(C: SymmetricMatrix, roots: Floats, shapes: Floats) -> Floats:
    """Return the modes, those of rigid bodies chosen such that damping does not couple them."""
    rigid = np.flatnonzero(roots == 0.0)
    if rigid.size < 2:
        return shapes
    some = shapes[:, rigid]
    _, turned = np.linalg.eigh(some.T @ (C @ some))
    shapes = shapes.copy()
    shapes[:, rigid] = some @ turned
    return shapes


def _left_by_rounding(K: SymmetricMatrix, rigid: Floats) -> Floats:
    """Return the eigenvalues of rigid-body modes, shape (mode,): K is singular up to rounding."""
    if rigid.shape[1] == 0:
        return np.zeros(0)
    matrix = K.to_dense() if K.form is Form.DENSE else K.to_sparse()
    wide, left = rigid.astype(np.longdouble), np.zeros(rigid.shape[1], np.longdouble)
    rows = max(1, _TERMS * K.n // max(1, matrix.size))
    for begin in range(0, K.n, rows):
        part = scipy.sparse.coo_array(matrix[begin : begin + rows])
        terms = part.data[:, np.newaxis] * wide[begin + part.row] * wide[part.col]
        left += terms.sum(axis=0)
    return np.asarray(np.abs(left), dtype=np.float64)


def _opening(forces: Floats, kicks: Floats, answers: Floats) -> Integers:
    """Return whether impulses at lower and at upper walls open a contact, shape (2, free).

    By the coupling of masses a contact may have to pull in the impact; damping that couples
    velocities to its force may take from that what it has.
    """
    terms = forces[:, np.newaxis] * kicks  # (contact, free, 2, pair)
    pushes, sizes = terms.sum(axis=(2, 3)), np.abs(terms).sum(axis=(2, 3))
    pushes[np.abs(pushes) <= _UNCOUPLED * sizes] = 0.0
    # The state changes by minus the kick at an upper wall.
    less = np.array([(pushes < 0.0).any(axis=0), (pushes > 0.0).any(axis=0)])
    pulls = np.array([(answers > 0.0).any(axis=0), (answers < 0.0).any(axis=0)])
    return np.where(
        pulls, rigid_state.MAYBE, np.where(less, rigid_state.BY_FORCE, rigid_state.NEVER)
    )


def _quotients(slopes: Floats, kicks: Floats, restitution: Floats) -> tuple[Floats, Floats]:
    """Return (1 + restitution) over the change of velocity by a unit impulse, as two doubles each.

    What is rounded in the quotient, or in the forms and not in the quotient, would change the
    energy by the same part of itself at every impact. Of a coordinate that contacts hold it is 0.
    """
    factor, rest = np.empty((2, len(slopes)))
    for i, (slope, kick) in enumerate(zip(slopes.astype(np.longdouble), kicks, strict=True)):
        change = (slope * kick).sum()
        exact = (1 + np.longdouble(restitution[i])) / change if change > 0 else np.longdouble(0)
        factor[i] = exact
        rest[i] = exact - np.longdouble(factor[i])
    return factor, rest
