"""The state of a motion at t = 0: from displacements and velocities, or on an impact mode."""

from __future__ import annotations

import numpy as np

from vibroimpact_solvers import impact_modes
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.impact_modes.family import Family
from vibroimpact_solvers.impact_modes.modal import ModalFamily
from vibroimpact_solvers.model import System
from vibroimpact_solvers.time_history.problem import ImpactMode, Problem, State
from vibroimpact_solvers.time_history.structure import Structure


def initial_state(problem: Problem, initial: State | ImpactMode, structure: Structure) -> Floats:
    """Return the state at t = 0, without contacts, shape (2, pair)."""
    configuration, unit = structure.configuration(), 1.0 / structure.scale
    basis = configuration.basis
    if not isinstance(initial, State):
        q, rate = _impact_mode_state(problem, initial, structure)
        return basis.pairs_of(q - basis.still, unit * rate, basis.loads_at_start())
    if initial is not problem.initial:
        problem.check(initial)
    return structure.state_of(configuration, initial.x, unit * initial.v, basis.loads_at_start())


def impact_mode_problem(system: System, mode: ImpactMode) -> impact_modes.Problem:
    """Return the problem of impact modes whose only solution is this impact mode.

    Raises
    ------
    ModelError
        With the pointer from the problem of the motion.
    """
    omega = np.array([2.0 / np.pi * mode.Omega])
    try:
        return impact_modes.Problem(system, omega, mode.active, Omega=np.array([mode.Omega]))
    except ModelError as error:
        own = {"frequency": "Omega", "active": "active"}.get(str(error.pointer[0]))
        if own is None:
            raise
        pointer = ("initial", "impact_mode", own, *error.pointer[1:])
        raise ModelError(pointer, error.message, code=error.code) from None


def _impact_mode_state(
    problem: Problem, mode: ImpactMode, structure: Structure
) -> tuple[Floats, Floats]:
    """Return modal coordinates and velocities of an impact mode at tau = 0, each (mode,)."""
    problem_of_mode = impact_mode_problem(problem.system, mode)
    omega = problem_of_mode.omega
    modes = impact_modes.solve(problem_of_mode, impact_modes.plan(problem_of_mode))
    assert modes.exists is not None
    assert modes.reason is not None
    if not modes.exists[0]:
        reason = impact_modes.Reason(int(modes.reason[0])).sentence
        pointer = ("initial", "impact_mode", "Omega")
        raise ModelError(pointer, f"no such motion exists: {reason}", code="phantom")
    family = ModalFamily(problem_of_mode, Family.of(problem_of_mode), structure.natural)
    _, motion = family.solutions(problem_of_mode.frequencies)
    q, rate = np.zeros((2, structure.natural.roots.size))
    if motion.D.shape[1]:
        rate[family.participating] = omega[0] * motion.D[0]
    if motion.U.shape[1]:
        q[family.participating] = motion.U[0]
    return q, rate
