"""Stacks and bodies that touch: they fall, strike others, bounce and rest."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.truth import histories
from tests.truth.structures import Document
from tests.truth.verdicts import Case, Report
from vibroimpact_solvers import time_history

_RESTITUTIONS = (0.0, 0.3, 0.5, 0.7, 0.9, 1.0)
_GAPS = (0.0, 0.0, 1e-9, 0.125, 0.25)
_REFUSALS = (*histories.REFUSALS, "depend on one another")
_ROUNDINGS = 1e-11  # of the largest energy: what errors of a motion may make of it


def _column(rng: np.random.Generator, n: int, *, floor: bool) -> list[dict[str, Any]]:
    """Return the limiters of bodies one above the other, the lowest above a floor."""
    gaps = rng.choice(_GAPS, n)
    alike = bool(rng.random() < 0.6)
    k = np.full(n, rng.choice(_RESTITUTIONS)) if alike else rng.choice(_RESTITUTIONS, n)
    return [
        {
            "dofs": [i - 1, i] if i else [0],
            "weights": [-1.0, 1.0] if i else [1.0],
            "lower": float(gaps[i]) if i else float(rng.choice([0.0, 0.1, 1.0])),
            "upper": None,
            "restitution": float(k[i]),
        }
        for i in range(0 if floor else 1, n)
    ]


def _masses(rng: np.random.Generator, n: int) -> np.ndarray:
    if rng.random() < 0.4:
        return np.full(n, float(rng.choice([0.5, 1.0, 2.0])))
    return np.round(np.exp(rng.uniform(-2.0, 2.0, n)), 2)


def stack(rng: np.random.Generator) -> Document:
    """Return bodies above a floor that their weights press together; some hang on springs."""
    n = int(rng.integers(1, 5))
    m, g = _masses(rng, n), float(rng.choice([1.0, 9.81]))
    K = np.diag(rng.choice([0.0, 0.0, 1.0, 10.0], n) * (rng.random() < 0.5))
    v = rng.choice([-1.0, -0.5, 0.0, 0.0, 0.5, 1.0], n)
    document: Document = {"M": np.diag(m).tolist(), "K": K.tolist(), "force": (-g * m).tolist()}
    if rng.random() < 0.2:
        document["C"] = np.diag(0.1 * m).tolist()
    return document | {
        "constraints": _column(rng, n, floor=True), "x": [0.0] * n, "v": v.tolist(),
    }  # fmt: skip


def dropped(rng: np.random.Generator) -> Document:
    """Return bodies that fall side by side, and touch or nearly do."""
    document = stack(rng)
    n = len(document["M"])
    document["v"] = [float(rng.choice([0.0, 0.5]))] * n
    document["K"] = np.zeros((n, n)).tolist()
    document["constraints"][0]["lower"] = float(rng.choice([0.1, 0.5, 1.0]))
    for c in document["constraints"][1:]:
        c["lower"] = float(rng.choice([0.0, 0.0, 1e-9]))
    return document


def cradle(rng: np.random.Generator) -> Document:
    """Return a row of bodies that touch, or nearly; one or several strike the others."""
    n = int(rng.integers(2, 6))
    m = _masses(rng, n)
    K = np.diag(m * float(rng.choice([0.0, 1.0, 4.0])))  # pendulums of one frequency
    v = np.zeros(n)
    v[0] = float(rng.choice([1.0, 0.7]))
    if rng.random() < 0.4:
        v[-1] = -float(rng.choice([1.0, 0.3]))
    document: Document = {"M": np.diag(m).tolist(), "K": K.tolist()}
    constraints = _column(rng, n, floor=False)
    for c in constraints:  # the distance to the next one is what is limited
        c["lower"] = float(rng.choice([0.0, 1e-9, 1e-9, 0.01]))
    return document | {"constraints": constraints, "x": [0.0] * n, "v": v.tolist()}


def wedged(rng: np.random.Generator) -> Document:
    """Return bodies that touch between a floor and a lid."""
    document = stack(rng)
    n = len(document["M"])
    lid = {"dofs": [n - 1], "weights": [1.0], "lower": None,
           "upper": float(rng.choice([0.0, 0.25, 0.5])),
           "restitution": float(rng.choice(_RESTITUTIONS))}  # fmt: skip
    if n == 1:  # both are walls of one coordinate
        document["constraints"][0]["upper"] = lid["upper"] or 0.25
    else:
        document["constraints"].append(lid)
    return document


def coincident(rng: np.random.Generator) -> Document:
    """Return coupled bodies that reach walls at one instant, by their symmetry."""
    n = int(rng.integers(2, 4))
    M = np.eye(n) + float(rng.choice([0.0, 0.125, 0.25])) * (np.ones((n, n)) - np.eye(n))
    K = float(rng.choice([0.0, 1.0])) * np.eye(n) + float(rng.choice([0.0, 0.5])) * (
        n * np.eye(n) - np.ones((n, n))
    )
    k = rng.choice(_RESTITUTIONS, n) if rng.random() < 0.4 else [rng.choice(_RESTITUTIONS)] * n
    constraints = [
        {"dofs": [i], "weights": [1.0], "lower": 0.5, "upper": 0.5, "restitution": float(k[i])}
        for i in range(n)
    ]
    document: Document = {"M": M.tolist(), "K": K.tolist(), "constraints": constraints}
    return document | {"x": [0.0] * n, "v": [float(rng.choice([1.0, 1.5]))] * n}


MAKERS = {maker.__name__: maker for maker in (stack, dropped, cradle, wedged, coincident)}


def case(rng: np.random.Generator) -> Case:
    """Return a random motion."""
    name = str(rng.choice(list(MAKERS)))
    document = MAKERS[name](rng)
    T = float(rng.choice([0.5, 1.0, 2.0]))
    document["t"] = np.sort(rng.uniform(0.0, T, int(rng.choice([3, 10])))).tolist()
    document["t_end"] = T
    return Case(name, document)


def check(case: Case, report: Report) -> None:
    """Compare the motion with its reference; no energy comes from impacts, whatever is known."""
    histories.check(
        case, report, _REFUSALS, found=lambda result: _energies(case.document, result, report)
    )


def _energies(document: Document, result: time_history.Result, report: Report) -> None:
    """Fail where the energy grows: loads are constant, and walls stand still."""
    assert result.energy is not None
    v, M = np.array(document["v"]), np.array(document["M"])
    start = 0.5 * float(v @ M @ v)
    energy = np.concatenate([[start], result.energy])
    forces = np.abs(document.get("force", [0.0]))
    size = max(float(np.abs(energy).max()), float(forces.max()))
    growth = float(np.diff(energy).max())
    report.count("energies")
    if not growth <= _ROUNDINGS * size:
        report.fail("energy grows", f"by {growth!r} of {size!r}")
