"""Internal resonances: harmonics of an impact mode that meet the structure held at its limiter.

The struck coordinate moves much like a given triangle wave, of which the structure feels the
odd harmonics. What resonates with it is the structure with that coordinate held: natural
frequencies nu of the parts it falls into, divided by odd numbers (eq. 10.70-10.76 for the
uniform chain, any M and K here).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Final

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Booleans, Floats, Integers, Quantity
from vibroimpact_solvers.checks import check_outputs, check_tolerance
from vibroimpact_solvers.errors import ModelError, PlanError
from vibroimpact_solvers.matrices import SymmetricMatrix
from vibroimpact_solvers.model import ChainShape, System
from vibroimpact_solvers.plan import Plan, Skip, Stage, Step

KIND: Final = "resonances"
OUTPUTS: Final = ("Omega", "harmonic", "part")

_SILENT = 1e-12  # excitation, relative to the terms of its sum, that is only rounding
_MIXED = 1e-6  # of neighbouring modes that rounding has at most put into one that is silent
_ROWS = 256  # of a matrix of all pairs of modes at a time
_METHOD: Final = "held structure"
_EPS = float(np.finfo(np.float64).eps)
_STATEMENT: Final = (
    "estimate: roundings of the eigenvalues of the held structure, a few of the largest one each"
)


@dataclass(frozen=True, eq=False)
class Problem:
    """Which resonances.

    Parameters
    ----------
    system : System
    constraint : int
        The constraint whose coordinate moves.
    odd_max : int
        Highest odd harmonic.
    outputs : frozenset of str
        What is wanted, out of `OUTPUTS`.
    tolerance : float, optional
        Relative error that frequencies may have; the result says which are within it.
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
        check_tolerance(self.tolerance)


@dataclass(frozen=True, eq=False)
class Result:
    """Resonances, by ascending frequency."""

    Omega: Annotated[
        Floats | None,
        Quantity(("resonance",), "time-1", "fundamental frequency of the impact mode"),
    ]
    harmonic: Annotated[
        Integers | None, Quantity(("resonance",), "1", "odd multiple of Omega that resonates")
    ]
    part: Annotated[
        Integers | None,
        Quantity(("resonance",), "1", "part of the held structure, by its lowest dof"),
    ]
    natural: Annotated[
        Floats,
        Quantity(("resonance",), "time-1", "natural frequency of the held structure"),
    ]
    error_natural: Annotated[
        Floats,
        Quantity(
            ("resonance",), "1", "relative error of the natural frequency", path="error/natural"
        ),
    ]
    within_tolerance: Annotated[
        Booleans | None,
        Quantity(
            ("resonance",),
            "1",
            "whether that error is within the tolerance asked for",
            flags=("beyond", "within"),
            path="error/within_tolerance",
        ),
    ]

    #: How far the numbers can be trusted.
    error_statement: str


def plan(problem: Problem) -> Plan:
    """Decide how the resonances are found."""
    parts = list(_parts(problem))
    methods = [(part, spectrum.choose(part.system)) for part in parts]
    size = sum(spectrum.nbytes(part.system, method) for part, method in methods)
    if size > spectrum.MEMORY:
        message = f"the natural modes of the held structure take more than {size / 1e9:.0f} GB"
        raise PlanError(message)
    names = sorted({str(method) for _, method in methods})
    reason = f"{len(parts)} parts fall apart when the coordinate is held ({', '.join(names)})"
    # To take the structure apart takes longer than the modes of small parts.
    flops = 1.5e6 + sum(spectrum.flops(part.system, method) for part, method in methods)
    steps = (Step(Stage.SPECTRUM, _METHOD, reason, flops, size),)
    skips = (
        Skip("even harmonics", "the triangle wave has none"),
        Skip("modes that the held coordinate does not move", "nothing excites them"),
    )
    return Plan(KIND, steps, skips)


def solve(problem: Problem, plan: Plan, tick: Callable[[int, int], None] | None = None) -> Result:
    """Find the resonances.

    Parameters
    ----------
    problem : Problem
    plan : Plan
        The one that `plan(problem)` returned.
    tick : callable, optional
        Called with (done, total) parts; may raise `Cancelled`.
    """
    parts = list(_parts(problem))
    found, places = [np.empty(0)], [np.empty(0, dtype=np.int64)]
    errors = [np.empty(0)]
    for index, part in enumerate(parts):
        if tick is not None:
            tick(index, len(parts))
        roots, error = part.excited()
        found.append(roots)
        errors.append(error)
        places.append(np.full(roots.size, index))
    if tick is not None:
        tick(len(parts), len(parts))
    natural, place = np.concatenate(found), np.concatenate(places)
    odd = np.arange(1, problem.odd_max + 1, 2)
    Omega = (natural[:, np.newaxis] / odd).ravel()
    order = np.argsort(Omega, kind="stable")
    error = np.repeat(np.concatenate(errors), odd.size)[order]
    wanted = problem.outputs
    return Result(
        Omega=Omega[order] if "Omega" in wanted else None,
        harmonic=np.tile(odd, natural.size)[order] if "harmonic" in wanted else None,
        part=np.repeat(place, odd.size)[order] if "part" in wanted else None,
        natural=np.repeat(natural, odd.size)[order],
        error_natural=error,
        within_tolerance=None if problem.tolerance is None else error <= problem.tolerance,
        error_statement=_STATEMENT,
    )


