"""A family of impact modes evaluated by the natural modes of the structure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.impact_modes.direct import largest_displacements
from vibroimpact_solvers.impact_modes.family import Equations, Family, Impulses, Kind
from vibroimpact_solvers.impact_modes.problem import Frequencies, Problem
from vibroimpact_solvers.kernels import families, motions, path_check, response
from vibroimpact_solvers.kernels.threads import over_ranges
from vibroimpact_solvers.spectrum import Spectrum
from vibroimpact_solvers.stability import Orbits, Side

_ROWS = 2**22  # entries of the modal matrix taken at a time
_REACHES = 8  # sets of degrees of freedom whose errors are kept


@dataclass(frozen=True, eq=False, slots=True)
class Amplitudes:
    """Motion of the natural modes: p+ and the arrays of `kernels.families`."""

    omega: Floats
    p: Floats
    D: Floats
    U: Floats
    # Errors of the displacements at all times, in the norm of M, and of the energy, (frequency,)
    motion_error: Floats
    energy_error: Floats
    # An error relative to each displacement, as all have the factor gap over response in common,
    # and the errors in the norm of M beside it, (frequency,)
    factor_error: Floats
    own_error: Floats

    def at(self, chosen: Booleans) -> Amplitudes:
        """Return those of some of the frequencies."""
        return Amplitudes(*(getattr(self, field.name)[chosen] for field in fields(self)))


class ModalFamily:
    """One family, by all natural modes; frequencies and outputs of the problem are not used."""

    def __init__(self, problem: Problem, family: Family, spectrum: Spectrum) -> None:
        self.family, self.spectrum = family, spectrum
        self._reaches = dict[bytes, Floats]()  # by degrees of freedom
        self.equations = family.equations(problem)
        rows, row_errors = spectrum.participations(problem.struck)
        # A rigid-body mode that balances to rounding at a limiter is one that does so exactly.
        row_errors[(rows == 0.0) & (spectrum.roots == 0.0)] = 0.0
        load, load_errors = modal_load(problem, spectrum)
        _require_balance(spectrum.roots, rows, load)
        zeros = np.zeros(spectrum.roots.size)
        # A mode with a node at every constraint takes no part, nor do errors.
        moved = rows.any(axis=0) | row_errors.any(axis=0) | (load != 0.0) | (load_errors != 0.0)
        self.participating = np.flatnonzero(moved)

        def some(values: Floats | None) -> Floats:
            whole = zeros if values is None else values
            return np.ascontiguousarray(whole[..., self.participating])

        self.roots, self.rounding = some(spectrum.roots), some(spectrum.rounding)
        self.errors, self.angles = some(spectrum.errors), some(spectrum.angles)
        self.rows, self.row_errors = some(rows), some(row_errors)
        self.load, self.load_errors = some(load), some(load_errors)

    @property
    def mobility(self) -> Floats:
        """``W M^(-1) W^T``, shape (constraint, constraint)."""
        return np.asarray(self.rows @ self.rows.T)

    def solutions(
        self, at: Frequencies, *, with_motion: bool = True
    ) -> tuple[Impulses, Amplitudes]:
        """Return impulses and motions at some frequencies."""
        return solutions((self,), at, with_motion=with_motion)[0]

    def impulses(self, unknowns: tuple[Floats, ...], errors: tuple[Floats, ...]) -> Impulses:
        """Return the impulses from the unknowns, each (frequency, unknown), and their errors."""
        plus, minus = self.family.sides(unknowns)
        errors_plus, errors_minus = self.family.errors(unknowns, errors)
        both = np.concatenate([plus, minus], axis=1)
        sound = np.isfinite(both).all(axis=1)
        plus = np.where(sound[:, np.newaxis], plus, 0.0)
        minus = np.where(sound[:, np.newaxis], minus, 0.0)
        largest = np.abs(np.where(sound[:, np.newaxis], both, 0.0)).max(axis=1)
        absolute = np.maximum(errors_plus.max(axis=1), errors_minus.max(axis=1))
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = np.where(absolute > 0.0, absolute / largest, 0.0)
        return Impulses(plus, minus, np.where(sound, relative, np.inf))

    def motion_errors(self, motion: Amplitudes, x: Floats, dofs: Integers) -> Floats:
        """Return errors of displacements x, (frequency, …, dof), as (frequency, dof)."""
        key = dofs.tobytes()
        reach = self._reaches.get(key)
        if reach is None:
            if len(self._reaches) >= _REACHES:
                self._reaches.clear()
            reach = self._reaches[key] = self._reach(self.spectrum.rows(dofs))
        apart = motion.own_error[:, np.newaxis] * reach
        sizes = largest_displacements(x) + apart
        with np.errstate(invalid="ignore"):
            errors = apart + motion.factor_error[:, np.newaxis] * sizes
        return np.where(np.isnan(errors), np.inf, errors)

    def energy_errors(self, motion: Amplitudes) -> Floats:
        """Return errors of the energies, shape (frequency,)."""
        return motion.energy_error

    @staticmethod
    def _reach(rows: Floats) -> Floats:
        """Return the roots of ``w . M^-1 w`` of coordinates with given rows of all modes."""
        return np.asarray(np.sqrt(np.square(rows).sum(axis=1)) * (1.0 + 1e-12))

    def displacements(self, motion: Amplitudes, tau: Floats, dofs: Integers) -> Floats:
        """Return displacements, shape (frequency, tau, dof)."""
        return self._to_dofs(motions.coordinates(self._motions(motion), tau), dofs)

    def harmonics(self, motion: Amplitudes, orders: Integers, dofs: Integers) -> Floats:
        """Return Fourier amplitudes, shape (frequency, order, dof)."""
        return self._to_dofs(motions.fourier(self._motions(motion), orders), dofs)

    def _motions(self, motion: Amplitudes, unit: float = 1.0) -> motions.Motions:
        """Return motions as kernels take them, in some unit of length."""
        load, D, U = self.load, motion.D, motion.U
        if unit != 1.0:
            load, D, U = load / unit, D / unit, U / unit
        return motions.Motions(self.roots, load, motion.omega, D, U)

    def _to_dofs(self, q: Floats, dofs: Integers) -> Floats:
        x = np.empty((*q.shape[:2], dofs.size))
        step = max(1, _ROWS // max(self.roots.size, 1))
        for start in range(0, dofs.size, step):
            some = slice(start, start + step)
            x[:, :, some] = q @ self.spectrum.rows(dofs[some])[:, self.participating].T
        return x

    def energy(self, motion: Amplitudes) -> Floats:
        """Return the total energies, shape (frequency,)."""
        return motions.energies(self._motions(motion))

    def orbits(
        self, motion: Amplitudes, at: Frequencies, plus: Floats, minus: Floats, error: Floats
    ) -> Orbits:
        """Return what the stability of the motion depends on.

        `at` are its frequencies, `plus` and `minus` its impulses, (frequency, constraint), and
        `error` is their relative error, shape (frequency,).
        """
        omega, amplitudes = motion.omega, self._motions(motion)
        largest = np.maximum(plus, minus).max(axis=1)

        def side(tau: float, struck: tuple[int, ...], p: Floats) -> Side:
            place, _ = motions.states(amplitudes, tau)
            rows, row_errors = self.rows[list(struck)], self.row_errors[list(struck)]
            # Sums of the two components would cancel where impacts are slow.
            velocity = (p[:, list(struck)] @ rows) / omega[:, np.newaxis]
            size = np.outer(largest / omega, np.abs(rows).sum(axis=0))
            return Side(rows, row_errors, place, velocity, size)

        return Orbits(
            self.roots,
            self.rounding,
            self.load,
            omega,
            at.rounding,
            upper=side(1.0, self.family.upper, plus),
            lower=side(-1.0, self.family.lower, minus),
            mirrored=self.family.kind is Kind.ANTISYMMETRIC,
            other_roots=np.delete(self.spectrum.roots, self.participating),
            root_error=self._root_error(),
            row_error=self.spectrum.norms + EPS,
            error=error,
        )

    @property
    def root_errors(self) -> Floats:
        """Errors of the natural frequencies relative to them; 0 of rigid-body modes, (mode,)."""
        squares = np.square(self.roots)
        return np.divide(0.5 * self.errors, squares, np.zeros(squares.size), where=squares > 0.0)

    def _root_error(self) -> Floats:
        """Return the errors of the participating natural frequencies, rounding apart."""
        errors = self.errors + self.spectrum.norms * np.square(self.roots)
        errors[self.roots == 0.0] = 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = np.where(errors > 0.0, 0.5 * errors / np.abs(self.roots), 0.0)
        slope = np.minimum(slope, np.sqrt(errors))
        return np.asarray(slope if self.spectrum.rounding is not None else slope + EPS * self.roots)

    def check_path(
        self, motion: Amplitudes, error: Floats, problem: Problem
    ) -> tuple[Floats, Booleans]:
        """Return a time at which a limit is exceeded or nan, and whether that is certain.

        `error` is the relative error of the impulses, shape (frequency,).
        """
        constraints = problem.system.constraints
        place = {index: i for i, index in enumerate(problem.active)}
        all_rows = self.spectrum.along(constraints)
        lower = np.array([np.inf if c.lower is None else c.lower for c in constraints])
        upper = np.array([np.inf if c.upper is None else c.upper for c in constraints])
        width = lower + upper
        size = np.where(np.isfinite(width), width, np.maximum(_finite(lower), _finite(upper)))
        size = np.where(size > 0.0, size, 1.0)
        # In units of the largest width no square overflows or underflows.
        unit = float(size.max())
        limits = path_check.Limits(
            np.ascontiguousarray(all_rows[:, self.participating]),
            lower / unit,
            upper / unit,
            np.array([place.get(i) in self.family.lower for i in range(width.size)]),
            np.array([place.get(i) in self.family.upper for i in range(width.size)]),
            self._reach(all_rows),
        )
        doubt = motion.motion_error / unit
        count, scaled = motion.omega.size, self._motions(motion, unit)
        witness, certified = np.empty(count), np.empty(count, np.bool_)

        def piece(start: int, stop: int) -> None:
            some = slice(start, stop)
            part = scaled._replace(omega=scaled.omega[some], D=scaled.D[some], U=scaled.U[some])
            path_check.check(part, limits, doubt[some], witness[some], certified[some])

        over_ranges(piece, count, 1e3 * all_rows.size * count)
        return witness, certified


def solutions(
    of: Sequence[ModalFamily], at: Frequencies, *, with_motion: bool = True
) -> list[tuple[Impulses, Amplitudes]]:
    """Return impulses and motions of families that differ only in the positions of walls.

    The responses are computed once, for the first family.
    """
    first = of[0]
    if first.family.kind is not Kind.ANTISYMMETRIC or first.family.count > 1:
        return _bordered(of, at, with_motion=with_motion)
    return _scalar(of, at, with_motion=with_motion)


def _scalar(
    of: Sequence[ModalFamily], at: Frequencies, *, with_motion: bool
) -> list[tuple[Impulses, Amplitudes]]:
    """Return the impulses of one constraint, and the motions."""
    first = of[0]
    row, row_error = first.rows[0], first.row_errors[0]
    S, condition = response.response_one(
        first.roots,
        first.rounding,
        row**2,
        at.omega,
        at.rounding,
        first.errors,
        (2.0 * np.abs(row) + row_error) * row_error,
    )
    error = EPS * (condition + 3.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.where(error < 1.0, error / (1.0 - error), np.inf)
    gaps = np.array([float(one.equations[0].walls[0]) for one in of])
    D, none = np.zeros((len(of), at.size, 0)), np.zeros((at.size, 0))
    own_error, motion_error, energy_error = np.full((3, len(of), at.size), np.inf)
    if with_motion:
        scale = np.divide.outer(gaps, S)
        shapes = response.Participations(row, row_error, first.root_errors, first.angles)
        D, sizes = response.amplitudes_one(
            first.roots, first.rounding, shapes, at.omega, at.rounding, scale
        )
        with np.errstate(invalid="ignore", over="ignore"):
            own_error = np.abs(scale) * sizes.motion_error
            motion_error = own_error + np.abs(scale) * error * sizes.motion
            squares = np.square(scale * at.omega)
            energy_error = squares * (sizes.energy_error + 1.1 * error * sizes.energy)
    solved = []
    for i, gap in enumerate(gaps):
        p = response.impulses_of(S, at.omega, float(gap))[:, np.newaxis]
        both = motion_error[i], energy_error[i]
        motion = Amplitudes(at.omega, p, D[i], none, *both, error, own_error[i])
        solved.append((Impulses(p, p, error), motion))
    return solved


def _bordered(
    of: Sequence[ModalFamily], at: Frequencies, *, with_motion: bool
) -> list[tuple[Impulses, Amplitudes]]:
    """Return impulses and motions by systems of equations."""
    first = of[0]
    has_symmetric = with_motion and first.family.kind is not Kind.ANTISYMMETRIC
    D = np.zeros((len(of), at.size, first.roots.size if with_motion else 0))
    U = np.zeros((len(of), at.size, first.roots.size if has_symmetric else 0))
    motion_error, energy_error = np.zeros((2, len(of), at.size))
    unknowns, errors = [], []
    for place, one in enumerate(first.equations):
        walls = np.array([family.equations[place].walls for family in of])
        z, error = np.empty((2, len(of), at.size, walls.shape[1]))
        none, some_errors = np.zeros((len(of), at.size, 0)), np.empty((2, len(of), at.size))
        part_D, part_U = D if one.antisymmetric.size else none, U if one.symmetric.size else none
        into = families.Solutions(z, error, part_D, part_U, *some_errors)
        _solve(first, one, walls, at, into)
        unknowns.append(z)
        errors.append(error)
        motion_error += some_errors[0]
        energy_error += some_errors[1]
    solved = []
    for i, family in enumerate(of):
        impulses = family.impulses(tuple(z[i] for z in unknowns), tuple(e[i] for e in errors))
        both, zeros = (motion_error[i], energy_error[i]), np.zeros(at.size)
        motion = Amplitudes(at.omega, impulses.plus, D[i], U[i], *both, zeros, motion_error[i])
        solved.append((impulses, motion))
    return solved


def _solve(
    of: ModalFamily, one: Equations, walls: Floats, at: Frequencies, into: families.Solutions
) -> None:
    """Fill in the unknowns of one system of equations and the motion that they cause."""
    modes = families.Modes(of.roots, of.rounding, of.load, of.load_errors, of.errors, of.angles)
    system = families.LinearSystem(
        np.ascontiguousarray(one.antisymmetric @ of.rows),
        np.ascontiguousarray(one.symmetric @ of.rows),
        np.ascontiguousarray(np.abs(one.antisymmetric) @ of.row_errors),
        np.ascontiguousarray(np.abs(one.symmetric) @ of.row_errors),
        walls,
        one.share,
    )

    def piece(start: int, stop: int) -> None:
        # Whole arrays: those of a part would be of another type, and compiled for that once more.
        omega, rests = at.omega[start:stop], at.rounding[start:stop]
        families.solutions(modes, system, omega, rests, start, into)

    over_ranges(piece, at.size, 100.0 * of.roots.size * at.size * len(walls))


def _finite(walls: Floats) -> Floats:
    return np.where(np.isfinite(walls), np.abs(walls), 0.0)


def modal_load(problem: Problem, spectrum: Spectrum) -> tuple[Floats, Floats]:
    """Return the static loads of the modes and their errors, each (mode,).

    A load below its error is 0, on a rigid-body mode exactly.
    """
    force = problem.system.force
    if force is None or not force.any():
        return np.zeros(spectrum.roots.size), np.zeros(spectrum.roots.size)
    loaded = np.flatnonzero(force)
    parts = force[loaded, np.newaxis] * spectrum.rows(loaded)
    load = parts.sum(axis=0)
    errors = (loaded.size + 2) * EPS * np.abs(parts).sum(axis=0)
    if spectrum.angles is not None:
        errors += spectrum.angles * np.linalg.norm(load)
    small = np.abs(load) <= errors
    errors[small & (spectrum.roots == 0.0)] = 0.0
    return np.where(small, 0.0, load), np.where(small, 2.0 * errors, errors)


def _require_balance(roots: Floats, rows: Floats, load: Floats) -> None:
    """Refuse a load on a rigid-body mode that no impulse can balance."""
    loaded = (roots == 0.0) & (load != 0.0)
    constrained = np.abs(rows).max(axis=0, initial=0.0) > 0.0
    if (loaded & ~constrained).any():
        message = "it drives a rigid-body mode that no active constraint limits"
        raise ModelError(("system", "force"), message, code="unbalanced_load")
