"""Sweeps and ensembles: what their plans leave out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from benchmarks.cases import GAP, IMPULSE, grid
from benchmarks.skips.scene import Scene, forget_modes, solve
from vibroimpact_solvers import (
    ensemble,
    impact_modes,
    natural_frequencies,
    presets,
    resonances,
    sweep,
    time_history,
)
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.plan import Stage
from vibroimpact_solvers.sweep import Axis

_GAPS: Final = np.linspace(0.1, 0.3, 50)
_RESTITUTIONS: Final = np.linspace(0.5, 1.0, 20)
_GRID: Final = grid(0.2, 3.0, 400)
_STATES: Final = np.random.default_rng(0).standard_normal((64, 13))


def scenes() -> Iterator[Scene]:
    """Yield scenes of sweeps and ensembles."""
    yield Scene(
        "fifty gaps of two coupled constraints, N=40",
        sweep,
        _gaps,
        partial(_alone, _gaps),
        ("spectrum at 49 of 50 points", "response at 49 of 50 points"),
    )
    yield Scene(
        "twenty gaps of a time history, N=40",
        sweep,
        _histories,
        partial(_alone, _histories, 20),
        ("spectrum at 19 of 20 points",),
    )
    yield Scene(
        "twenty restitutions of impact modes",
        sweep,
        partial(_lossless, "impact-modes"),
        partial(_alone, partial(_lossless, "impact-modes"), 20),
        ("computing again along restitution",),
    )
    yield Scene(
        "twenty restitutions of internal resonances",
        sweep,
        partial(_lossless, "resonances"),
        partial(_alone, partial(_lossless, "resonances"), 20),
        ("computing again along restitution",),
    )
    yield Scene(
        "twenty restitutions of natural frequencies",
        sweep,
        partial(_lossless, natural_frequencies.KIND),
        partial(_alone, partial(_lossless, natural_frequencies.KIND), 20),
        ("computing again along restitution",),
    )
    yield Scene(
        "twenty influences of impact modes",
        sweep,
        _influences,
        partial(_alone, _influences, 20),
        ("computing again along influence",),
    )
    yield Scene(
        "64 initial states, N=13",
        ensemble,
        _ensemble,
        _apart,
        ("spectrum at 63 of 64 members",),
    )


def _structure(constraints: list[Constraint], n: int = 40) -> System:
    """Return a chain that has no modes in closed form."""
    K = SymmetricMatrix.bands({0: np.full(n, 2.0), 1: np.full(n - 1, -1.0)})
    return System(SymmetricMatrix.diagonal(np.linspace(0.5, 1.5, n)), K, tuple(constraints))


def _gaps() -> sweep.Problem:
    whole = _structure([Constraint.at(7, GAP), Constraint.at(21, 2.0 * GAP)])

    def at(index: tuple[int, ...]) -> impact_modes.Problem:
        gap = float(_GAPS[index[0]])
        system = whole.limited((Constraint.at(7, gap), Constraint.at(21, 2.0 * gap)))
        return _impulses(system)

    axis = Axis("system.constraints.*.gap", "gap", _GAPS, stage=Stage.IMPULSE)
    return sweep.Problem("impact-modes", (axis,), at, whole)


def _histories() -> sweep.Problem:
    whole = _structure([Constraint.at(7, GAP, 0.8)])
    v = np.zeros(whole.n)
    v[0] = 1.0
    start = time_history.State(np.zeros(whole.n), v)

    def at(index: tuple[int, ...]) -> time_history.Problem:
        system = whole.limited((Constraint.at(7, float(_GAPS[index[0]]), 0.8),))
        return time_history.Problem(system, start, 30.0)

    rule = sweep.rule(time_history.KIND, ("system", "constraints", 0, "gap"))
    axis = Axis("system.constraints.0.gap", "gap", _GAPS[:20], stage=rule.stage)
    return sweep.Problem(time_history.KIND, (axis,), at, whole)


def _impulses(system: System) -> impact_modes.Problem:
    return impact_modes.Problem(system, _GRID * 2.0 / np.pi, outputs=IMPULSE, Omega=_GRID)


def _lossless(kind: str) -> sweep.Problem:
    whole = _structure([Constraint.at(7, GAP)])
    requested: Callable[[System], object] = _impulses
    if kind == resonances.KIND:
        requested = resonances.Problem
    elif kind == natural_frequencies.KIND:
        requested = natural_frequencies.Problem

    def at(index: tuple[int, ...]) -> object:
        return requested(whole.limited((Constraint.at(7, GAP, float(_RESTITUTIONS[index[0]])),)))

    rule = sweep.rule(kind, ("system", "constraints", 0, "restitution"))
    axis = Axis("restitution", "restitution", _RESTITUTIONS, stage=rule.stage, why=rule.why)
    return sweep.Problem(kind, (axis,), at, whole)


def _influences() -> sweep.Problem:
    whole = _structure([Constraint.at(7, GAP)])

    def at(index: tuple[int, ...]) -> object:
        influence = np.full(whole.n, _RESTITUTIONS[index[0]])
        return _impulses(replace(whole, influence=influence))

    rule = sweep.rule("impact-modes", ("system", "influence", 0))
    axis = Axis("influence", "influence", _RESTITUTIONS, stage=rule.stage, why=rule.why)
    return sweep.Problem("impact-modes", (axis,), at, whole)


def _alone(points_of: Callable[[], sweep.Problem], points: int = 50) -> None:
    """Solve every point of a parameter grid as if nothing were known of the others."""
    for index in range(points):
        problem = points_of()
        forget_modes()
        solve(problem.swept_kind.solver, problem.at((index,)))


def _ensemble() -> ensemble.Problem:
    system = presets.chain(13, [Constraint.at(5, GAP)])
    return ensemble.Problem(system, np.zeros((64, 13)), _STATES, 5.0)


def _apart() -> None:
    """Follow every motion as if nothing were known of the others."""
    for v in _STATES:
        forget_modes()
        system = presets.chain(13, [Constraint.at(5, GAP)])
        state = time_history.State(np.zeros(13), v)
        solve(time_history, time_history.Problem(system, state, 5.0))
