"""A structure in each of its contact configurations: its modes, and the coordinates watched."""

from __future__ import annotations

import copy
import itertools
import math
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers import condensation, spectrum
from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.body import Body
from vibroimpact_solvers.kernels import modal as modal_kernels
from vibroimpact_solvers.kernels import rigid_state
from vibroimpact_solvers.kernels.flow import Watched
from vibroimpact_solvers.model import Constraint, Coordinates, System
from vibroimpact_solvers.spectrum import Spectrum
from vibroimpact_solvers.time_history import contact_forces
from vibroimpact_solvers.time_history.basis import Basis, Modes, exponent_of
from vibroimpact_solvers.time_history.contact_forces import Contact
from vibroimpact_solvers.time_history.loads import Harmonic, Load, turns_slowly
from vibroimpact_solvers.time_history.modal_equations import (
    Forces,
    placed,
    with_contacts,
    without_contacts,
)

_ALTERNATING: Final = 2  # structures of one system that are kept: they are large
_Key = tuple[spectrum.Method, tuple[Load, ...], frozenset[Load], float]
_SHARED: weakref.WeakKeyDictionary[Body, dict[tuple[_Key, Coordinates], Shared]] = (
    weakref.WeakKeyDictionary()
)
_PREPARED: weakref.WeakKeyDictionary[System, dict[_Key, Structure]] = weakref.WeakKeyDictionary()


