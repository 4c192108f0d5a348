"""Observes all motions batch by batch, sorts them by what they settle on, and makes the tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.attractors import contact_columns
from vibroimpact_solvers.attractors.contact_exponents import OfContacts
from vibroimpact_solvers.attractors.contact_verification import ConfirmedContacts
from vibroimpact_solvers.attractors.contact_verification import confirmed as confirmed_contacts
from vibroimpact_solvers.attractors.exponents import OfImpacts
from vibroimpact_solvers.attractors.grouping import Group, place
from vibroimpact_solvers.attractors.growth import Exponents
from vibroimpact_solvers.attractors.observed import Observed, observe
from vibroimpact_solvers.attractors.planning import Batches
from vibroimpact_solvers.attractors.problem import Problem
from vibroimpact_solvers.attractors.rates import rate
from vibroimpact_solvers.attractors.sections import sections
from vibroimpact_solvers.attractors.verdicts import Verdict, verdict
from vibroimpact_solvers.attractors.verification import Confirmed, confirmed
from vibroimpact_solvers.errors import Status
from vibroimpact_solvers.meter import metered, released
from vibroimpact_solvers.periodic_motions.problem import harmonic_forces
from vibroimpact_solvers.periodic_motions.stops.scenes import Scenes
from vibroimpact_solvers.plan import Plan, Stage, Tick
from vibroimpact_solvers.results.attractors import Nature, Result, Verification
from vibroimpact_solvers.stability import neutral

Proof = Confirmed | ConfirmedContacts
_FAILURES: Final = 10
_NORMAL: Final = 1.959963984540054  # two-sided 95 % of the normal distribution
_STATEMENT: Final = (
    "fractions: the interval of Wilson that contains the fraction of all initial states drawn like "
    "the given ones with a probability of 95 %; impact rates: none of periodic attractors, whose "
    "impacts in a period are counted; of others an impact at an end of the observation, and three "
    "standard errors of the means of its tenths; exponents: three times the "
    "range of the growth of a deviation about its mean slope; states of periodic attractors and "
    "points of their sections: an estimate of what is left of the transient; impacts and "
    "multipliers: those of the periodic motion that Newton's method confirms. Time histories of "
    "chaotic motions are not followed exactly: their statistics are what is stated"
)


class Settled(NamedTuple):
    """What motions settle on, and where they end.

    Parameters
    ----------
    result : Result
    x, v : array, shape (motion, dof)
        States at the end, the drive's phase 0; of motions that there are not, the initial ones.
    """

    result: Result
    x: Floats
    v: Floats


def solve(problem: Problem, plan: Plan, tick: Tick | None = None) -> Result:
    """Compute what the plan lists.

    Parameters
    ----------
    problem : Problem
    plan : Plan
        The one that `plan(problem)` returned.
    tick : callable, optional
        Called with (done, total) motions; may raise `Cancelled`.
    """
    return settle(problem, plan, tick).result


@metered
def settle(problem: Problem, plan: Plan, tick: Tick | None = None) -> Settled:
    """Compute what the plan lists, as `solve`, and return the states at the end, too."""
    step = plan.step(Stage.FREE_MOTION)
    assert step is not None
    assert isinstance(step.settings, Batches)
    scenes = _scenes(problem) if problem.stopped else None
    exponents: Exponents = OfContacts(problem, scenes) if scenes else OfImpacts(problem)
    histories = step.settings.history
    groups, failures, undecided = list[Group](), list[str](), list[str]()
    count = problem.size
    row_of, period = np.full(count, -1), np.zeros(count, dtype=np.int64)
    status = np.zeros(count, dtype=np.int64)
    exponent, error = np.full(count, np.nan), np.full(count, np.inf)
    at_a_time, done = step.settings.motions, 0
    x, v = problem.x.copy(), problem.v.copy()

    def report() -> None:
        if tick is not None:
            tick(done, count)

    for start in range(0, count, at_a_time):
        stop = min(start + at_a_time, count)
        motions = list[Observed]()
        with released():
            for row, outcome in observe(problem, histories, start, stop, report):
                if isinstance(outcome, Observed):
                    motions.append(outcome)
                    x[row], v[row] = outcome.x[-1], outcome.v[-1]
                    continue
                status[row] = Status.of(outcome)
                if len(failures) < _FAILURES:
                    failures.append(f"motion {row}: {outcome}")
        rows = [motion.row for motion in motions]
        growth = exponents.of(motions, report)
        exponent[rows], error[rows] = growth.mean, growth.error
        for at, (row, motion) in enumerate(zip(rows, motions, strict=True)):
            settled = verdict(problem, motion, growth, at)
            row_of[row], period[row] = place(problem, groups, settled), settled.period
            if settled.hint and len(undecided) < _FAILURES:
                undecided.append(f"motion {row}: {settled.hint}")
        done = stop
        report()
    newton = plan.step(Stage.IMPULSE) is not None
    proofs: list[Proof]
    if scenes is None:
        proofs = [confirmed(problem, group.shown, newton=newton) for group in groups]
    else:
        proofs = [
            confirmed_contacts(problem, scenes, group.shown, wanted=newton) for group in groups
        ]
    dofs = problem.output_dofs
    values: dict[str, Any] = {
        "Omega": float(problem.Omega[0]),
        "dof": dofs,
        "motion": np.arange(count),
        "settled_status": status,
        "settled_attractor": row_of,
        "settled_period": period,
        "settled_exponent": exponent,
        "error_settled_exponent": error,
        "error_statement": _STATEMENT,
        "error_failures": failures,
        "error_undecided": undecided,
    }
    values |= _attractors(problem, groups, proofs) | _confirmations(groups, proofs, newton=newton)
    shown = [group.shown for group in groups]
    struck = [proof for proof in proofs if isinstance(proof, Confirmed)]
    touched = [proof for proof in proofs if isinstance(proof, ConfirmedContacts)]
    values |= _impacts(problem, groups if struck else [], struck)
    values |= contact_columns.of(problem, shown, touched) | sections(problem, shown, dofs)
    return Settled(Result(**values), x, v)


def _scenes(problem: Problem) -> Scenes:
    """Return the structure with its stops of finite stiffness."""
    load = harmonic_forces(problem.load, problem.system.n)
    return Scenes(problem.system, load, problem.period, spectrum.choose(problem.system))


def _natures(groups: Sequence[Group], proofs: Sequence[Proof]) -> list[Nature]:
    """Return what the attractors are; a motion that rests on an unstable one is undecided."""
    return [
        Nature.UNDECIDED if proof.verification is Verification.UNSTABLE else group.shown.nature
        for group, proof in zip(groups, proofs, strict=True)
    ]


def _attractors(
    problem: Problem, groups: Sequence[Group], proofs: Sequence[Proof]
) -> dict[str, Any]:
    """Return the columns of the table of attractors."""
    shown, dofs = [group.shown for group in groups], problem.output_dofs
    counts = np.array([group.count for group in groups], dtype=np.int64)
    low, high = wilson(counts, int(counts.sum()))
    fraction = counts / max(1, int(counts.sum()))
    growth = np.array([_exponent(group) for group in groups]).reshape(-1, 2)
    left = np.array([one.distance * one.scale for one in shown], dtype=np.float64)
    left = np.repeat(left[:, np.newaxis], dofs.size, axis=1)
    states = np.zeros((2, len(groups), dofs.size))
    impacts = [p.phase.size if isinstance(p, Confirmed) else 0 for p in proofs]
    rates = np.array([
        rate(problem, one, one.motion.impacts.time, count, p.verification)
        for one, count, p in zip(shown, impacts, proofs, strict=True)
    ]).reshape(-1, 2)  # fmt: skip
    for row, one in enumerate(shown):
        states[:, row] = one.motion.x[-1, dofs], one.motion.v[-1, dofs]
    return {
        "attractor_nature": np.array(_natures(groups, proofs), dtype=np.int64),
        "attractor_period": np.array([one.period for one in shown], dtype=np.int64),
        "attractor_impacts": np.array(impacts, dtype=np.int64),
        "attractor_impact_rate": rates[:, 0],
        "error_impact_rate": rates[:, 1],
        "attractor_rests": np.array([one.motion.rests for one in shown], dtype=bool),
        "attractor_exponent": growth[:, 0],
        "error_attractor_exponent": growth[:, 1],
        "attractor_motions": counts,
        "attractor_fraction": fraction,
        "attractor_fraction_low": low,
        "attractor_fraction_high": high,
        "error_fraction": np.maximum(high - fraction, fraction - low),
        "attractor_x": states[0],
        "attractor_v": states[1],
        "error_x": left,
        "error_v": left * float(problem.Omega[0]),
    }


def _exponent(group: Group) -> tuple[float, float]:
    """Return the exponent of an attractor: the mean of all motions, of one where it is periodic."""
    shown = group.shown
    if shown.nature is Nature.UNDECIDED:
        return math.nan, math.inf
    if shown.nature is Nature.PERIODIC:
        return shown.exponent, shown.error
    # Initial states may be equal: that of the mean is not taken to be smaller than that of one.
    return float(np.mean(group.exponents)), float(np.mean(group.errors))


def _confirmations(
    groups: Sequence[Group], proofs: Sequence[Proof], *, newton: bool
) -> dict[str, Any]:
    """Return the columns about Newton's method, None where it was not asked for."""
    if not newton:
        names = ("attractor_verification", "attractor_stability", "attractor_neutral")
        return dict.fromkeys((*names, "error_stability"))
    modulus = np.array([p.stability for p in proofs], dtype=np.float64)
    error = np.array([p.stability_error for p in proofs], dtype=np.float64)
    return {
        "attractor_verification": np.array([p.verification for p in proofs], dtype=np.int64),
        "attractor_stability": modulus,
        "attractor_neutral": neutral(modulus, error),
        "error_stability": error,
    }


