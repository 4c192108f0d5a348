"""A structure prepared for flights: its bases, free or held, and what is watched in them."""

from __future__ import annotations

import math
import weakref
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.linalg

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.model import System
from vibroimpact_solvers.spectrum import Spectrum
from vibroimpact_solvers.time_history.basis import Basis, Modes, exponent_of
from vibroimpact_solvers.time_history.loads import Drive, Harmonic, constant

_EPS: Final = float(np.finfo(np.float64).eps)
Contact = tuple[int, int]
"""A constraint at rest at a wall: its index, and 1 for the upper or -1 for the lower wall."""


_Key = tuple[spectrum.Method, tuple[Harmonic, ...], float]
_PREPARED: weakref.WeakKeyDictionary[System, dict[_Key, Structure]] = weakref.WeakKeyDictionary()


@dataclass(frozen=True, eq=False, slots=True)
class Scene:
    """A basis with everything that is watched in it.

    Parameters
    ----------
    basis : Basis
    contacts : tuple
        The constraints that are held.
    flying : tuple of int
        The constraints that are free, in the order in which they are watched; contact forces
        are watched after them.
    forms, sizes, walls, mobility, bends : array
        As `kernels.flight.fly` takes them.
    """

    basis: Basis
    contacts: tuple[Contact, ...]
    flying: tuple[int, ...]
    forms: Floats
    sizes: Floats
    walls: Floats
    mobility: Floats
    bends: Floats


