"""Where a motion starts: a state that was given, or a member of a family of impact modes."""

from __future__ import annotations

import numpy as np

from vibroimpact_solvers import impact_modes
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.impact_modes.family import Family
from vibroimpact_solvers.impact_modes.modal import ModalFamily
from vibroimpact_solvers.model import System
from vibroimpact_solvers.time_history.problem import Member, Problem, State
from vibroimpact_solvers.time_history.structure import Structure


def initial_state(problem: Problem, initial: State | Member, structure: Structure) -> Floats:
    """Return the state at t = 0 in the free scene, shape (2, pair)."""
    scene, unit = structure.scene(), 1.0 / structure.scale
    basis = scene.basis
    if not isinstance(initial, State):
        q, rate = _member(problem, initial, structure)
        return basis.pairs_of(q - basis.still, unit * rate, basis.loads(0.0))
    if initial is not problem.initial:
        problem.check(initial)
    return structure.enter(scene, initial.x, unit * initial.v, basis.loads(0.0))


def member_problem(system: System, member: Member) -> impact_modes.Problem:
    """Return the problem of impact modes that a member is one point of."""
    omega = np.array([2.0 / np.pi * member.Omega])
    return impact_modes.Problem(system, omega, member.active, Omega=np.array([member.Omega]))


def _member(problem: Problem, member: Member, structure: Structure) -> tuple[Floats, Floats]:
    """Return modal coordinates and velocities of an impact mode at tau = 0, each (mode,)."""
    asked = member_problem(problem.system, member)
    omega = asked.omega
    found = impact_modes.solve(asked, impact_modes.plan(asked))
    assert found.exists is not None
    assert found.reason is not None
    if not found.exists[0]:
        reason = impact_modes.Reason(int(found.reason[0])).sentence
        pointer = ("initial", "impact_mode", "Omega")
        raise ModelError(pointer, f"no such motion exists: {reason}", code="phantom")
    family = ModalFamily(asked, Family.of(asked), structure.natural)
    _, motion = family.members(asked.frequencies)
    q, rate = np.zeros((2, structure.natural.roots.size))
    if motion.D.shape[1]:
        rate[family.heard] = omega[0] * motion.D[0]
    if motion.U.shape[1]:
        q[family.heard] = motion.U[0]
    return q, rate
