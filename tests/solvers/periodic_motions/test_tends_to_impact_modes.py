"""Symmetric motions tend to the impact modes as damping, load and losses vanish together.

The table of `docs/theory/periodic-motions.md` is what this test computes; printed by
``python -m tests.solvers.periodic_motions.test_tends_to_impact_modes``.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from vibroimpact_solvers import impact_modes
from vibroimpact_solvers import periodic_motions as driven
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

SIZES = (1, 3, 10)
SCALES = tuple(10.0**-k for k in range(2, 7))
PAGE = Path(__file__).parents[3] / "docs" / "theory" / "periodic-motions.md"


def errors(n: int, scale: float) -> tuple[float, float]:
    """Return relative errors of the momentum and of the displacements at the impact.

    A chain whose middle mass is between stops, 5 % above its highest natural frequency, with
    C = scale K, k = 1 - scale, and a load of 20 scale on the same mass.
    """
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    one, stiff = SymmetricMatrix.diagonal(np.ones(n)), SymmetricMatrix.dense(K)
    Omega = np.array([1.05 * 2.0 * math.sin(0.5 * math.pi * n / (n + 1))])
    at = n // 2
    elastic = System(one, stiff, (Constraint.at(at, 1.0),))
    outputs = frozenset({"impulse", "exists", "shape"})
    family = impact_modes.Problem(elastic, Omega * 2.0 / np.pi, Omega=Omega, outputs=outputs)
    mode = impact_modes.solve(family, impact_modes.plan(family))
    assert mode.exists is not None
    assert mode.exists.all()
    assert mode.shape is not None
    assert mode.impulse is not None
    momentum = math.pi * mode.impulse[0, 0] / Omega[0]

    wall = Constraint.at(at, 1.0, restitution=1.0 - scale)
    lossy = System(one, stiff, (wall,), C=SymmetricMatrix.dense(scale * K))
    load = (driven.Force((at,), (1.0,), 20.0 * scale),)

    def solved(tau: float) -> tuple[driven.Result, int]:
        problem = driven.Problem(
            lossy, Omega, load, sequence=driven.SYMMETRIC, tau=np.array([tau]),
            outputs=frozenset({"exists", "waveform"}),
        )  # fmt: skip
        result = driven.solve(problem, driven.plan(problem))
        upper = np.flatnonzero(result.impact_side > 0)
        return result, int(upper[np.argmax(result.impact_momentum[upper])])

    result, impact = solved(0.0)
    result, impact = solved(float(result.impact_phase[impact]) / (2.0 * math.pi))
    row = result.impact_solution[impact]
    assert result.solution_exists is not None
    assert result.solution_exists[row]
    assert result.waveform is not None
    x, shape = result.waveform[row, 0], mode.shape[0]
    off = np.abs(x - shape).max() / np.abs(shape).max()
    return abs(float(result.impact_momentum[impact]) / momentum - 1.0), float(off)


def table() -> list[list[float]]:
    """Return rows of the scale and both errors for each size."""
    return [[scale, *(error for n in SIZES for error in errors(n, scale))] for scale in SCALES]


@pytest.fixture(scope="module")
def computed() -> np.ndarray:
    return np.array(table())


def test_the_order_is_one(computed: np.ndarray) -> None:
    apart = computed[:, 1:]
    apart = apart[:, apart.max(axis=0) > 1e-12]
    orders = np.log10(apart[:-1] / apart[1:])
    assert orders == pytest.approx(1.0, abs=0.25)
    assert orders[-2:] == pytest.approx(1.0, abs=1e-2)


def test_the_only_mass_is_at_its_wall(computed: np.ndarray) -> None:
    assert (computed[:, 2] < 1e-14).all()


def test_the_page_shows_these_numbers(computed: np.ndarray) -> None:
    text = PAGE.read_text(encoding="utf-8")
    rows = [
        [float(cell) for cell in line.strip("| ").split("|")]
        for line in text.splitlines()
        if re.match(r"\| 1e-\d \|", line)
    ]
    shown = np.delete(computed, 2, axis=1)
    assert np.array(rows) == pytest.approx(shown, rel=6e-3)


if __name__ == "__main__":
    for line in table():
        scale, *apart = np.delete(line, 2)
        cells = [f"{scale:.0e}".replace("e-0", "e-"), *(f"{e:.2e}" for e in apart)]
        print("| " + " | ".join(cells) + " |")