def _make_room(kept: dict[Any, Any]) -> None:
    """Forget all where there are as many as alternate: with the loads of a motion, and without."""
    if len(kept) >= _ALTERNATING:
        kept.clear()


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
    level : array, shape (free constraint,)
        The free coordinates at the zero of the state.
    changes : array of long double, shape (free constraint,)
        Changes of their velocities by unit impulses.
    kernel : rigid_state.Structure
        What the compiled loop takes.
    arguments : tuple
        The same as `kernels.rigid_motion.follow` takes it.
    reaches : dict
        What is known of errors of the outputs at some degrees of freedom (`stated_errors.Reach`).
    """

    basis: Basis
    contacts: tuple[Contact, ...]
    answers: Floats
    idle: frozenset[Contact]
    free: tuple[int, ...]
    level: Floats
    changes: NDArray[np.longdouble]
    kernel: rigid_state.Structure
    arguments: tuple[Any, ...]
    reaches: dict[bytes, Any] = field(default_factory=dict)

    @property
    def forces(self) -> tuple[Floats, Floats]:
        """The forms of the contact forces, shape (contact, 2, pair), and their levels."""
        first, kernel = len(self.free), self.kernel
        return kernel.watched.coordinate[first:], kernel.walls["lower"][first:]

    def between(self, constraints: Sequence[Constraint]) -> Configuration:
        """Return the configuration with the free coordinates between the walls of constraints."""
        limits, count = [constraints[i] for i in self.free], len(self.free)
        lower, upper = places = _places(limits)
        walls = self.kernel.walls.copy()
        of_free = walls[:count]
        of_free["lower"], of_free["upper"] = lower + self.level, upper - self.level
        largest = np.where(np.isfinite(places), np.abs(places), 0.0).max(axis=0, initial=0.0)
        of_free["size"] = largest + np.abs(self.level)
        of_free["restitution"] = [c.restitution for c in limits]
        of_free["factor"], of_free["factor_rest"] = _quotients(self.changes, of_free["restitution"])
        arguments = rigid_state.between(self.arguments, walls)
        return replace(self, kernel=self.kernel._replace(walls=walls), arguments=arguments)


@dataclass(eq=False, slots=True)
class Shared:
    """What structures share whose limiters differ in the places of walls and in restitution only.

    It is kept beside their body, and does not hold it.
    """

    natural: Spectrum
    forces: Forces
    W: Floats  # (constraint, dof)
    exponent: int  # of the unit of time
    modes: Modes  # without contacts
    mobility: Floats  # (constraint, constraint)
    # The configuration without contacts and the same of `kernels.modal`, their walls not placed
    free: Configuration | None = None
    modal: tuple[Any, ...] | None = None
    # Modes with constraints in contact, and ``M^-1 W^T`` of these
    held: dict[tuple[int, ...], tuple[Modes, Floats]] = field(default_factory=dict)

    @classmethod
    def of(cls, system: System, key: _Key, t_end: float) -> Shared:
        """Return what is kept beside the body of a system, or prepare it."""
        kept = _SHARED.setdefault(system.body, {})
        whole_key = key, system.coordinates
        shared = kept.get(whole_key)
        if shared is None:
            method, load, *_ = key
            shared = cls._prepared(system, method, Forces.of(system, load, t_end), t_end)
            _make_room(kept)
            kept[whole_key] = shared
        return shared

    @classmethod
    def _prepared(
        cls, system: System, method: spectrum.Method, forces: Forces, t_end: float
    ) -> Shared:
        natural = spectrum.spectrum(system, method)
        W = system.directions(range(len(system.constraints)))
        turning = forces.harmonic.frequencies[~forces.slow]
        exponent = exponent_of(np.concatenate([natural.roots, turning]), t_end)
        modes = without_contacts(system, forces, natural)
        rows = W @ modes.shapes
        return cls(natural, forces, W, exponent, modes, np.asarray(rows @ rows.T))


class Structure:
    """A system and its contact configurations, prepared when they are first needed.

    Parameters
    ----------
    system : System
    shared : Shared
        Of a system with the same body, and limiters of the same coordinates.
    """

    def __init__(self, system: System, shared: Shared) -> None:
        self.system, self._shared = system, shared
        self.natural, self.W, self.mobility = shared.natural, shared.W, shared.mobility
        forces = shared.forces
        self.force, self.harmonic_loads, self.ramps = forces.constant, forces.harmonic, forces.ramps
        self.exponent = shared.exponent
        self.scale = math.ldexp(1.0, self.exponent)
        self.limits = _places(system.constraints)
        self._configurations: dict[frozenset[Contact], Configuration] = {}
        self._modal: dict[tuple[Contact, ...], tuple[Any, ...]] = {}
        self.beside: dict[type, Any] = {}
        """What other classes prepare for the structure, by these."""

    @classmethod
    def of(
        cls, system: System, method: spectrum.Method, t_end: float, load: tuple[Load, ...] = ()
    ) -> Structure:
        """Return the structure of a system, with what was prepared for it or with others' walls.

        Parameters
        ----------
        system : System
        method : Method
            How its natural modes are computed.
        t_end : float
            Length of the motion; sets the unit of time where nothing vibrates.
        load : tuple of Load
        """
        slow = frozenset(term for term in load if turns_slowly(term, t_end))
        turning = any(
            isinstance(term, Harmonic) and term.frequency > 0.0 for term in {*load} - slow
        )
        unit = 0.0 if turning or system.K.data.any() else t_end  # that alone gives the unit of time
        key = (method, load, slow, unit)
        structures = _PREPARED.setdefault(system, {})
        structure = structures.get(key)
        if structure is None:
            # A copy: a structure that held its own key would never be forgotten.
            structure = cls(copy.copy(system), Shared.of(system, key, t_end))
            _make_room(structures)
            structures[key] = structure
        return structure  # another thread may have cleared it by now

    def configuration(self, contacts: frozenset[Contact] = frozenset()) -> Configuration:
        """Return the configuration with some constraints in contact."""
        configuration = self._configurations.get(contacts)
        if configuration is None:
            fixed = tuple(sorted(contacts))
            unplaced = self._held(fixed) if fixed else self._free()
            configuration = unplaced.between(self.system.constraints)
            self._configurations[contacts] = configuration
        return configuration

    def _free(self) -> Configuration:
        """Return the configuration without contacts, its walls not placed."""
        shared = self._shared
        if shared.free is None:
            shared.free = self._watched(Basis(shared.modes, self.exponent), ())
        return shared.free

    def _held(self, contacts: tuple[Contact, ...]) -> Configuration:
        """Return a configuration with contacts, the walls of the others not placed."""
        contact_forces.require_independent(self.mobility, contacts)
        held, system = tuple(index for index, _ in contacts), self.system
        W, kept = self.W[[*held]], self._shared.held
        if held not in kept:
            solved = self.mass_solve(np.ascontiguousarray(W.T))
            kept[held] = with_contacts(system, self._shared.forces, W), solved
        modes, solved = kept[held]
        modes = placed(
            modes, system, self._shared.forces, contact_forces.at_walls(system, contacts, W, solved)
        )
        return self._watched(Basis(modes, self.exponent), contacts)

    def displacements(
        self, configuration: Configuration, z: Floats, *, level: bool = True
    ) -> tuple[Floats, Floats]:
        """Return displacements and velocities (in the basis' time) of a state, each (dof,)."""
        basis, modes = configuration.basis, configuration.basis.modes
        x, v = np.array(basis.coordinates(z)) @ modes.shapes.T
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
        q, rate = np.array([place, v]) @ modes.weighted  # one pass over a large matrix
        return basis.pairs_of(q if loads is None else q - basis.still, rate, loads)

    def level(self, configuration: Configuration) -> Floats:
        """Return the free coordinates at the zero of the state, shape (constraint,)."""
        rows = self.W[list(configuration.free)]
        modes = configuration.basis.modes
        return np.asarray(configuration.basis.level(rows @ modes.shapes) + rows @ modes.base)

    @property
    def shapes(self) -> Floats:
        """The modes without contacts as columns, shape (dof, mode)."""
        return self._shared.modes.shapes

    @cached_property
    def narrowest_gap(self) -> float:
        """The smallest distance between the two walls of a coordinate, infinite for one wall."""
        return float(self.limits.sum(axis=0).min(initial=np.inf))

    def modal(self, configuration: Configuration, dofs: Integers) -> tuple[Any, ...]:
        """Return how kernels convert states and displacements of some dofs (`kernels.modal`)."""
        known = self._modal.get(configuration.contacts)
        if known is None:
            known = None if configuration.contacts else self._shared.modal
            if known is None:
                known = modal_kernels.handed_over(self._modes_of(configuration))
            if not configuration.contacts:
                self._shared.modal = known
            known = self._modal[configuration.contacts] = modal_kernels.between(known, self.limits)
        if dofs.size == self.system.n and bool((dofs[1:] > dofs[:-1]).all()):
            return known
        sizes, (weighted, shapes, *matrices), base, *rest = known
        return sizes, (weighted, shapes[dofs], *matrices), base[dofs], *rest

    def level_energy(self, configuration: Configuration) -> float:
        """Return the energy where all modal coordinates are zero."""
        base = configuration.basis.modes.base
        if not base.any():
            return 0.0
        return float(base @ (0.5 * (self.system.K @ base) - self.force))

    def _modes_of(self, configuration: Configuration) -> modal_kernels.Modal:
        basis, (lower, upper) = configuration.basis, self.limits
        modes = basis.modes
        roots = modes.roots * (1.0 + modes.rests)
        return modal_kernels.Modal(
            self.scale, self.level_energy(configuration), modes.weighted, modes.shapes, modes.base,
            basis.still, basis.stretch, basis.delta, roots * np.abs(roots), modes.load,
            basis.place, basis.others, basis.made_by_others(), basis.start_of_others(), self.W,
            lower, upper,
        )  # fmt: skip

    def mass_solve(self, b: Floats) -> Floats:
        """Return ``M^-1 b``; what has no mass follows."""
        return np.asarray(condensation.solve_mass(self.system)(b))

    def _watched(self, basis: Basis, contacts: tuple[Contact, ...]) -> Configuration:
        """Return a configuration whose walls are not placed."""
        modes, fixed = basis.modes, {index for index, _ in contacts}
        free = tuple(i for i in range(len(self.W)) if i not in fixed)
        W, count = self.W[list(free)], len(free)
        rows = W @ modes.shapes
        level = np.asarray(basis.level(rows) + W @ modes.base)
        forms, slopes, kicks = basis.displacement(rows), basis.velocity(rows), basis.kick(rows)
        walls = np.zeros(count + len(contacts), rigid_state.WALL)
        answers, idle = np.zeros((0, count)), np.zeros(0, dtype=np.bool_)
        opens = np.full((2, count), rigid_state.NEVER)
        if contacts:
            held = self.W[[index for index, _ in contacts]]
            press, press_level, idle = contact_forces.force_forms(
                self.system, self._shared.forces, held, basis, contacts
            )
            answers = contact_forces.answers(self.mobility, free, contacts)
            opens = contact_forces.opening(press, kicks, answers)
            if basis.longest < np.inf:  # sums of growing kicks would lose their digits
                opens[:] = rigid_state.MAYBE
            opens[:, (answers[idle] != 0.0).any(axis=0)] = rigid_state.MAYBE  # they are struck, too
            forms = np.concatenate([forms, press])
            slopes = np.concatenate([slopes, basis.rates_of(press)])
            kicks = np.concatenate([kicks, np.zeros_like(press)])
            of_forces = walls[count:]
            of_forces["lower"], of_forces["upper"] = press_level, np.inf
            of_forces["size"], of_forces["restitution"] = np.abs(press_level), -1.0
        walls["opens_lower"][:count], walls["opens_upper"][:count] = opens
        mobility = np.zeros((walls.size, walls.size))
        mobility[:count, :count] = rows @ rows.T
        drifting = basis.drift(kicks)
        walls["acceleration"] = (slopes * drifting).sum(axis=(1, 2))
        high, size, low = (np.ascontiguousarray(part) for part in basis.weight(forms))
        watched = Watched(forms, slopes, kicks, drifting, size, high, low)
        errors = errors_of(basis, watched)
        kernel = rigid_state.Structure(basis.flow, watched, walls, mobility, errors)
        without_force = frozenset(itertools.compress(contacts, idle))
        return Configuration(
            basis, contacts, answers, without_force, free, level,
            _changes(slopes[:count], kicks[:count]), kernel, rigid_state.handed_over(kernel),
        )  # fmt: skip


def _places(constraints: Sequence[Constraint]) -> Floats:
    """Return distances to lower and upper walls, infinite where there is none, (2, constraint)."""
    each = [[math.inf if w is None else w for w in (c.lower, c.upper)] for c in constraints]
    return np.array(each).reshape(len(each), 2).T.copy()


def errors_of(basis: Basis, watched: Watched) -> rigid_state.Errors:
    """Return the sizes of the errors that deviations stand for."""
    forms, slopes, kicks = watched.coordinate, watched.velocity, watched.kick
    form_errors, slope_errors, kick_errors = basis.form_errors(forms, slopes, kicks)
    drift = float(np.abs(basis.drifts).max(initial=0.0))
    doubts, still = basis.doubts
    return rigid_state.Errors(
        basis.signs, basis.drifts, kick_errors, form_errors, slope_errors, basis.own,
        basis.measure, doubts, basis.carried, basis.load_places, still, drift,
    )  # fmt: skip


def _changes(slopes: Floats, kicks: Floats) -> NDArray[np.longdouble]:
    """Return the changes of velocity by unit impulses, shape (free,)."""
    each = zip(slopes.astype(np.longdouble), kicks, strict=True)
    return np.array([(slope * kick).sum() for slope, kick in each], dtype=np.longdouble)


def _quotients(changes: NDArray[np.longdouble], restitution: Floats) -> tuple[Floats, Floats]:
    """Return (1 + restitution) over the change of velocity by a unit impulse, as two doubles each.

    What is rounded in the quotient, or in the forms and not in the quotient, would change the
    energy by the same part of itself at every impact. Of a coordinate that contacts hold it is 0.
    """
    exact = np.zeros_like(changes)
    np.divide(1 + restitution.astype(np.longdouble), changes, out=exact, where=changes > 0)
    factor = exact.astype(np.float64)
    return factor, (exact - factor).astype(np.float64)
