"""Modes of a structure with some of its stops of finite stiffness loaded.

With some stops loaded the structure is linear, with ``K + sum k w w^T``, ``C + sum c w w^T`` and
the load ``k wall w``. Its coordinates are displacements from a place where the springs of the
loaded stops have no force, so that indentations are forms of the state without a constant, and
keep their digits at stiff stops.

With a residual flexibility in series (`vibroimpact_solvers.flexibility`) the springs of loaded
stops are a full matrix, and each of them displaces the limited coordinates, its own and others'.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.errors import PlanError
from vibroimpact_solvers.flexibility import Series
from vibroimpact_solvers.laws import Linear
from vibroimpact_solvers.time_history.basis import Basis, Modes, exponent_of
from vibroimpact_solvers.time_history.stops.courses import Course
from vibroimpact_solvers.time_history.structure import Structure

_ROUNDED: Final = 8.0  # roundings of sums that modes of configurations are made of
_WIDE: Any = np.longdouble


@dataclass(frozen=True, eq=False, slots=True)
class _Modes:
    """Modes with springs at some constraints, relative to the modes of the open structure.

    Parameters
    ----------
    vectors : array, shape (mode, mode)
    rows : array, shape (constraint, mode)
        ``w^T E`` of the constrained coordinates.
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
        The constrained coordinates by its modes, displaced by residual flexibilities.
    levels : array, shape (constraint,)
        Constrained coordinates at the zero of the state.
    indentations : array, shape (constraint,)
        Of loaded stops, at the zero of the state.
    terms : array, shape (mode,)
        Magnitudes of what the deflections under constant loads are the sum of.
    mixing : array, shape (pair, pair), optional
        Share of other pairs in each pair by the errors of complex modes; absent: there are none.
    course : Course
        How walls move, displaced by residual flexibilities as the coordinates are.
    """

    basis: Basis
    vectors: Floats
    origin: Floats
    rows: Floats
    levels: Floats
    indentations: Floats
    terms: Floats
    mixing: Floats | None
    course: Course
    _sizes: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        none, units = np.zeros(self.terms.size), np.eye(self.terms.size)
        each = [np.abs(self.basis.pairs_of(unit, none)).ravel() for unit in units]
        object.__setattr__(self, "_sizes", np.array(each))

    def mixed(self, states: Floats) -> Floats | float:
        """Return what errors of complex modes make of states (..., 2, pair): absolute errors."""
        if self.mixing is None:
            return 0.0
        lengths = np.abs(states).sum(axis=-2, keepdims=True)
        return np.asarray(lengths @ self.mixing.T)

    def sizes_of(self, terms: Floats) -> Floats:
        """Return what modal coordinates of these magnitudes make of a state, flattened."""
        return np.asarray(terms @ self._sizes)


class StoppedModes:
    """A structure with stops of finite stiffness, and its modes with some of them loaded.

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
        self.series = Series(self.stiffness, self.system.flexibility)
        masses = 1.0 / self.mobility
        self.damping = np.array(
            [law.damping_with(mass) for law, mass in zip(laws, masses.tolist(), strict=True)],
            dtype=np.float64,
        )
        self.walls = structure.limits
        self.course = Course.of(structure)
        springs = self.series.springs(range(len(laws)))
        fastest = math.sqrt(float(((springs @ self.rows) * self.rows).sum()))
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

    def forget(self) -> None:
        """Let go of the modes with loaded stops."""
        self._modes = {(): self._modes[()]}
        self._placed = {}

    def acts(self, constraint: int) -> bool:
        """Whether a stop has any force."""
        return bool(self.stiffness[constraint] > 0.0 or self.damping[constraint] > 0.0)

    def modal(self, x: Any) -> Any:
        """Return displacements (…, dof) in coordinates of the open structure's modes."""
        return x @ (self.system.M @ self.shapes)

    def wall(self, constraint: int, side: int) -> float:
        """Return the distance of a wall from the zero of its coordinate."""
        return float(self.walls[1 if side > 0 else 0, constraint])

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
        order, count = [*loaded, *others], len(loaded)
        c, (k, axes) = self.damping[[*loaded]], self.series.axes(loaded)
        given = self.rows[order]
        if axes is not None:
            given[:count] = axes.T @ given[:count]
        new = spectrum.stiffened(self.eigenvalues[ascending], given[:, ascending], k.tolist())
        vectors, rows = np.empty_like(new.vectors), np.empty_like(new.rows)
        vectors[ascending], along = new.vectors, new.rows[:count].copy()
        if axes is not None:
            new.rows[:count] = axes @ along
        rows[order] = new.rows
        exact = np.sign(new.eigenvalues) * np.sqrt(np.abs(new.eigenvalues))
        roots = exact.astype(np.float64)
        rests = np.where(roots == 0.0, 0.0, (exact - roots) / np.where(roots == 0.0, 1.0, roots))
        own, squares = along**2, vectors**2
        terms = squares.T @ np.abs(self.eigenvalues).astype(np.float64) + k @ own
        errors = squares.T @ free.errors + _ROUNDED * EPS * terms
        damping, damping_errors = self._damped(vectors, rows[[*loaded]], c)
        # Springs and dashpots of walls that move are loads.
        pull = self.course.pull(loaded, self.series.springs(loaded), c)
        cosine, sine, ramps = (rows[[*loaded]].T @ part for part in pull)
        equations = replace(
            free,
            roots=roots,
            rests=rests.astype(np.float64),
            damping=damping,
            load=np.zeros(roots.size),
            cosine=vectors.T @ free.cosine + cosine,
            sine=vectors.T @ free.sine + sine,
            ramps=vectors.T @ free.ramps + ramps,
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
        """Return the basis with given stops loaded, each by its constraint and side.

        Raises
        ------
        PlanError
            Where modes cannot be told apart, those of the open structure or with a stop loaded.
        """
        known = self._placed.get(loaded)
        if known is None:
            try:
                known = self._placed[loaded] = self._place(loaded)
            except PlanError as error:
                if not loaded:
                    raise
                self.placed(())  # what ails the open structure is no fault of a stop
                stiffest = max((index for index, _ in loaded), key=lambda i: self.stiffness[i])
                message = (
                    f"{error.message}, with the stop of constraint {stiffest} loaded: its "
                    "stiffness or damping is too large beside those of the structure"
                )
                raise PlanError(message, ("system", "constraints", stiffest, "law")) from None
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
            own, k = self.rows[[*which]], self.series.springs(which)
            at = np.array([side * self.wall(index, side) for index, side in loaded])
            among = own @ own.T
            push = np.linalg.lstsq(among, at, rcond=None)[0]
            origin = own.T @ push
            missed = own @ origin - at
            missed[np.abs(missed) <= _ROUNDED * EPS * (np.abs(own) @ np.abs(origin))] = 0.0
            here = rows[[*which]]
            held, sizes = self._held(modes, own, here, k, push)
            load = load - held - (k @ missed) @ here
            terms += sizes + (np.abs(k) @ np.abs(missed)) @ np.abs(here)
            apart[[*which]] = [side * m for (_, side), m in zip(loaded, missed, strict=True)]
        equations = modes.equations
        rigid = equations.roots == 0.0
        small = np.abs(load) <= 1e-13 * (np.abs(vectors).T @ (np.abs(force)))
        load = np.where(rigid & small, 0.0, load)
        basis = Basis(replace(equations, load=load, base=self.shapes @ origin), self.exponent)
        size = np.abs(equations.roots) ** 2
        still = np.where(rigid, 0.0, terms / np.where(rigid, 1.0, size))
        # Errors of eigenvalues are those of deflections under constant loads, too.
        missed = np.where(rigid, 0.0, equations.errors / (EPS * np.where(rigid, 1.0, size)))
        still += missed * np.abs(basis.still)
        moved = rows @ basis.still
        levels = self.rows @ origin + moved
        sides = np.zeros(len(self.rows))
        sides[[*which]] = [side for _, side in loaded]
        levels, rows, indentations = self._displaced(which, sides, levels, rows, apart, moved)
        mixing = basis.mixing[0] if basis.vector_error > 0.0 else None
        course = self.course.displaced(self.series.shares(which), which)
        return Placed(basis, vectors, origin, rows, levels, indentations, still, mixing, course)

    def _displaced(
        self, which: tuple[int, ...], sides: Floats, levels: Floats, rows: Floats, apart: Floats,
        moved: Floats,
    ) -> tuple[Floats, Floats, Floats]:  # fmt: skip
        """Return levels, rows and indentations as loaded stops displace the coordinates.

        Without a residual flexibility they displace none.
        """
        indentations = apart + sides * moved
        shares = self.series.shares(which)
        if shares is None:
            return levels, rows, indentations
        some = [*which]
        pushed, displaced = shares @ (sides * indentations)[some], shares @ rows[some]
        levels, rows = levels + pushed, rows + displaced
        for a in which:
            side = 1 if sides[a] > 0.0 else -1
            levels[a], rows[a] = side * self.wall(a, side) + pushed[a], displaced[a]
            indentations[a] = side * pushed[a]
        return levels, rows, indentations

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
        other = push @ (here * mu - among @ (k @ here))
        springs = np.abs(k) @ np.abs(here)
        others = np.abs(push) @ (np.abs(here * mu) + np.abs(among) @ springs)
        return np.where(sizes <= others, direct, other), np.minimum(sizes, others)
