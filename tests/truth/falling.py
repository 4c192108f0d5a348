"""Random structures that fall between impacts with one wall, and their periodic motions.

With one impact per period the balance of momentum gives the impulse exactly, and Newton's law one
equation for the phase, a sine and a cosine and a constant: the reference tells how many motions
there are, and their phases, from free motions in 30 digits.
"""

from __future__ import annotations

from typing import Any

import mpmath as mp
import numpy as np
from flint import arb
from scipy.optimize import linear_sum_assignment

from tests.reference.falling import Falling
from tests.truth.structures import Document
from tests.truth.verdicts import ROUNDING, Case, Report
from vibroimpact_solvers import periodic_motions
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

_DIGITS = 30
_DIFFERENCES = 1e-9  # of the largest multiplier, to which differences tell multipliers
_TOUCHING = 1e-6  # of the largest term, within which two motions are about to meet
_POINTS = 200  # of a period, at which the distance from the wall is looked at


def case(rng: np.random.Generator) -> Case:
    """Return one to three bodies in a column; the lowest is struck by a moving ground."""
    n = int(rng.choice([1, 1, 2, 3]))
    M = np.diag(np.round(np.exp(rng.uniform(-1.0, 1.0, n)), 3))
    K = np.zeros((n, n))
    for i in range(n - 1):
        pair = np.eye(n)[i] - np.eye(n)[i + 1]
        K += float(np.round(10.0 ** rng.uniform(0.0, 3.0), 2)) * np.outer(pair, pair)
    C = float(rng.choice([0.0, 0.002, 0.02])) * K + float(rng.choice([0.0, 0.0, 0.25])) * M
    Omega = float(np.round(10.0 ** rng.uniform(0.0, 1.5), 3))
    g = float(rng.choice([1.0, 9.81]))
    fast = g * np.pi / Omega * 10.0 ** rng.uniform(-1.0, 0.7)  # velocity of the ground
    drive = np.diag(M) * float(np.round(fast * Omega, 6))
    if n > 1 and rng.random() < 0.5:
        drive[1:] = 0.0
    document: Document = {
        "M": M.tolist(), "K": K.tolist(), "C": C.tolist(), "force": (-g * np.diag(M)).tolist(),
        "drive": drive.tolist(), "Omega": Omega, "periods": int(rng.choice([1, 1, 2, 3])),
        "restitution": float(rng.choice([0.0, round(float(rng.uniform(0.05, 0.95)), 3), 0.9])),
    }  # fmt: skip
    return Case(f"{n} bodies{', damped' if C.any() else ''}", document)


def problem(document: Document) -> periodic_motions.Problem:
    """Return the problem of the solvers."""
    n, dense = len(document["M"]), SymmetricMatrix.dense
    wall = Constraint((0,), (1.0,), 0.0, None, document["restitution"])
    C = np.array(document["C"])
    of = System(
        dense(document["M"]), dense(document["K"]), (wall,), dense(C) if C.any() else None,
        np.array(document["force"]),
    )  # fmt: skip
    load = (periodic_motions.Force(tuple(range(n)), tuple(document["drive"]), 1.0),)
    impacts = (periodic_motions.Impact(0, -1),)
    return periodic_motions.Problem(
        of, np.array([document["Omega"]]), load, document["periods"], impacts
    )


class _Motions:
    """The motions with one impact per period, by the reference."""

    def __init__(self, document: Document) -> None:
        n = self.n = len(document["M"])
        self.k = mp.mpf(document["restitution"])
        names = ("M", "K", "C", "force", "drive")
        matrices = (np.array(document[name]) for name in names)
        self.free = Falling(
            *matrices, document["Omega"], np.eye(n)[0], document["restitution"]
        )  # fmt: skip
        self.period = 2 * mp.pi * document["periods"] / mp.mpf(document["Omega"])
        weight = sum((mp.mpf(f) for f in document["force"]), mp.mpf(0))
        self.p = -weight * self.period

    def after(self, phase: Any) -> Any:
        """Return the state after an impact at a phase of the drive, whatever Newton's law says."""
        return self.free.periodic([phase / self.free.Omega], [self.p], self.period)

    def excess(self, phase: Any) -> Any:
        """Return by how much the velocity after the impact is more than Newton's law says."""
        return self.free.speed(self.after(phase)) - self.k * self.p * self.free.mu / (1 + self.k)

    @property
    def phases(self) -> tuple[list[Any], bool]:
        """The phases of all motions, and whether two of them are about to meet."""
        values = [self.excess(mp.pi * j / 2) for j in range(3)]
        mean = (values[0] + values[2]) / 2
        cosine, sine = values[0] - mean, values[1] - mean
        size, turn = mp.hypot(cosine, sine), mp.atan2(sine, cosine)
        meet = abs(size - abs(mean)) <= _TOUCHING * (size + abs(mean))
        if size <= abs(mean):
            return [], meet
        half = mp.acos(-mean / size)
        return [turn - half, turn + half], meet


