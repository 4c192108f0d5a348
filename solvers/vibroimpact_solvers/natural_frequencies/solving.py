"""Natural frequencies, mode shapes and what follows from them, by the plan."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any, Final

import numpy as np

from vibroimpact_solvers import condensation, spectrum
from vibroimpact_solvers.arrays import EPS, Floats, nothing
from vibroimpact_solvers.derivatives import named
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.matrices import Form, SymmetricMatrix
from vibroimpact_solvers.meter import look, metered
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.natural_frequencies import derivatives
from vibroimpact_solvers.natural_frequencies.cautions import cautions
from vibroimpact_solvers.natural_frequencies.flexibility import residual_flexibility
from vibroimpact_solvers.natural_frequencies.planning import Decision
from vibroimpact_solvers.natural_frequencies.problem import Problem
from vibroimpact_solvers.plan import Plan, Stage, Tick
from vibroimpact_solvers.results.natural_frequencies import Result
from vibroimpact_solvers.spectrum import LowestModes, Spectrum
from vibroimpact_solvers.spectrum.inertia import least_eigenvalue

_ROWS: Final = 512  # degrees of freedom at a time
_LARGEST: Final = 1.0 - 1e-6  # part of the largest entry from which one may give the sign
_TOGETHER: Final = 100.0  # distance of eigenvalues over their errors below which they are together
_HELD: Final = 8.0  # roundings of an entry of the matrices of a structure that is held
_EDGE: Final = 0.1  # relative room above the square of `stop`: a mode there is told from others
_PROVED: Final = (
    "certified: errors of the natural frequencies are proved from residuals of the modes, or are "
    "roundings of a closed form"
)
_ESTIMATED: Final = (
    "estimated: each squared natural frequency has an error of a few roundings of the largest one"
)
_COUNTED: Final = "; that no lower mode is missing is proved by counts of the eigenvalues"
_CLOSE: Final = (
    "; modes whose frequencies cannot be told apart are not unique: errors of their shapes are "
    "those of the space that they span"
)


@metered
def solve(problem: Problem, plan: Plan, tick: Tick | None = None) -> Result:
    """Compute the natural frequencies.

    Parameters
    ----------
    problem : Problem
    plan : Plan
        From `plan(problem)`.
    tick : callable, optional
        Called with (done, total); may raise `Cancelled`.
    """
    if tick is not None:
        tick(0, 1)
    step = plan.step(Stage.SPECTRUM)
    assert step is not None
    assert isinstance(step.settings, Decision)
    lowest = _modes(problem, step.settings)
    natural = lowest.natural
    count = problem.most
    if problem.stop is not None:
        count = int(np.count_nonzero(natural.roots <= problem.stop))
    roots, errors = natural.roots[:count], _frequency_errors(natural)[:count]
    outputs = problem.outputs
    shape = shape_error = participation = participation_error = modes = rows = signs = None
    mass = mass_error = flexibility = flexibility_error = None
    if outputs & {"shape", "participation", "effective_mass"}:
        modes, modes_error = _shapes(problem, natural, count)
        signs = _signs(modes)
        if "shape" in outputs:
            shape, shape_error = (modes * signs).T + 0.0, modes_error.T
        if "participation" in outputs:
            rows, rows_error = participations(problem, natural)
            participation = (rows[:, :count] * signs).T + 0.0
            participation_error = rows_error[:, :count].T
        if "effective_mass" in outputs:
            assert problem.directions is not None
            mass, mass_error = _effective_masses(problem, modes, natural)
    if "residual_flexibility" in outputs:
        rows, rows_error = participations(problem, natural)
        lines = _lines(problem)
        flexibility, flexibility_error = residual_flexibility(
            problem.moving, lines, lowest, (rows, rows_error), count
        )
    said = cautions(problem.system, roots, errors, modes)
    rates: dict[str, Any] = {}
    if plan.step(Stage.DERIVATIVES):
        rates = derivatives.outputs(problem, natural, count, modes, rows, signs)
        rates |= named(problem.parameters)
    statement = _PROVED if natural.proved else _ESTIMATED
    statement += _COUNTED if step.settings.method is None and natural.proved else ""
    relative = errors / np.maximum(np.abs(roots), np.finfo(np.float64).tiny)
    if tick is not None:
        tick(1, 1)
    values = nothing(Result) | rates
    values.update(
        mode=np.arange(count),
        Omega=roots,
        shape=shape,
        participation=participation,
        effective_mass=mass,
        residual_flexibility=flexibility,
        error_statement=statement + _CLOSE,
        neglected=None,
        cautions=said or None,
        error_Omega=errors,
        error_shape=shape_error,
        error_participation=participation_error,
        error_effective_mass=mass_error,
        error_residual_flexibility=flexibility_error,
        within_tolerance=None if problem.tolerance is None else relative <= problem.tolerance,
    )
    return Result(**values)


def _modes(problem: Problem, decision: Decision) -> LowestModes:
    """Return the modes, all or the lowest."""
    system = problem.moving
    if decision.method is not None:
        lowest = LowestModes(spectrum.spectrum(system, decision.method), np.inf)
    else:
        below = None if problem.stop is None else problem.stop**2 * (1.0 + _EDGE)
        lowest = spectrum.lowest_modes(system, problem.most, below)
    if problem.held is None or problem.held.exact:
        return lowest
    return replace(lowest, natural=_of_rounded(problem, lowest.natural))


def _of_rounded(problem: Problem, natural: Spectrum) -> Spectrum:
    """Return modes with the errors that rounded matrices bring, where directions are held fixed.

    Roundings dK and dM of ``Z^T K Z`` and ``Z^T M Z`` move an eigenvalue by
    ``e^T (dK - lambda dM) e``, and its mode by the norm of that vector over the distance to others.
    """
    assert problem.held is not None
    values = natural.eigenvalues
    magnitudes = np.abs(natural.modes)
    residuals = np.zeros_like(magnitudes)
    Z = abs(problem.held.basis)
    for matrix, factors in ((problem.system.K, 1.0), (problem.system.M, np.abs(values))):
        look()
        residuals += factors * (Z.T @ (abs(matrix.to_sparse()) @ (Z @ magnitudes)))
    residuals *= _HELD * EPS
    more = (magnitudes * residuals).sum(axis=0)
    turned = _turned(values, more, _lengths(problem.moving, residuals))
    errors = np.zeros(values.size) if natural.errors is None else natural.errors
    angles = np.zeros(values.size) if natural.angles is None else natural.angles
    return replace(natural, errors=errors + more, angles=angles + turned, proved=False)


def _turned(values: Floats, errors: Floats, residuals: Floats) -> Floats:
    """Return angles by which residuals turn modes, close ones together as one space, (mode,)."""
    steps = np.diff(values)
    apart = steps > _TOGETHER * (errors[1:] + errors[:-1])
    ends = [0, *(np.flatnonzero(apart) + 1).tolist(), values.size]
    turned = np.zeros(values.size)
    for start, stop in itertools.pairwise(ends):
        beside = [steps[place] for place in (start - 1, stop - 1) if 0 <= place < steps.size]
        some = slice(start, stop)
        turned[some] = 2.0 * float(np.linalg.norm(residuals[some])) / min(beside, default=np.inf)
    return turned


def _lengths(system: System, residuals: Floats) -> Floats:
    """Return bounds of the norms of vectors by ``M^-1``, from those of their entries, (mode,)."""
    M = system.M
    if system.massless.size:
        condensed = condensation.of(system)
        carried = abs(condensed.static).T @ residuals[condensed.massless]
        M, residuals = condensed.M, residuals[condensed.massive] + carried
    return np.asarray(np.linalg.norm(_sizes(M)[:, np.newaxis] * residuals, axis=0))


def _frequency_errors(natural: Spectrum) -> Floats:
    """Return bounds of the errors of the natural frequencies, (mode,)."""
    size = np.abs(natural.roots)
    squares = size**2
    errors = np.zeros(size.size) if natural.errors is None else natural.errors
    below = np.sqrt(np.maximum(squares - errors, 0.0))
    # The square root is taken of the difference, so that small errors keep their digits.
    with np.errstate(divide="ignore", invalid="ignore"):
        fall = np.where(size > 0.0, errors / (size + below), 0.0)
    rise = np.sqrt(squares + errors) - size
    return np.maximum(np.where(errors < squares, fall, np.maximum(size, rise)), 0.0) + EPS * size


def _shapes(problem: Problem, natural: Spectrum, count: int) -> tuple[Floats, Floats]:
    """Return the first modes and the errors of their entries, each (dof, mode)."""
    moving = problem.moving
    modes = np.empty((moving.n, count))
    for start in range(0, moving.n, _ROWS):
        look()
        dofs = np.arange(start, min(start + _ROWS, moving.n))
        modes[dofs] = natural.rows(dofs)[:, :count]
    angles = np.zeros(count) if natural.angles is None else natural.angles[:count]
    errors = entry_sizes(moving)[:, np.newaxis] * angles + 2.0 * EPS * np.abs(modes)
    if problem.held is None:
        return modes, errors
    Z = problem.held.basis
    return np.asarray(Z @ modes), np.asarray(abs(Z) @ (errors + 6.0 * EPS * np.abs(modes)))


def entry_sizes(system: System) -> Floats:
    """Return how far a unit vector in the norm of M moves each degree of freedom at most, (dof,).

    The root of the diagonal of ``M^-1``, bounded with the least eigenvalue of the scaled M.
    """
    if system.massless.size:
        condensed = condensation.of(system)
        sizes = np.zeros(system.n)
        sizes[condensed.massive] = _sizes(condensed.M)
        sizes[condensed.massless] = abs(condensed.static) @ sizes[condensed.massive]
        return sizes
    return _sizes(system.M)


def _sizes(M: SymmetricMatrix) -> Floats:
    if M.form is Form.DIAGONAL:
        return np.asarray(1.0 / np.sqrt(M.data[0]))
    try:
        least = least_eigenvalue(M)
    except ConvergenceError:
        least = EPS
    return np.asarray(1.0 / np.sqrt(least * M.main_diagonal))


def _signs(modes: Floats) -> Floats:
    """Return the signs that make the first one of the largest entries of each mode positive."""
    size = np.abs(modes)
    first = (size >= _LARGEST * size.max(axis=0, initial=0.0)).argmax(axis=0)
    return np.where(modes[first, np.arange(modes.shape[1])] < 0.0, -1.0, 1.0)


def _lines(problem: Problem) -> list[Constraint | None]:
    """Return the constraints in terms of what moves, None where one is held."""
    if problem.held is None:
        return list(problem.system.constraints)
    return [problem.held.along(constraint) for constraint in problem.system.constraints]


def participations(problem: Problem, natural: Spectrum) -> tuple[Floats, Floats]:
    """Return the constrained coordinates of all modes computed, and errors: (constraint, mode)."""
    lines = _lines(problem)
    rows, errors = np.zeros((2, len(lines), natural.roots.size))
    free = [place for place, line in enumerate(lines) if line is not None]
    constraints = [line for line in lines if line is not None]
    reach = None
    if natural.roots.size < problem.modes:
        directions = np.zeros((problem.moving.n, len(constraints)))
        for column, line in zip(directions.T, constraints, strict=True):
            column[list(line.dofs)] = line.weights
        inverse = condensation.solve_mass(problem.moving)(directions)
        reach = np.sqrt((directions * inverse).sum(axis=0))
    rows[free], errors[free] = natural.participations(constraints, reach)
    return rows, errors


def _effective_masses(problem: Problem, modes: Floats, natural: Spectrum) -> tuple[Floats, Floats]:
    """Return the effective masses of some modes and their errors, each (mode, direction)."""
    M, directions = problem.system.M, problem.directions
    assert directions is not None
    count = modes.shape[1]
    heavy = M @ np.ascontiguousarray(directions.T)
    factors = modes.T @ heavy
    size = np.sqrt(np.maximum((directions.T * heavy).sum(axis=0), 0.0))
    angles = np.zeros(count) if natural.angles is None else natural.angles[:count]
    rounded = np.abs(modes).T @ (abs(M.to_sparse()) @ np.abs(directions.T))
    errors = np.outer(angles, size) + 4.0 * EPS * np.sqrt(M.n) * rounded
    return factors**2, errors * (2.0 * np.abs(factors) + errors)
