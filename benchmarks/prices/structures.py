"""Structures as users send them: finite elements, chains and random matrices, by seed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
import scipy.linalg
import scipy.sparse

from benchmarks import beams
from vibroimpact_solvers.arrays import Floats

FAMILIES: Final = ("beam", "plate", "frame", "chain", "uneven", "dense", "oscillator")
_BEAMS: Final = (25, 50, 150, 300)  # elements of the beams of the design
_SMALL_BEAMS: Final = (3, 8, 16, 25)
_LOSS: Final = 0.02  # damping ratio of the first mode
_LARGE: Final = 100  # degrees of freedom that small structures do not exceed


@dataclass(frozen=True, eq=False)
class Structure:
    """A structure and what requests about it are made of.

    Parameters
    ----------
    name : str
        Family and number of degrees of freedom.
    document : dict
        As in requests, with one stop.
    damped : dict
        The same with damping.
    n, dof : int
        Degrees of freedom, and the one with the stop.
    first : float
        Lowest natural frequency.
    share : float
        Square of the first mode, normed by the masses, at the stop.
    gap : float
    """

    name: str
    document: dict[str, Any]
    damped: dict[str, Any]
    n: int
    dof: int
    first: float
    share: float
    gap: float

    def force(self, size: float) -> float:
        """Return the load at the stop that drives the first mode to so many gaps."""
        return size * self.gap * 2.0 * _LOSS * self.first**2 / self.share


def draw(random: np.random.Generator, *, small: bool = False, largest: bool = False) -> Structure:
    """Return a structure; a small one, or one that may have hundreds of degrees of freedom."""
    family = FAMILIES[int(random.integers(len(FAMILIES)))]
    if family == "beam":
        counts = _SMALL_BEAMS if small else _BEAMS if largest else _BEAMS[:2]
        return structure(family, int(random.choice(counts)), 0)
    top = _LARGE if small else 600 if largest else 200
    scale = np.exp(random.uniform(np.log(2.0), np.log(top)))
    return structure(family, max(2, int(scale)), int(random.integers(1000)))


@lru_cache(maxsize=64)
def structure(family: str, size: int, seed: int) -> Structure:
    """Return the structure of a family with about `size` degrees of freedom (beams: elements)."""
    random = np.random.default_rng(seed)
    if family == "oscillator":
        return _finished("oscillator", np.eye(1), np.eye(1), 0, 0.2, dense=False)
    if family == "chain":
        return _chain(size)
    if family == "beam":
        M, K = beams.matrices(size)
        return _finished(family, M, K, len(M) - 2, 0.01, dense=False)
    if family == "plate":
        M, K = plate(max(2, round(size**0.5)))
    elif family == "frame":
        M, K = frame(max(1, size // 8))
    elif family == "uneven":
        springs = random.uniform(0.5, 1.5, size + 1)
        K = np.diag(springs[:-1] + springs[1:])
        K -= np.diag(springs[1:-1], 1) + np.diag(springs[1:-1], -1)
        M = np.diag(random.uniform(0.5, 1.5, size))
    else:
        size = min(size, 80)
        frequencies = np.sort(random.uniform(0.3, 3.0, size))
        E = random.standard_normal((size, size)) / np.sqrt(size) + 2.0 * np.eye(size)
        M, K = E @ E.T, (E * frequencies**2) @ E.T
    return _finished(family, M, K, int(0.6 * len(M)), 0.2, dense=family == "dense")


def _chain(size: int) -> Structure:
    place, gap = int(0.37 * size), 0.2
    limiter = {"dof": place, "gap": gap}
    first = 2.0 * np.sin(0.5 * np.pi / (size + 1))
    share = 2.0 / (size + 1) * np.sin(np.pi * (place + 1) / (size + 1)) ** 2
    springs = {"0": [2.0] * size, "1": [-1.0] * (size - 1)}
    damped = {
        "M": {"scalar": 1.0, "n": size},
        "K": {"bands": springs},
        "C": {"scalar": 2.0 * _LOSS * first, "n": size},
        "constraints": [{**limiter, "restitution": 0.8}],
    }
    document = {"preset": "chain", "n": size, "constraints": [limiter]}
    return Structure(f"chain {size}", document, damped, size, place, first, share, gap)


def _finished(family: str, M: Floats, K: Floats, dof: int, gap: float, *, dense: bool) -> Structure:
    """Return a structure of its matrices, with Rayleigh damping, 2 % at its first mode."""
    M, K = 0.5 * (M + M.T), 0.5 * (K + K.T)
    values, modes = scipy.linalg.eigh(K, M, subset_by_index=[0, 0])
    first, b = float(np.sqrt(values[0])), 1e-3 / float(np.sqrt(values[0]))
    C = 2.0 * first * (_LOSS - 0.5 * b * first) * M + b * K
    n, share = len(M), max(float(modes[dof, 0] ** 2), 1e-3 / len(M))
    limiter = {"dof": dof, "gap": gap}
    plain = {"M": _matrix(M, dense=dense), "K": _matrix(K, dense=dense)}
    damped = {**plain, "C": _matrix(C, dense=dense)}
    return Structure(
        f"{family} {n}",
        {**plain, "constraints": [limiter]},
        {**damped, "constraints": [{**limiter, "restitution": 0.8}]},
        n, dof, first, share, gap,
    )  # fmt: skip


def _matrix(matrix: Floats, *, dense: bool) -> Any:
    if dense:
        return matrix.tolist()
    if np.count_nonzero(matrix - np.diag(np.diagonal(matrix))) == 0:
        return {"diagonal": np.diagonal(matrix).tolist()}
    entries = scipy.sparse.coo_array(matrix)
    row, col = entries.coords
    return {
        "shape": list(matrix.shape), "row": row.tolist(), "col": col.tolist(),
        "data": entries.data.tolist(),
    }  # fmt: skip


def plate(side: int) -> tuple[Floats, Floats]:
    """Return a simply supported plate by finite differences, its masses lumped."""
    line = 2.0 * np.eye(side) - np.eye(side, k=1) - np.eye(side, k=-1)
    laplace = np.kron(line, np.eye(side)) + np.kron(np.eye(side), 1.3 * line)
    return np.eye(side * side), laplace @ laplace


def frame(elements: int) -> tuple[Floats, Floats]:
    """Return a portal of two clamped columns and a girder, each of some beam elements.

    Columns do not change their length: the girder moves with them as a whole.
    """
    stiffness, mass = beams.element(1.0 / elements)
    column, size = 2 * elements, 6 * elements
    M, K = np.zeros((2, size, size))
    left = [-1, -1, *range(column)]
    right = [-1, -1, *range(column, 2 * column - 2), column - 2, 2 * column - 2]
    girder = [-1, column - 1, *range(2 * column - 1, size - 2), -1, 2 * column - 2]
    for line in (left, right, girder):
        for first in range(0, len(line) - 3, 2):
            for i, p in enumerate(line[first : first + 4]):
                for j, q in enumerate(line[first : first + 4]):
                    if p >= 0 and q >= 0:
                        K[p, q] += stiffness[i, j]
                        M[p, q] += mass[i, j]
    used = np.flatnonzero(np.diagonal(M))
    M, K = M[np.ix_(used, used)], K[np.ix_(used, used)]
    M[column - 2, column - 2] += beams.RHO_A  # the girder's own mass moves sideways
    return M, K
