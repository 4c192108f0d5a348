"""Impacts of several coordinates at one instant: laws in 77 digits, and an energy that never grows.

The laws are those of the reference, found by trying which coordinates are struck. Whatever they
are, the kinetic energy after the impact is no more than before it, and nothing goes on into its
wall; both are told by the velocities that are given back, in more digits than they have.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from flint import arb

from tests.reference.balls import UndecidedError, matrix
from tests.truth.histories import problem_of, truth
from tests.truth.structures import Document
from tests.truth.verdicts import ROUNDING, Case, Report
from vibroimpact_solvers import time_history
from vibroimpact_solvers.errors import ConvergenceError

_SOON = 2.0**-40  # when velocities are looked at: nothing else happens until then
_ROUNDINGS = 256.0  # of velocities, times the condition numbers of what is solved for impulses


def _rows(rng: np.random.Generator, kind: str, n: int, m: int) -> np.ndarray:
    """Return directions of coordinates, of small integers in floating point."""
    if kind == "row":  # bodies in a row above a floor
        return np.eye(n)[:m] - np.eye(n, k=-1)[:m]
    if kind == "pairs":  # relative displacements, as many as there are
        pairs = rng.permutation([(i, j) for i in range(n) for j in range(i)])[:m]
        return np.array([np.eye(n)[i] - np.eye(n)[j] for i, j in pairs])
    W = rng.integers(-3, 4, (m, n)).astype(np.float64)
    W[~W.any(axis=1), 0] = 1.0
    if kind == "dependent" and m > 2:
        W[-1] = W[0] + W[m // 2]
        W[-1, 0] += 0.0 if W[-1].any() else 1.0
    return W


def case(rng: np.random.Generator) -> Case:
    """Return velocities of a structure whose coordinates are all at their walls."""
    n = int(rng.integers(2, 6))
    kind = str(rng.choice(["row", "pairs", "directions", "dependent", "unlike"]))
    m = n if kind in {"row", "unlike"} else int(rng.integers(2, min(n + 2, 6)))
    W = _rows(rng, "row" if kind == "unlike" else kind, n, m)
    alike = W @ W.T  # directions of one coordinate are one limiter
    alike = alike / np.sqrt(np.outer(alike.diagonal(), alike.diagonal()))
    W = W[[i for i in range(len(W)) if (np.abs(alike[i, :i]) < 1.0 - 1e-12).all()]]
    m = len(W)
    decades = 3.0 if kind == "unlike" else 0.5
    M = np.diag(np.round(10.0 ** rng.uniform(-decades, decades, n), 4))
    if kind == "directions":
        spread = rng.integers(-2, 3, (n, n)).astype(np.float64)
        M = M + spread @ spread.T / 8.0
    law = str(rng.choice(["equal", "unequal", "elastic", "plastic", "nearly elastic"]))
    k = {
        "equal": np.full(m, round(float(rng.uniform(0.05, 0.95)), 3)),
        "unequal": np.where(rng.random(m) < 0.3, rng.choice([0.0, 1.0], m), rng.random(m)),
        "elastic": np.ones(m),
        "plastic": np.zeros(m),
        "nearly elastic": 1.0 - rng.choice([0.0, 1e-12, 1e-3], m),
    }[law]
    constraints = [
        {
            "dofs": [int(i) for i in np.flatnonzero(w)],
            "weights": [float(w[i]) for i in np.flatnonzero(w)],
            "lower": None, "upper": 0.0, "restitution": float(k[a]),
        }
        for a, w in enumerate(W)
    ]  # fmt: skip
    v = np.round(rng.standard_normal(n), 3)
    document: Document = {"M": M.tolist(), "K": np.zeros((n, n)).tolist()}
    document |= {"constraints": constraints, "x": [0.0] * n, "v": v.tolist()}
    return Case(f"{kind}, {law}", document | {"t": [_SOON], "t_end": _SOON})


def check(case: Case, report: Report) -> None:
    """Compare velocities after the impacts with those of the reference, and energies."""
    document = case.document
    problem = problem_of(document)
    plan = time_history.plan(problem)
    report.work(plan)
    try:
        result = time_history.solve(problem, plan)
    except ConvergenceError as error:
        if "depend on one another" not in str(error):
            raise
        report.count("refused: contacts that depend on one another")
        return
    assert result.v is not None
    assert result.impact_impulse is not None
    report.count("impacts", int(result.impact_impulse.size))
    report.phase("reference")
    M, v = np.array(document["M"]), np.array(document["v"])
    W = np.zeros((len(document["constraints"]), len(M)))
    for a, c in enumerate(document["constraints"]):
        W[a, c["dofs"]] = c["weights"]
    mobility = W @ np.linalg.solve(M, W.T)
    scale = np.sqrt(np.diag(mobility))
    own = np.linalg.svd(mobility / np.outer(scale, scale), compute_uv=False)
    independent = bool(own[-1] > 1e-10)
    rounding = _ROUNDINGS * ROUNDING / float(own[own > 1e-10][-1])
    _check_energy(M, v, result.v[0], rounding, report)
    size = float(np.sqrt(v @ M @ v))
    towards = (W @ result.v[0]) / scale
    if towards.max() > rounding * size:
        report.fail("goes on into its wall", f"{towards.max()!r} of {size!r}")
    if not independent:
        report.count("impulses that depend on one another: energy alone")
        return
    try:
        state = truth(document).states[0]
    except UndecidedError as error:
        report.count(f"undecided: {error}")
        return
    n = len(v)
    off = np.array([float(arb(float(result.v[0, i])) - state[n + i, 0]) for i in range(n)])
    apart = float(np.sqrt(off @ M @ off))
    report.count("velocities")
    if apart > rounding * size:
        report.fail("velocities", f"{result.v[0]} off by {off}, {apart / size / ROUNDING:.3g} eps")


def _check_energy(
    M: np.ndarray, before: np.ndarray, after: np.ndarray, rounding: float, report: Report
) -> None:
    def energy(v: np.ndarray) -> Any:
        column = matrix(v.reshape(-1, 1))
        return (column.transpose() * matrix(M) * column)[0, 0] / 2

    start = energy(before)
    growth = float(energy(after) - start)
    report.count("energies")
    if growth > rounding * float(start):
        report.fail("energy grows", f"by {growth!r} of {float(start)!r}")
