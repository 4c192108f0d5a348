"""Random structures with limiters, of all kinds, as plain documents."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from tests.reference.balls import Structure
from tests.reference.impact_modes import Limiter
from vibroimpact_solvers.laws import Linear
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

Document = dict[str, Any]
"""M, K, and where they are not absent C, force; constraints, each with dofs, weights, lower, upper,
restitution."""

KINDS = ("dense", "diagonal", "chain", "graded", "mirror", "free", "ill", "indefinite")


def structure(rng: np.random.Generator, kind: str, largest: int = 6) -> Document:
    """Return matrices of a kind."""
    n = int(rng.integers(1, largest + 1))
    if kind == "chain":
        n = int(rng.integers(1, 2 * largest + 1))
        M, K = np.eye(n), 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
        if rng.random() < 0.3:
            M, K = M * rng.uniform(0.1, 10.0), K * rng.uniform(0.1, 10.0)
    elif kind == "mirror":
        n = int(rng.integers(2, largest + 1))
        M, K = _mirror(rng, n)
    elif kind == "free":
        n = int(rng.integers(1, largest + 1))
        M = np.diag(rng.uniform(0.3, 3.0, n))
        K = _springs(rng, n, free=True)
        if rng.random() < 0.3:
            M = np.eye(n) * (1.0 if rng.random() < 0.5 else rng.uniform(0.3, 3.0))
    elif kind == "graded":
        M = np.diag(10.0 ** rng.uniform(-2, 2, n))
        K = _springs(rng, n, free=False, decades=5.0)
    elif kind == "diagonal":
        M, K = np.diag(rng.uniform(0.3, 3.0, n)), _springs(rng, n, free=False)
    else:
        condition = 10.0 ** rng.uniform(3, 10) if kind == "ill" else 10.0
        M = _spd(rng, n, condition)
        K = _spd(rng, n, 100.0)
        if kind == "indefinite":
            K = K - np.eye(n) * float(np.quantile(np.linalg.eigvalsh(K), 0.3)) * 1.1
            K = 0.5 * (K + K.T)
    return {"M": M.tolist(), "K": K.tolist()}


def _spd(rng: np.random.Generator, n: int, condition: float) -> Any:
    Q, _ = np.linalg.qr(rng.normal(size=(n, n)))
    A = (Q * condition ** -rng.random(n)) @ Q.T
    A = 0.5 * (A + A.T)
    scale = 1.0 / np.abs(A).max()
    return A * scale


def _springs(rng: np.random.Generator, n: int, *, free: bool, decades: float = 0.5) -> Any:
    K = np.zeros((n, n))
    for i in range(n - 1):
        k = 10.0 ** rng.uniform(-decades, decades)
        K[i, i] += k
        K[i + 1, i + 1] += k
        K[i, i + 1] -= k
        K[i + 1, i] -= k
    if free:  # rows that sum to zero to the last bit
        K = np.round(K * 1024.0) / 1024.0
    else:
        K[0, 0] += 10.0 ** rng.uniform(-decades, decades)
        if rng.random() < 0.5:
            K[-1, -1] += 10.0 ** rng.uniform(-decades, decades)
    return K


def _mirror(rng: np.random.Generator, n: int) -> tuple[Any, Any]:
    half = (n + 1) // 2
    masses = rng.uniform(0.5, 2.0, half) if rng.random() < 0.7 else np.ones(half)
    springs = rng.uniform(0.5, 2.0, n // 2 + 1) if rng.random() < 0.7 else np.ones(n // 2 + 1)
    m = np.array([masses[min(i, n - 1 - i)] for i in range(n)])
    k = np.array([springs[min(i, n - i)] for i in range(n + 1)])
    K = np.diag(k[:-1] + k[1:]) - np.diag(k[1:-1], 1) - np.diag(k[1:-1], -1)
    return np.diag(m), K


def wall(rng: np.random.Generator) -> float:
    """Return the distance of a wall."""
    return 1.0 if rng.random() < 0.5 else float(10.0 ** rng.uniform(-1, 1))


def constraint(
    rng: np.random.Generator, n: int, dof: int | None = None, style: str | None = None
) -> dict[str, Any]:
    """Return a limiter of a degree of freedom, or of a direction."""
    if dof is None and n > 1 and rng.random() < 0.2:
        i, j = rng.choice(n, 2, replace=False)
        dofs, weights = [int(i), int(j)], [1.0, float(rng.choice([-1.0, 0.5, 0.7]))]
    else:
        dofs, weights = [int(rng.integers(n)) if dof is None else dof], [1.0]
    style = style or str(rng.choice(["equal", "unequal", "upper", "lower"], p=[0.5, 0.2, 0.2, 0.1]))
    a, b = wall(rng), wall(rng)
    walls = {"equal": (a, a), "unequal": (a, b), "upper": (None, a), "lower": (a, None)}[style]
    return {
        "dofs": dofs, "weights": weights, "lower": walls[0], "upper": walls[1], "restitution": 1.0
    }  # fmt: skip


def constraints(rng: np.random.Generator, n: int, most: int = 3) -> list[dict[str, Any]]:
    """Return limiters of distinct coordinates."""
    count = min(n, int(rng.choice([1, 2, 3], p=[0.5, 0.35, 0.15])), most)
    kept: list[dict[str, Any]] = []
    style = "equal" if rng.random() < 0.5 else None
    while len(kept) < count:
        new = constraint(rng, n, style=style)
        if all(sorted(new["dofs"]) != sorted(old["dofs"]) for old in kept):
            kept.append(new)
    return kept


def system(document: Document, law: Callable[[dict[str, Any]], Linear] | None = None) -> System:
    """Return the solvers' structure, with rigid limiters or with the law of each."""
    parts: dict[str, Any] = {}
    if document.get("C") is not None:
        parts["C"] = SymmetricMatrix.dense(document["C"])
    if document.get("force") is not None:
        parts["force"] = np.array(document["force"])

    def limiter(c: dict[str, Any]) -> Constraint:
        place = tuple(c["dofs"]), tuple(c["weights"]), c["lower"], c["upper"]
        return (
            Constraint(*place, c["restitution"]) if law is None else Constraint(*place, law=law(c))
        )

    limiters = tuple(limiter(c) for c in document["constraints"])
    M, K = SymmetricMatrix.dense(document["M"]), SymmetricMatrix.dense(document["K"])
    return System(M, K, limiters, **parts)


def reference(document: Document, *, conservative: bool = False) -> Structure:
    """Return the references' structure."""
    C = None if conservative else document.get("C")
    return Structure(
        np.array(document["M"]),
        np.array(document["K"]),
        None if C is None else np.array(C),
        document.get("force"),
        tuple(tuple(term) for term in document.get("load", ())),
        tuple((np.array(d), t, values) for d, t, values in document.get("sampled", ())),
    )


def row(document: Document, constraint: dict[str, Any]) -> Any:
    """Return the direction of a limiter."""
    w = np.zeros(len(document["M"]))
    w[constraint["dofs"]] = constraint["weights"]
    return w


def limiters(document: Document) -> tuple[Limiter, ...]:
    """Return the references' limiters."""
    return tuple(Limiter(row(document, c), c["lower"], c["upper"]) for c in document["constraints"])