def split(problem: Problem, plan: Plan, seconds_each: float) -> list[Problem]:
    """Return the problem as its only piece."""
    return [replace(problem)]


def join(problem: Problem, plan: Plan, results: Sequence[Result]) -> Result:
    """Return the result of the only piece."""
    (result,) = results
    return result


@dataclass(frozen=True, eq=False, slots=True)
class _Part:
    """A part of the held structure.

    Parameters
    ----------
    system : System
    stiff, heavy : array, shape (dof,)
        What a unit displacement of the held coordinate does to it: forces by K and by M.
    """

    system: System
    stiff: Floats
    heavy: Floats

    def excited(self) -> tuple[Floats, Floats]:
        """Return the natural frequencies that the held coordinate excites, and their errors."""
        natural = spectrum.spectrum(self.system)
        modes = natural.modes
        push = modes.T @ self.stiff - natural.eigenvalues * (modes.T @ self.heavy)
        size = np.abs(modes.T) @ np.abs(self.stiff)
        size += np.abs(natural.eigenvalues) * (np.abs(modes.T) @ np.abs(self.heavy))
        heard = np.abs(push) > _SILENT * size + _mixed(natural, np.abs(push))
        chosen = heard & (natural.roots > 0.0)
        relative = natural.uncertainty / np.abs(natural.eigenvalues[chosen]) + natural.norms
        return np.asarray(natural.roots[chosen]), np.minimum(0.5 * relative + 4.0 * _EPS, 1.0)


def _mixed(natural: spectrum.Spectrum, push: Floats) -> Floats:
    """Return what errors of the modes may add to the excitation of each, shape (mode,).

    An error of M or K turns modes towards others by itself over the distance of eigenvalues.
    """
    values, found = natural.eigenvalues, np.zeros(push.size)
    if natural.uncertainty == natural.norms == 0.0:
        return found
    for start in range(0, push.size, _ROWS):
        own = values[start : start + _ROWS, np.newaxis]
        error = natural.uncertainty + natural.norms * np.maximum(np.abs(own), np.abs(values))
        apart = np.maximum(np.abs(own - values), error)
        turned = np.minimum(error / apart, _MIXED)
        turned[own == values] = 0.0
        found[start : start + _ROWS] = turned @ push
    return found


def _parts(problem: Problem) -> Iterator[_Part]:
    """Yield the parts into which the structure falls when the coordinate is held."""
    system = problem.system
    coordinate = system.constraints[problem.constraint].coordinate
    if system.n == 1:
        return
    held, weight = max(coordinate, key=lambda pair: abs(pair[1]))
    free = np.delete(np.arange(system.n), held)
    place = np.empty(system.n, dtype=np.int64)
    place[free] = np.arange(free.size)
    # x = Z (free dofs) + u y with the coordinate y: the held dof makes up for the others.
    others = [(place[dof], -w / weight) for dof, w in coordinate if dof != held]
    entries = [np.ones(free.size), np.array([w for _, w in others])]
    rows = [free, np.full(len(others), held)]
    columns = [np.arange(free.size), np.array([p for p, _ in others], dtype=np.int64)]
    index = (np.concatenate(rows).astype(np.int64), np.concatenate(columns))
    Z = scipy.sparse.csr_array((np.concatenate(entries), index), shape=(system.n, free.size))
    K, M = system.K.to_sparse(), system.M.to_sparse()
    moved = np.zeros(system.n)
    moved[held] = 1.0 / weight
    stiff, heavy = Z.T @ (K @ moved), Z.T @ (M @ moved)
    K, M = (Z.T @ K @ Z).tocsr(), (Z.T @ M @ Z).tocsr()
    count, label = scipy.sparse.csgraph.connected_components(abs(K) + abs(M), directed=False)
    for part in range(count):
        dofs = np.flatnonzero(label == part)
        if not (stiff[dofs].any() or heavy[dofs].any()):
            continue
        chain = None
        if system.chain is not None and len(coordinate) == 1:
            chain = ChainShape(dofs.size, system.chain.mass, system.chain.stiffness)
        masses, springs = (
            SymmetricMatrix.leanest(matrix[dofs][:, dofs].tocsr()) for matrix in (M, K)
        )
        yield _Part(System(masses, springs, (), chain=chain), stiff[dofs], heavy[dofs])
