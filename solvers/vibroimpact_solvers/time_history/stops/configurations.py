"""A structure in each state of its stops: its modes, what is watched, and how states carry over.

With some stops loaded the structure is linear, with ``K + sum k w w^T``, ``C + sum c w w^T`` and
the load ``k wall w``. Its coordinates are displacements from a place where the springs of the
loaded stops have no force, so that indentations are forms of the state without a constant, and
keep their digits at stiff stops.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.kernels import rigid_state
from vibroimpact_solvers.kernels.flow import Z2, Watched
from vibroimpact_solvers.laws import Linear
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.time_history.basis import Basis, Modes, exponent_of
from vibroimpact_solvers.time_history.structure import Structure, errors_of

OPEN: Final = 0
LOADED: Final = 1
RELEASED: Final = 2
"""States of a stop; with the sign of its side where it is not open."""
States = tuple[int, ...]

_ROUNDED: Final = 8.0  # roundings of sums that modes of configurations are made of
_WIDE: Any = np.longdouble


@dataclass(frozen=True, eq=False, slots=True)
class _Modes:
    """Modes with springs at some constraints, relative to the modes of the open structure.

    Parameters
    ----------
    vectors : array, shape (mode, mode)
    rows : array, shape (constraint, mode)
        What they make of the constrained coordinates.
    equations : Modes
        Without a constant load.
    """

    vectors: Floats
    rows: Floats
    equations: Modes


@dataclass(frozen=True, eq=False, slots=True)
class Placed:
    """A basis with given stops loaded.

    Parameters
    ----------
    basis : Basis
    vectors : array, shape (mode, mode)
        Its modes in those of the open structure.
    origin : array, shape (mode,)
        Modal coordinates of the open structure at the zero of the state.
    rows : array, shape (constraint, mode)
        The constrained coordinates by its modes.
    levels : array, shape (constraint,)
        Constrained coordinates at the zero of the state.
    indentations : array, shape (constraint,)
        Of loaded stops, at the zero of the state.
    terms : array, shape (mode,)
        Magnitudes of what the deflections under constant loads are the sum of.
    mixing : array, shape (pair, pair), optional
        Share of other pairs in each pair by the errors of complex modes; absent: there are none.
    """

    basis: Basis
    vectors: Floats
    origin: Floats
    rows: Floats
    levels: Floats
    indentations: Floats
    terms: Floats
    mixing: Floats | None

    def mixed(self, states: Floats) -> Floats | float:
        """Return what errors of complex modes make of states (..., 2, pair): absolute errors."""
        if self.mixing is None:
            return 0.0
        lengths = np.abs(states).sum(axis=-2, keepdims=True)
        return np.asarray(lengths @ self.mixing.T)

    def sizes_of(self, terms: Floats) -> Floats:
        """Return what modal coordinates of these magnitudes make of a state, flattened."""
        none = np.zeros(terms.size)
        units = np.diag(terms)
        return np.asarray(sum(np.abs(self.basis.pairs_of(unit, none)).ravel() for unit in units))


@dataclass(frozen=True, eq=False, slots=True)
class Scene:
    """The structure in one state of its stops.

    Parameters
    ----------
    states : tuple of int
        Of each constraint: `OPEN`, or `LOADED` or `RELEASED` times the side.
    placed : Placed
    forces : tuple of int
        The constraints whose forces are watched, after all coordinates.
    kernel : rigid_state.Structure
    arguments : tuple
        The same as kernels take it.
    rises : array, shape (watched,)
        What constant loads on free bodies add to the rates of the watched forms.
    """

    states: States
    placed: Placed
    forces: tuple[int, ...]
    kernel: rigid_state.Structure
    arguments: tuple[Any, ...]
    rises: Floats

    def workspace(self) -> tuple[Any, ...]:
        """Return new work arrays of kernels."""
        modes = self.basis.modes.roots.size
        return rigid_state.workspace(self.basis.pairs, self.kernel.walls.size, modes, 0)

    @property
    def basis(self) -> Basis:
        """The pairs of its states."""
        return self.placed.basis

    def force_form(self, constraint: int) -> tuple[Floats, float]:
        """Return the form of the force of a stop that is not open, and its level."""
        place = len(self.states) + self.forces.index(constraint)
        wall = self.kernel.walls[place]
        loaded = abs(self.states[constraint]) == LOADED
        level = float(wall["lower"] if loaded else -wall["upper"])
        return self.kernel.watched.coordinate[place], level


@dataclass(frozen=True, eq=False, slots=True)
class Passage:
    """How states carry over from one scene to another: ``matrix z + offset``, flattened.

    Parameters
    ----------
    matrix : array, shape (2 pair, 2 pair)
    offset : array, shape (2 pair,)
    terms : array, shape (2 pair,)
        Magnitudes of what the offset is the sum of.
    """

    matrix: Floats
    offset: Floats
    terms: Floats
    sizes: Floats = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "sizes", np.abs(self.matrix))

    def rounding(self, z: Floats) -> Floats:
        """Return the magnitudes of what a state that is carried over is the sum of."""
        return np.asarray(self.sizes @ np.abs(z) + self.terms)


class StoppedStructure:
    """A structure with stops of finite stiffness, in the states that its motions reach.

    Parameters
    ----------
    structure : Structure
        The structure that no stop touches.
    """

    def __init__(self, structure: Structure) -> None:
        self.structure, self.system = structure, structure.system
        open_modes = structure.configuration().basis.modes
        self.shapes = open_modes.shapes
        self.rows: Floats = structure.W @ self.shapes
        # What rounding makes of a zero would be a spring, however soft, on a body that has none.
        terms = np.abs(structure.W) @ np.abs(self.shapes)
        self.rows[np.abs(self.rows) <= _ROUNDED * EPS * terms] = 0.0
        self.mobility: Floats = (self.rows**2).sum(axis=1)
        laws = [c.law for c in self.system.constraints if isinstance(c.law, Linear)]
        assert len(laws) == len(self.rows)
        self.stiffness = np.array([law.stiffness for law in laws], dtype=np.float64)
        masses = 1.0 / self.mobility
        self.damping = np.array(
            [law.damping_with(mass) for law, mass in zip(laws, masses.tolist(), strict=True)],
            dtype=np.float64,
        )
        self.walls = structure.limits
        fastest = math.sqrt(float((self.stiffness * self.mobility).sum()))
        self.exponent = max(structure.exponent, exponent_of(np.array([fastest]), 1.0))
        if fastest == 0.0:
            self.exponent = structure.exponent
        self.scale = math.ldexp(1.0, self.exponent)
        wide = open_modes.roots.astype(_WIDE) * (1 + open_modes.rests.astype(_WIDE))
        self.eigenvalues = wide * np.abs(wide)
        count = open_modes.roots.size
        self._modes: dict[tuple[int, ...], _Modes] = {
            (): _Modes(np.eye(count), self.rows, open_modes)
        }
        self._placed: dict[tuple[tuple[int, int], ...], Placed] = {}
        self._scenes: dict[States, Scene] = {}
        self._passages: dict[tuple[States, States], Passage] = {}

    def acts(self, constraint: int) -> bool:
        """Whether a stop has any force."""
        return bool(self.stiffness[constraint] > 0.0 or self.damping[constraint] > 0.0)

    def wall(self, constraint: int, side: int) -> float:
        """Return the distance of a wall from the zero of its coordinate."""
        return float(self.walls[1 if side > 0 else 0, constraint])

    # -- modes --

    def _with_springs(self, loaded: tuple[int, ...]) -> _Modes:
        known = self._modes.get(loaded)
        if known is None:
            known = self._modes[loaded] = self._stiffened(loaded)
        return known

    def _stiffened(self, loaded: tuple[int, ...]) -> _Modes:
        """Return the modes with springs and dashpots at some constraints."""
        free = self._modes[()].equations
        ascending = np.argsort(self.eigenvalues, kind="stable")
        others = [a for a in range(len(self.rows)) if a not in loaded]
        order = [*loaded, *others]
        k, c = self.stiffness[[*loaded]], self.damping[[*loaded]]
        new = spectrum.stiffened(
            self.eigenvalues[ascending], self.rows[order][:, ascending], k.tolist()
        )
        vectors, rows = np.empty_like(new.vectors), np.empty_like(new.rows)
        vectors[ascending], rows[order] = new.vectors, new.rows
        exact = np.sign(new.eigenvalues) * np.sqrt(np.abs(new.eigenvalues))
        roots = exact.astype(np.float64)
        rests = np.where(roots == 0.0, 0.0, (exact - roots) / np.where(roots == 0.0, 1.0, roots))
        own, squares = rows[[*loaded]] ** 2, vectors**2
        terms = squares.T @ np.abs(self.eigenvalues).astype(np.float64) + k @ own
        errors = squares.T @ free.errors + _ROUNDED * EPS * terms
        damping, damping_errors = self._damped(vectors, rows[[*loaded]], c)
        equations = replace(
            free,
            roots=roots,
            rests=rests.astype(np.float64),
            damping=damping,
            load=np.zeros(roots.size),
            cosine=vectors.T @ free.cosine,
            sine=vectors.T @ free.sine,
            ramps=vectors.T @ free.ramps,
            shapes=free.shapes @ vectors,
            weighted=free.weighted @ vectors,
            errors=errors,
            damping_errors=damping_errors,
            shape_error=free.shape_error + 2.0 * _ROUNDED * EPS,
        )
        return _Modes(vectors, rows, equations)

    def _damped(self, vectors: Floats, rows: Floats, c: Floats) -> tuple[Floats | None, Floats]:
        """Return the damping of modes with dashpots along rows, and the errors of its diagonal.

        Couplings that may be rounding are left out.
        """
        free, n = self._modes[()].equations, vectors.shape[1]
        if free.damping is None and not c.any():
            return None, np.zeros(n)
        damping = sizes = np.zeros((n, n))
        if free.damping is not None and free.damping.size:
            magnitudes = np.abs(vectors)
            damping = vectors.T @ free.damping @ vectors
            sizes = magnitudes.T @ np.abs(free.damping) @ magnitudes
        damping = np.where(np.abs(damping) <= _ROUNDED * EPS * sizes, 0.0, damping)
        errors = (vectors**2).T @ free.damping_errors + _ROUNDED * EPS * sizes.diagonal()
        return damping + (rows.T * c) @ rows, errors + _ROUNDED * EPS * (c @ rows**2)

    def placed(self, loaded: tuple[tuple[int, int], ...]) -> Placed:
        """Return the basis with given stops loaded, each by its constraint and side."""
        known = self._placed.get(loaded)
        if known is None:
            known = self._placed[loaded] = self._place(loaded)
        return known

    def _place(self, loaded: tuple[tuple[int, int], ...]) -> Placed:
        which = tuple(index for index, _ in loaded)
        modes, free = self._with_springs(which), self._modes[()].equations
        force, vectors, rows = free.load, modes.vectors, modes.rows
        load, origin = vectors.T @ force, np.zeros(force.size)
        terms = np.abs(vectors).T @ np.abs(force)
        apart = np.zeros(len(self.rows))
        if loaded:
            # The origin is where the coordinates of loaded stops are at their walls.
            own, k = self.rows[[*which]], self.stiffness[[*which]]
            at = np.array([side * self.wall(index, side) for index, side in loaded])
            among = own @ own.T
            push = np.linalg.lstsq(among, at, rcond=None)[0]
            origin = own.T @ push
            missed = own @ origin - at
            missed[np.abs(missed) <= _ROUNDED * EPS * (np.abs(own) @ np.abs(origin))] = 0.0
            here = rows[[*which]]
            held, sizes = self._held(modes, own, here, k, push)
            load = load - held - (k * missed) @ here
            terms += sizes + np.abs(k * missed) @ np.abs(here)
            apart[[*which]] = [side * m for (_, side), m in zip(loaded, missed, strict=True)]
        equations = modes.equations
        rigid = equations.roots == 0.0
        small = np.abs(load) <= 1e-13 * (np.abs(vectors).T @ (np.abs(force)))
        load = np.where(rigid & small, 0.0, load)
        basis = Basis(replace(equations, load=load, base=self.shapes @ origin), self.exponent)
        size = np.abs(equations.roots) ** 2
        still = np.where(rigid, 0.0, terms / np.where(rigid, 1.0, size))
        moved = rows @ basis.still
        levels = self.rows @ origin + moved
        sides = np.zeros(len(self.rows))
        sides[[*which]] = [side for _, side in loaded]
        mixing = basis.mixing[0] if basis.vector_error > 0.0 else None
        return Placed(basis, vectors, origin, rows, levels, apart + sides * moved, still, mixing)

    def _held(
        self, modes: _Modes, own: Floats, here: Floats, k: Floats, push: Floats
    ) -> tuple[Floats, Floats]:
        """Return ``V^T Lambda own^T push``, the forces that hold the origin, and their terms.

        As it stands, or by ``own Lambda V = here mu - own own^T k here``, the equation of the
        eigenvectors: the terms of one or the other are smaller.
        """
        stiffness = self.eigenvalues.astype(np.float64)
        mu = modes.equations.roots * np.abs(modes.equations.roots)
        pull, among = stiffness * (own.T @ push), own @ own.T
        direct, sizes = modes.vectors.T @ pull, np.abs(modes.vectors).T @ np.abs(pull)
        springs = k[:, np.newaxis] * here
        other = push @ (here * mu - among @ springs)
        others = np.abs(push) @ (np.abs(here * mu) + np.abs(among) @ np.abs(springs))
        return np.where(sizes <= others, direct, other), np.minimum(sizes, others)

    # -- scenes --

    def scene(self, states: States) -> Scene:
        """Return the structure in a state of its stops."""
        known = self._scenes.get(states)
        if known is None:
            known = self._scenes[states] = self._scene(states)
        return known

    def _scene(self, states: States) -> Scene:
        loaded = tuple(
            (a, 1 if code > 0 else -1) for a, code in enumerate(states) if abs(code) == LOADED
        )
        placed, basis = self.placed(loaded), self.placed(loaded).basis
        forces = tuple(a for a, code in enumerate(states) if code != OPEN)
        moves, slides = basis.displacement(placed.rows), basis.velocity(placed.rows)
        kicks = basis.kick(placed.rows)
        count = len(states)
        walls = np.zeros(count + len(forces), rigid_state.WALL)
        walls["restitution"], walls["lower"], walls["upper"] = -1.0, np.inf, np.inf
        for a, code in enumerate(states):
            self._set_walls(walls[a : a + 1], a, code, placed.levels[a])
        form_rows, slope_rows = [*moves], [*slides]
        for place, a in enumerate(forces, start=count):
            form, wall = self._force(placed, a, states[a], moves[a], slides[a])
            form_rows.append(form)
            slope_rows.append(basis.rates_of(form))
            walls["size"][place] = abs(wall) + self.stiffness[a] * float(
                np.abs(placed.rows[a]) @ placed.terms
            )
            if abs(states[a]) == LOADED:
                walls["lower"][place] = wall
            else:
                walls["upper"][place] = -wall
                walls["size"][place] += self.stiffness[a] * abs(self.wall(a, states[a]))
        forms, slopes = np.array(form_rows), np.array(slope_rows)
        every = np.concatenate([kicks, np.zeros((len(forces), *kicks.shape[1:]))])
        high, size, low = (np.ascontiguousarray(part) for part in basis.weight(forms))
        watched = Watched(forms, slopes, every, basis.drift(every), size, high, low)
        kernel = rigid_state.Structure(
            basis.flow, watched, walls, np.zeros((walls.size, walls.size)),
            errors_of(basis, watched),
        )  # fmt: skip
        rises = forms[:, Z2] @ basis.push
        return Scene(states, placed, forces, kernel, rigid_state.handed_over(kernel), rises)

    def _set_walls(self, wall: rigid_state.Rows, a: int, code: int, level: float) -> None:
        """Set what a coordinate must not pass in a state of its stop."""
        lower, upper = self.walls[0, a], self.walls[1, a]
        if abs(code) == LOADED or not self.acts(a):
            return  # its force is watched; or nothing is
        if code == RELEASED:
            lower, upper = -upper, math.inf
        elif code == -RELEASED:
            lower, upper = math.inf, -lower
        wall["lower"], wall["upper"] = lower + level, upper - level
        finite = [abs(d) for d in (lower, upper) if math.isfinite(d)]
        wall["size"] = max(finite, default=0.0) + abs(level)

    def _force(
        self, placed: Placed, a: int, code: int, moves: Floats, slides: Floats
    ) -> tuple[Floats, float]:
        """Return the form ``k d + c d'`` of a stop's force and its value at the zero of states."""
        side = 1 if code > 0 else -1
        k, c = self.stiffness[a], self.damping[a]
        form = side * (k * moves + (c * self.scale) * slides)
        if abs(code) == LOADED:
            return form, float(k * placed.indentations[a])
        return form, float(k * (side * placed.levels[a] - self.wall(a, side)))

    # -- from scene to scene --

    def passage(self, before: Scene, after: Scene) -> Passage:
        """Return how states carry over from one scene to another, displacements unchanged."""
        key = before.states, after.states
        known = self._passages.get(key)
        if known is None:
            known = self._passages[key] = self._passage(before.placed, after.placed)
        return known

    def _passage(self, before: Placed, after: Placed) -> Passage:
        one, other = before.basis, after.basis
        if one is other:
            size = 2 * one.pairs
            return Passage(np.eye(size), np.zeros(size), np.zeros(size))
        turn = after.vectors.T @ before.vectors
        shift = turn @ one.still + after.vectors.T @ (before.origin - after.origin) - other.still

        def carried(z: Floats) -> Floats:
            q, rate = one.coordinates(z)
            return other.pairs_of(turn @ q + shift, turn @ rate, one.loads_of(z)).ravel()

        size = 2 * one.pairs
        offset = carried(np.zeros((2, one.pairs)))
        units = np.eye(size).reshape(size, 2, one.pairs)
        columns = np.empty((size, 2 * other.pairs))
        for row, unit in zip(columns, units, strict=True):
            look()
            row[:] = carried(unit) - offset
        terms = np.abs(turn) @ before.terms + after.terms
        terms += np.abs(after.vectors).T @ (np.abs(before.origin) + np.abs(after.origin))
        return Passage(np.ascontiguousarray(columns.T), offset, after.sizes_of(terms))

    def initial_states(self, y: Floats, rate: Floats) -> States:
        """Return the states of stops at coordinates and velocities, each shape (constraint,)."""
        return tuple(self._initial(a, float(y[a]), float(rate[a])) for a in range(y.size))

    def _initial(self, a: int, y: float, rate: float) -> int:
        for side in (1, -1) if self.acts(a) else ():
            indentation, speed = side * y - self.wall(a, side), side * rate
            if indentation > 0.0 or (indentation == 0.0 and speed > 0.0):
                force = self.stiffness[a] * indentation + self.damping[a] * speed
                return side * (LOADED if force >= 0.0 else RELEASED)
        return OPEN