class Structure:
    """A system and its scenes, made when they are first needed.

    Parameters
    ----------
    system : System
    method : Method
        How its natural modes are found.
    t_end : float
        Length of the motion; sets the unit of time where nothing vibrates.
    load : tuple of Harmonic
    """

    def __init__(
        self, system: System, method: spectrum.Method, t_end: float, load: tuple[Harmonic, ...] = ()
    ) -> None:
        self.system = system
        self.drive = Drive.of(load, system.n)
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
        rates = np.concatenate([self.natural.roots, self.drive.frequencies])
        self.exponent = exponent_of(rates, t_end)
        self.scale = math.ldexp(1.0, self.exponent)
        self._scenes: dict[frozenset[Contact], Scene] = {}
        self._modes = self._free()
        rows = self.W @ self._modes.shapes
        self.mobility = np.asarray(rows @ rows.T)

    @classmethod
    def of(
        cls, system: System, method: spectrum.Method, t_end: float, load: tuple[Harmonic, ...] = ()
    ) -> Structure:
        """Return the structure prepared before for the same system object, or prepare it."""
        known = _PREPARED.setdefault(system, {})
        unit = 0.0 if load or system.K.data.any() else t_end  # that alone gives the unit of time
        key = (method, load, unit)
        found = known.get(key)
        if found is None:
            found = cls(system, method, t_end, load)
            known.clear()  # they are large; loads seldom alternate
            known[key] = found
        return found  # another thread may have cleared it by now

    def scene(self, contacts: frozenset[Contact] = frozenset()) -> Scene:
        """Return the scene with some constraints held."""
        scene = self._scenes.get(contacts)
        if scene is None:
            held = tuple(sorted(contacts))
            modes = self._held(held) if held else self._modes
            scene = self._watched(Basis(modes, self.exponent), held)
            self._scenes[contacts] = scene
        return scene

    def place(self, scene: Scene, z: Floats, *, level: bool = True) -> tuple[Floats, Floats]:
        """Return displacements and velocities (in the basis' time) of a state, each (dof,)."""
        basis, modes = scene.basis, scene.basis.modes
        x, v = np.stack(basis.coordinates(z)) @ modes.shapes.T
        still = modes.base + modes.shapes @ basis.still if basis.still.any() else modes.base
        return (x + still if level else x), v

    def enter(self, scene: Scene, x: Floats, v: Floats, loads: Floats | None = None) -> Floats:
        """Return the state of displacements and velocities (in the basis' time).

        loads is their state; absent where x and v are a deviation.
        """
        basis, modes = scene.basis, scene.basis.modes
        place = x if loads is None else x - modes.base
        q, rate = np.stack([place, v]) @ modes.weighted  # one pass over a large matrix
        return basis.pairs_of(q if loads is None else q - basis.still, rate, loads)

    def level(self, scene: Scene) -> Floats:
        """Return the flying coordinates at the zero of the state, shape (constraint,)."""
        rows = self.W[list(scene.flying)]
        modes = scene.basis.modes
        return np.asarray(scene.basis.level(rows @ modes.shapes) + rows @ modes.base)

    def pressing(self, scene: Scene, z: Floats) -> list[tuple[Contact, float, float]]:
        """Return the contacts, the forces that press them and the roundings of these."""
        first = len(scene.flying)
        found = []
        for k, contact in enumerate(scene.contacts, start=first):
            form, level = scene.forms[0, k], scene.walls[0, k]
            grain = 64.0 * _EPS * float(np.abs(form * z).sum() + abs(level))
            found.append((contact, float((form * z).sum() + level), grain))
        return found

    def push(self, scene: Scene, z: Floats, contact: Contact) -> float:
        """Return the acceleration of a flying constraint towards a wall."""
        index, side = contact
        slope = scene.forms[1, scene.flying.index(index)]
        return side * float((slope * scene.basis.rate(z)).sum())

    def by_mass(self, b: Floats) -> Floats:
        """Return ``M^-1 b``."""
        return np.asarray(self.system.M.factorize()(b))

    def _free(self) -> Modes:
        natural, system = self.natural, self.system
        shapes = natural.modes
        weighted = system.M @ shapes
        rests = np.zeros(natural.roots.size) if natural.rests is None else natural.rests
        still = np.zeros(system.n)
        rounded = natural.norms + (_EPS if natural.rests is None else 0.0)
        errors = natural.uncertainty + rounded * np.abs(natural.eigenvalues)
        errors[natural.roots == 0.0] = 0.0
        return self._equations(natural.roots, rests, shapes, still, weighted, errors, natural.norms)

    def _equations(
        self,
        roots: Floats,
        rests: Floats,
        shapes: Floats,
        base: Floats,
        weighted: Floats,
        errors: Floats,
        spoilt: float,
    ) -> Modes:
        """Return the modal equations of some modes."""
        system = self.system
        damping = None if system.C is None else shapes.T @ (system.C @ shapes)
        force = self.force - (system.K @ base if base.any() else 0.0)
        # A load that is only rounding must not drive a rigid-body mode away.
        load = force @ shapes
        load[np.abs(load) <= 1e-13 * (np.abs(force) @ np.abs(shapes))] = 0.0
        drive = self.drive
        cosine, sine = shapes.T @ drive.cosine, shapes.T @ drive.sine
        return Modes(
            roots, rests, damping, load, drive.frequencies, cosine, sine, shapes, base, weighted,
            errors, spoilt,
        )  # fmt: skip

    def _held(self, contacts: tuple[Contact, ...]) -> Modes:
        """Return the modes of the structure whose held coordinates stay at their walls."""
        system = self.system
        W = self.W[[index for index, _ in contacts]]
        M, K = system.M.to_dense(), system.K.to_dense()
        Z = scipy.linalg.null_space(W)
        # The base is orthogonal to the rest in M, and so has no part in the inertia.
        solved = np.linalg.solve(M, W.T)
        base = solved @ np.linalg.solve(W @ solved, [self.wall(c) for c in contacts])
        eigenvalues, vectors = scipy.linalg.eigh(Z.T @ K @ Z, Z.T @ M @ Z)
        scale = float(np.abs(eigenvalues).max(initial=0.0))
        eigenvalues[np.abs(eigenvalues) <= max(16.0, math.sqrt(system.n)) * _EPS * scale] = 0.0
        shapes = Z @ vectors
        roots = np.sign(eigenvalues) * np.sqrt(np.abs(eigenvalues))
        errors = np.full(roots.size, 4.0 * _EPS * scale)
        return self._equations(
            roots, np.zeros(roots.size), shapes, base, system.M @ shapes, errors, _EPS
        )

    def wall(self, contact: Contact) -> float:
        """Return where the coordinate of a contact is."""
        index, side = contact
        constraint = self.system.constraints[index]
        wall = constraint.upper if side > 0 else constraint.lower
        assert wall is not None
        return side * wall

    def _watched(self, basis: Basis, contacts: tuple[Contact, ...]) -> Scene:
        system, modes = self.system, basis.modes
        held = {index for index, _ in contacts}
        flying = tuple(i for i in range(len(system.constraints)) if i not in held)
        W = self.W[list(flying)]
        rows = W @ modes.shapes
        level = basis.level(rows) + W @ modes.base
        forms, slopes, kicks = basis.displacement(rows), basis.velocity(rows), basis.kick(rows)
        limits = [system.constraints[i] for i in flying]
        lower = np.array([np.inf if c.lower is None else c.lower for c in limits]) + level
        upper = np.array([np.inf if c.upper is None else c.upper for c in limits]) - level
        sizes = np.array(
            [max(abs(w) for w in (c.lower, c.upper) if w is not None) for c in limits]
        ) + np.abs(level)
        restitution = np.array([c.restitution for c in limits])
        if contacts:
            press, press_level = self._pressing(basis, contacts)
            forms = np.concatenate([forms, press])
            slopes = np.concatenate([slopes, basis.rates_of(press)])
            kicks = np.concatenate([kicks, np.zeros_like(press)])
            lower = np.concatenate([lower, press_level])
            upper = np.concatenate([upper, np.full(len(contacts), np.inf)])
            sizes = np.concatenate([sizes, np.abs(press_level)])
            restitution = np.concatenate([restitution, np.full(len(contacts), -1.0)])
        mobility = np.zeros((restitution.size, restitution.size))
        mobility[: len(flying), : len(flying)] = rows @ rows.T
        factor, rest = _quotients(rows, restitution[: len(flying)])
        fill = np.zeros(len(contacts))
        factor, rest = (np.concatenate([part, fill]) for part in (factor, rest))
        jumps = (slopes * basis.drift(kicks)).sum(axis=(1, 2))
        return Scene(
            basis,
            contacts,
            flying,
            np.ascontiguousarray([forms, slopes, kicks, basis.drift(kicks)]),
            basis.weight(forms),
            np.ascontiguousarray([lower, upper, restitution, sizes, factor, rest, jumps]),
            mobility,
            basis.bends(slopes, kicks),
        )

    def _pressing(self, basis: Basis, contacts: tuple[Contact, ...]) -> tuple[Floats, Floats]:
        """Return forms of the forces that press the held constraints, and their levels."""
        system, modes = self.system, basis.modes
        W = self.W[[index for index, _ in contacts]]
        sides = np.array([side for _, side in contacts], dtype=np.float64)
        solve = system.M.factorize()
        solved = solve(np.ascontiguousarray(W.T))
        # The wall's force along W is -(W M^-1 W^T)^-1 W M^-1 (f - K x - C v); a coordinate is
        # pressed with side times its negative.
        onto = sides[:, np.newaxis] * np.linalg.solve(W @ solved, solved.T)
        by_x = -(system.K @ np.ascontiguousarray(onto.T)).T
        level = onto @ self.force + by_x @ modes.base
        rows = by_x @ modes.shapes
        forms = basis.displacement(rows)
        level = level + basis.level(rows)
        if system.C is not None:
            by_v = -(system.C @ np.ascontiguousarray(onto.T)).T @ modes.shapes
            forms = forms + math.ldexp(1.0, basis.exponent) * basis.velocity(by_v)
        forms = forms + basis.drive(onto @ self.drive.cosine, onto @ self.drive.sine)
        return forms, level


def _quotients(rows: Floats, restitution: Floats) -> tuple[Floats, Floats]:
    """Return (1 + restitution) / |row|^2 as two doubles each.

    A rounded quotient would change the energy by the same part of itself at every impact.
    """
    factor, rest = np.empty((2, rows.shape[0]))
    for i, row in enumerate(rows.astype(np.longdouble)):
        exact = (1 + np.longdouble(restitution[i])) / (row @ row)
        factor[i] = exact
        rest[i] = exact - np.longdouble(factor[i])
    return factor, rest