def check(case: Case, report: Report) -> None:
    """Compare the motions of a case with their reference."""
    given = problem(case.document)
    plan = periodic_motions.plan(given)
    report.work(plan)
    result = periodic_motions.solve(given, plan)
    report.phase("reference", 300.0)
    with mp.workdps(_DIGITS):
        motions = _Motions(case.document)
        phases, meet = motions.phases
        if meet:
            report.count("solutions: two about to meet")
            return
        report.count("solutions", len(phases))
        if len(phases) != result.solution_impacts.size:
            found = result.solution_impacts.size
            report.fail("number of solutions", f"{found} instead of {len(phases)}")
            return
        for row in range(len(phases)):
            near = float(result.impact_phase[row])
            turns = [mp.nint((phase - near) / (2 * mp.pi)) for phase in phases]
            apart = [p - 2 * mp.pi * turn for p, turn in zip(phases, turns, strict=True)]
            phase = min(apart, key=lambda each: abs(each - near))
            _check_row(motions, phase, result, row, report)


def _ball(value: Any) -> arb:
    return arb(mp.nstr(value, _DIGITS))


def _check_row(
    motions: _Motions, phase: Any, result: periodic_motions.Result, row: int, report: Report
) -> None:
    mu = motions.free.mu
    for what, value, true, error in (
        ("phase", result.impact_phase, phase, result.error_phase),
        ("momentum", result.impact_momentum, motions.p, result.error_momentum),
        ("velocity", result.impact_velocity, -motions.p * mu / (1 + motions.k),
         result.error_velocity),
    ):  # fmt: skip
        report.compare(what, [float(value[row])], [_ball(true)], float(error[row]))
    z = motions.after(phase)
    assert result.solution_exists is not None
    assert result.solution_certified is not None
    t = phase / motions.free.Omega
    step = mp.expm(motions.free.A * (motions.period / _POINTS))
    whole = mp.matrix([*z, 1, mp.cos(phase), mp.sin(phase)])
    heights = []
    for _ in range(_POINTS - 1):
        whole = step * whole
        heights.append(float(whole[0]))
    low, bend = min(heights), float(np.abs(np.diff(heights, 2)).max())
    exists, certified = bool(result.solution_exists[row]), bool(result.solution_certified[row])
    report.count("verdicts certified" if certified else "verdicts not certified")
    if low < -bend or (low > bend and motions.k > 0):
        if exists != (low > 0.0) and certified:
            report.fail("verdict certified", f"{exists}, height at least {low!r}")
    else:
        report.count("verdict: undecided by points")
    if motions.k == 0 or low < 0.0:
        return  # differences of motions want impacts that are not disturbed
    expected = motions.free.multipliers(z, [t], motions.period)
    assert result.multipliers_real is not None
    assert result.multipliers_imaginary is not None
    assert result.error_multipliers_real is not None
    values = result.multipliers_real[row] + 1j * result.multipliers_imaginary[row]
    if not np.isfinite(values).all():
        report.count("multipliers: grazing")
        return
    apart = np.abs(values[:, np.newaxis] - expected)
    ours, theirs = linear_sum_assignment(apart)
    largest = float(np.abs(expected).max())
    off = apart[ours, theirs]
    errors = result.error_multipliers_real[row][ours]
    allowed = errors + _DIFFERENCES * largest + 4.0 * ROUNDING * np.abs(expected[theirs])
    if (off > allowed).any():
        report.fail("multipliers", f"{values} instead of {expected}, stated {errors}")
    report.count("multipliers", off.size)
