"""Internal resonances: what their plans leave out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from benchmarks.cases import GAP
from benchmarks.skips.scene import Scene
from vibroimpact_solvers import presets, resonances, spectrum
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.resonances import Problem, Result

_MAX: Final = 9


def scenes() -> Iterator[Scene]:
    """Yield scenes of internal resonances."""
    yield Scene(
        "odd harmonics alone, N=13",
        resonances,
        lambda: Problem(_chain(), odd_max=_MAX),
        lambda: _all_harmonics(_chain()),
        ("even harmonics",),
    )
    yield Scene(
        "a structure of which half is not joined to the constraint, N=26",
        resonances,
        lambda: Problem(_apart(), odd_max=_MAX),
        lambda: _all_modes(_apart()),
        ("modes that the fixed coordinate does not excite",),
    )


def _solved(problem: Problem) -> Result:
    return resonances.solve(problem, resonances.plan(problem))


def _chain() -> System:
    return presets.chain(13, [Constraint.at(5, GAP)])


def _all_harmonics(system: System) -> Result:
    """Divide by even numbers too."""
    result = _solved(Problem(system, odd_max=_MAX))
    assert result.harmonic is not None
    assert result.part is not None
    first, every = result.harmonic == 1, np.arange(1, _MAX + 1)
    natural = result.natural[first]
    return replace(
        result,
        Omega=(natural[:, np.newaxis] / every).ravel(),
        harmonic=np.tile(every, natural.size),
        part=np.repeat(result.part[first], every.size),
        natural=np.repeat(natural, every.size),
        error_natural=np.repeat(result.error_natural[first], every.size),
    )


def _apart() -> System:
    """Return two chains that nothing joins; the first one has a limiter."""
    springs = np.full(25, -1.0)
    springs[12] = 0.0
    K = SymmetricMatrix.bands({0: np.full(26, 2.0), 1: springs})
    return System(SymmetricMatrix.diagonal(np.ones(26)), K, (Constraint.at(5, GAP),))


def _all_modes(system: System) -> Result:
    """Find all natural modes of the constrained structure."""
    free = np.delete(np.arange(system.n), 5)
    K = SymmetricMatrix.leanest(system.K.to_sparse()[free][:, free].tocsr())
    spectrum.spectrum(System(SymmetricMatrix.diagonal(np.ones(free.size)), K, ()))
    return _solved(Problem(system, odd_max=_MAX))