def _impacts(
    problem: Problem, groups: Sequence[Group], proofs: Sequence[Confirmed]
) -> dict[str, Any]:
    """Return the table of impacts of periodic attractors."""

    def column(parts: list[Any], kind: type) -> Any:
        return np.concatenate([np.zeros(0, kind), *parts])

    errors = [column([p.errors[k] for p in proofs], np.float64) for k in range(3)]
    both = zip(groups, proofs, strict=True)
    times = [_times(problem, group.shown, proof) for group, proof in both]
    time = column(times, np.float64)
    return {
        "impact_attractor": np.repeat(np.arange(len(proofs)), [p.phase.size for p in proofs]),
        "impact_constraint": column([p.impacts.constraint for p in proofs], np.int64),
        "impact_side": column([p.impacts.side for p in proofs], np.int64),
        "impact_phase": column([p.phase for p in proofs], np.float64),
        "impact_time": time,
        "impact_momentum": column([p.impacts.momentum for p in proofs], np.float64),
        "impact_velocity": column([p.impacts.velocity for p in proofs], np.float64),
        "error_phase": errors[0],
        "error_time": errors[0] / float(problem.Omega[0]) + 2.0 * EPS * time,
        "error_momentum": errors[1],
        "error_velocity": errors[2],
    }


def _times(problem: Problem, one: Verdict, proof: Confirmed) -> Floats:
    """Return the times of impacts in a period of a motion, from its last state on."""
    Omega, turn = float(problem.Omega[0]), 2.0 * math.pi
    end, period = problem.settle + one.motion.periods, one.period
    turns = np.round((Omega * proof.impacts.time - proof.phase) / turn) - end
    return np.asarray((proof.phase + turn * np.mod(turns, max(1, period))) / Omega)


def wilson(counts: np.ndarray[Any, np.dtype[np.int64]], total: int) -> tuple[Floats, Floats]:
    """Return the ends of Wilson's intervals of 95 % of fractions, each of the shape of counts."""
    n, z = float(max(1, total)), _NORMAL
    p = counts / n
    middle = (p + 0.5 * z * z / n) / (1.0 + z * z / n)
    half = z / (1.0 + z * z / n) * np.sqrt(p * (1.0 - p) / n + 0.25 * z * z / n**2)
    return np.maximum(0.0, middle - half), np.minimum(1.0, middle + half)
