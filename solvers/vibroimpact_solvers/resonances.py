"""Internal resonances of impact modes with the structure whose limited coordinate is fixed.

The limited coordinate moves much like a given triangle wave, whose odd harmonics excite the rest
of the structure. Resonance occurs at the natural frequencies nu of the structure with that
coordinate fixed, divided by odd numbers (eq. 10.70-10.76 for the uniform chain, any M and K
here).

Examples
--------
>>> from vibroimpact_solvers import resonances
>>> from vibroimpact_solvers.model import Constraint
>>> from vibroimpact_solvers.presets import chain
>>> problem = resonances.Problem(chain(3, [Constraint.at(0, gap=1.0)]), odd_max=3)
>>> result = resonances.solve(problem, resonances.plan(problem))
>>> result.natural.round(6)  # of the two masses that remain
array([1.      , 1.732051, 1.      , 1.732051])
>>> result.Omega.round(6), result.harmonic
(array([0.333333, 0.57735 , 1.      , 1.732051]), array([3, 3, 1, 1]))
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph

from vibroimpact_solvers import condensation, holding, spectrum
from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.checks import check_outputs, check_tolerance
from vibroimpact_solvers.errors import ModelError, PlanError
from vibroimpact_solvers.laws import require
from vibroimpact_solvers.matrices import SymmetricMatrix
from vibroimpact_solvers.meter import metered
from vibroimpact_solvers.model import ChainShape, System
from vibroimpact_solvers.plan import Plan, Skip, Stage, Step, Tick, batches
from vibroimpact_solvers.plan import join_only as join
from vibroimpact_solvers.plan import split_nothing as split
from vibroimpact_solvers.results.resonances import Result

__all__ = ["KIND", "OUTPUTS", "Problem", "Result", "join", "plan", "solve", "split"]

KIND: Final = "resonances"
OUTPUTS: Final = ("Omega", "harmonic", "part")

_UNEXCITED = 1e-12  # excitation, relative to the terms of its sum, that is rounding
_MAX_MIXED = 1e-6  # largest part of a neighbouring mode in an unexcited one by rounding
_ROWS = 256  # of a matrix of all pairs of modes at a time
_METHOD: Final = "constrained structure"
_PROVED: Final = (
    "certified: errors of the natural frequencies are proved from residuals of the modes, or are "
    "roundings of a closed form; that a mode is excited is estimated"
)
_ESTIMATED: Final = (
    "estimated: each eigenvalue of the constrained structure has an error of a few roundings of "
    "the largest one"
)


@dataclass(frozen=True, eq=False)
class Problem:
    """Resonances with one limited coordinate.

    Parameters
    ----------
    system : System
    constraint : int
        The constraint whose coordinate is fixed.
    odd_max : int
        Highest odd harmonic.
    outputs : frozenset of str
        The requested ones of `OUTPUTS`.
    tolerance : float, optional
        Largest relative error of the frequencies; the result tells which meet it.
    """

    system: System
    constraint: int = 0
    odd_max: int = 9
    outputs: frozenset[str] = frozenset(OUTPUTS)
    tolerance: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "outputs", frozenset(self.outputs))
        count = len(self.system.constraints)
        if not 0 <= self.constraint < count:
            message = f"{self.constraint} is not below the number of constraints, {count}"
            raise ModelError(("constraint",), message, code="index_out_of_range")
        if self.odd_max < 1:
            message = "the highest harmonic is below 1"
            raise ModelError(("odd_max",), message, code="out_of_range")
        check_outputs(self.outputs, OUTPUTS)
        require(KIND, self.system.constraints)
        check_tolerance(self.tolerance)

    @property
    def neglected(self) -> list[str]:
        """A sentence about each part of the structure that has no effect."""
        return self.system.losses(())


def plan(problem: Problem) -> Plan:
    """Choose how the resonances are computed."""
    parts = list(_parts(problem))
    methods = [(part, spectrum.choose(part.system)) for part in parts]
    size = sum(spectrum.nbytes(part.system, method) for part, method in methods)
    if size > spectrum.MEMORY:
        message = (
            f"the natural modes of the constrained structure take more than {size / 1e9:.0f} GB"
        )
        raise PlanError(message, ("system",))
    names = sorted({str(method) for _, method in methods})
    reason = f"with the coordinate fixed the structure has {len(parts)} parts ({', '.join(names)})"
    if problem.system.massless.size:
        reason = f"{condensation.sentence(problem.system)}; {reason}"
    # Dividing the structure takes longer than the modes of small parts.
    flops = 1.5e6 * (problem.system.n > 1) + sum(
        spectrum.flops(part.system, method) for part, method in methods
    )
    chosen = tuple(method for _, method in methods)
    rows = float(sum(part.system.n for part in parts)) * ((problem.odd_max + 1) // 2)
    columns = 3.0 + len(problem.outputs) + ("Omega" in problem.outputs)  # with errors
    ordered = "all natural frequencies over all odd numbers, in ascending order"
    steps = (
        Step(Stage.SPECTRUM, _METHOD, reason, flops, size, settings=chosen),
        Step(Stage.RESPONSE, "division", ordered, 200.0 * rows, 8.0 * columns * rows),
    )
    skips = (
        Skip("even harmonics", "the triangle wave has none"),
        Skip("modes that the fixed coordinate does not excite", "they do not resonate"),
    )
    return Plan(KIND, steps, skips)


@metered
def solve(problem: Problem, plan: Plan, tick: Tick | None = None) -> Result:
    """Compute the resonances.

    Parameters
    ----------
    problem : Problem
    plan : Plan
        From `plan(problem)`.
    tick : callable, optional
        Called with (done, total) parts; may raise `Cancelled`.
    """
    parts = list(_parts(problem))
    frequencies, places = [np.empty(0)], [np.empty(0, dtype=np.int64)]
    errors = [np.empty(0)]
    methods = _methods(plan)
    # Fixing a direction rounds the matrices of what remains.
    is_exact = len(problem.system.constraints[problem.constraint].coordinate) == 1
    proved = is_exact
    for index, _ in batches(len(parts), 1, tick):
        roots, error, is_proved = parts[index].excited(methods[index], is_exact=is_exact)
        proved &= is_proved
        frequencies.append(roots)
        errors.append(error)
        places.append(np.full(roots.size, index))
    natural, place = np.concatenate(frequencies), np.concatenate(places)
    odd = np.arange(1, problem.odd_max + 1, 2)
    Omega = (natural[:, np.newaxis] / odd).ravel()
    order = np.argsort(Omega, kind="stable")
    error = np.repeat(np.concatenate(errors), odd.size)[order]
    outputs = problem.outputs
    return Result(
        Omega=Omega[order] if "Omega" in outputs else None,
        harmonic=np.tile(odd, natural.size)[order] if "harmonic" in outputs else None,
        part=np.repeat(place, odd.size)[order] if "part" in outputs else None,
        natural=np.repeat(natural, odd.size)[order],
        error_natural=error * np.repeat(natural, odd.size)[order],
        error_relative=error,
        within_tolerance=None if problem.tolerance is None else error <= problem.tolerance,
        error_Omega=(error + EPS) * Omega[order] if "Omega" in outputs else None,
        error_statement=_PROVED if proved else _ESTIMATED,
        neglected=problem.neglected or None,
    )


def _methods(plan: Plan) -> tuple[spectrum.Method, ...]:
    step = plan.step(Stage.SPECTRUM)
    assert step is not None
    assert isinstance(step.settings, tuple)
    return step.settings


@dataclass(frozen=True, eq=False, slots=True)
class _Part:
    """A part of the structure with the coordinate fixed."""

    system: System
    # Forces by K and M from a unit displacement and acceleration of the coordinate, (dof,)
    stiff: Floats
    heavy: Floats

    def excited(self, method: spectrum.Method, *, is_exact: bool) -> tuple[Floats, Floats, bool]:
        """Return the natural frequencies that the coordinate excites, and their errors.

        And whether these are proved, which takes the exact matrices of the part.
        """
        natural = spectrum.spectrum(self.system, method)
        modes = natural.modes
        push = modes.T @ self.stiff - natural.eigenvalues * (modes.T @ self.heavy)
        size = np.abs(modes.T) @ np.abs(self.stiff)
        size += np.abs(natural.eigenvalues) * (np.abs(modes.T) @ np.abs(self.heavy))
        # What is mixed by errors of matrices that were computed from those of the structure.
        errors = spectrum.sensitivity(self.system, natural)
        excited = np.abs(push) > _UNEXCITED * size + _mixed(natural, np.abs(push), *errors)
        chosen = excited & (natural.roots > 0.0)
        values = natural.eigenvalues[chosen]
        relative = errors[0] / values + errors[1]
        if is_exact:
            wrong = np.zeros(natural.roots.size) if natural.errors is None else natural.errors
            relative = wrong[chosen] / values
        error = np.minimum(0.5 * relative / np.maximum(1.0 - relative, 0.1) + EPS, 1.0)
        return np.asarray(natural.roots[chosen]), error, is_exact and natural.proved


def _mixed(natural: spectrum.Spectrum, push: Floats, uncertainty: float, norms: float) -> Floats:
    """Return the largest error of the excitation of each mode by errors of the modes, (mode,).

    An error of M or K mixes two modes by its ratio to the distance of their eigenvalues.
    """
    values, errors = natural.eigenvalues, np.zeros(push.size)
    if uncertainty == norms == 0.0:
        return errors
    for start in range(0, push.size, _ROWS):
        own = values[start : start + _ROWS, np.newaxis]
        error = uncertainty + norms * np.maximum(np.abs(own), np.abs(values))
        apart = np.maximum(np.abs(own - values), error)
        turned = np.minimum(error / apart, _MAX_MIXED)
        turned[own == values] = 0.0
        errors[start : start + _ROWS] = turned @ push
    return errors


def _parts(problem: Problem) -> Iterator[_Part]:
    """Yield the unconnected parts of the structure with the coordinate fixed."""
    system = problem.system
    coordinate = system.constraints[problem.constraint].coordinate
    if system.n == 1:
        return
    Z, _ = holding.basis(system.n, [coordinate])
    fixed, weight = max(coordinate, key=lambda pair: abs(pair[1]))
    K, M = system.K.to_sparse(), system.M.to_sparse()
    moved = np.zeros(system.n)
    moved[fixed] = 1.0 / weight
    stiff, heavy = Z.T @ (K @ moved), Z.T @ (M @ moved)
    K, M = (Z.T @ K @ Z).tocsr(), (Z.T @ M @ Z).tocsr()
    count, label = scipy.sparse.csgraph.connected_components(abs(K) + abs(M), directed=False)
    for part in range(count):
        dofs = np.flatnonzero(label == part)
        if not (stiff[dofs].any() or heavy[dofs].any()):
            continue
        if not M[dofs].nnz:
            continue  # nothing in it vibrates
        chain = None
        if system.chain is not None and len(coordinate) == 1:
            chain = ChainShape(dofs.size, system.chain.mass, system.chain.stiffness)
        masses, springs = (
            SymmetricMatrix.leanest(matrix[dofs][:, dofs].tocsr()) for matrix in (M, K)
        )
        yield _Part(System(masses, springs, (), chain=chain), stiff[dofs], heavy[dofs])
