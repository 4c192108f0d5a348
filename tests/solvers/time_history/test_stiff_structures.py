"""Motions of finite-element structures that meet no stop, against modes in ball arithmetic.

Their natural frequencies differ by up to 1e6. 0.2.0 gave infinite errors above 256 degrees of
freedom, and below it velocities of a beam that errors of its start put off by 800 times theirs.
"""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from flint import arb, ctx

from benchmarks import beams as finite_elements
from tests.reference import modal
from tests.solvers import beams
from vibroimpact_solvers import time_history as th
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

PERIOD = 2.0 * np.pi / beams.OMEGA
STORED = Path(__file__).with_name("beam_of_600.json")
"""The motion of the beam of 300 elements by `reference.modal`, which takes it a minute."""


def motion_of(
    system: System, x: np.ndarray, v: np.ndarray, times: np.ndarray, load: tuple[int, float, float]
) -> th.Result:
    problem = th.Problem(
        system, th.State(x, v), float(times[-1]), t=times, outputs=frozenset({"x", "v", "impacts"}),
        load=(th.Harmonic(*load, 0.0),),
    )  # fmt: skip
    result = th.solve(problem, th.plan(problem))
    assert result.count_impacts == 0
    assert result.error_predictable_until == times[-1]
    return result


def start_of_beam(elements: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the deflection by a force at the tip, and the velocity of a parabola."""
    along = np.arange(1, elements + 1) / elements
    x, v = np.zeros((2, 2 * elements))
    x[::2] = 0.0015 * along * along * (3.0 - along)
    x[1::2] = 0.0015 * along * (6.0 - 3.0 * along)
    v[::2], v[1::2] = 0.05 * along * along, 0.1 * along
    return x, v


def check(true: np.ndarray, stated: np.ndarray, size: float, least: float) -> None:
    """No number is off by more than stated, and errors stated are small beside the motion."""
    assert np.isfinite(stated).all()
    assert (true <= stated).all()
    assert stated.max() < least * size


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("damped", [False, True])
def test_a_beam_of_300_degrees_of_freedom(*, damped: bool) -> None:
    beam = beams.cantilever(150, damped=damped)
    x, v = start_of_beam(150)
    times, load = np.array([0.0, 0.013, 0.5, 3.3, 10.0]) * PERIOD, (298, 0.2, 0.7 * beams.OMEGA)
    result = motion_of(beam, x, v, times, load)
    C = None if beam.C is None else beam.C.to_dense()
    modes = modal.Modes.of(beam.M.to_dense(), beam.K.to_dense(), C)
    xs, vs = modes.motion(x, v, times, load)
    for name, exact, least in (("x", xs, 1e-11), ("v", vs, 1e-6)):
        values, stated = getattr(result, name), getattr(result, f"error_{name}")
        true = np.array([modal.distances(*pair) for pair in zip(exact, values, strict=True)])
        check(true, stated, float(np.abs(values).max()), least)


@pytest.mark.needs("compiled kernels")
def test_a_beam_of_600_degrees_of_freedom() -> None:
    stored = json.loads(STORED.read_text())
    beam, (x, v) = beams.cantilever(300), start_of_beam(300)
    times = np.array(stored["t"])
    result = motion_of(beam, x, v, times, (598, 0.2, 0.7 * beams.OMEGA))
    ctx.prec = modal.BITS
    for name, least in (("x", 1e-10), ("v", 1e-5)):
        values, stated = getattr(result, name), getattr(result, f"error_{name}")
        some = stored["dof"]
        true = np.array(
            [
                [abs(float(arb(text) - arb(float(y)))) for text, y in zip(texts, row, strict=True)]
                for texts, row in zip(stored[name], values[:, some], strict=True)
            ]
        )
        check(true, stated[:, some], float(np.abs(values).max()), least)


@pytest.mark.needs("compiled kernels")
def test_a_plate_with_pairs_of_equal_frequencies() -> None:
    """A square plate by differences, simply supported: all modes are products of sines."""
    side = 17
    n, line = side * side, 2.0 * np.eye(side) - np.eye(side, k=1) - np.eye(side, k=-1)
    laplace = np.kron(line, np.eye(side)) + np.kron(np.eye(side), line)
    K = 2.0**14 * laplace @ laplace  # integers: exact
    stop = Constraint.at(n // 2, 10.0)
    plate = System(SymmetricMatrix.diagonal(np.ones(n)), SymmetricMatrix.dense(K), (stop,))
    rng = np.random.default_rng(5)
    x, v = np.zeros(n), np.zeros(n)
    x[:] = np.kron(*np.outer([1.0, 2.0], np.sin(np.arange(1, side + 1) / 5.0)))
    v[: 2 * side] = rng.uniform(-1.0, 1.0, 2 * side)
    times, load = np.array([0.0, 0.03, 1.0, 20.0]), (40, 1e4, 7.0)
    result = motion_of(plate, x, v, times, load)
    ctx.prec = modal.BITS
    sines = [
        [(arb(2) / (side + 1)).sqrt() * arb.sin_pi(arb(i * k) / (side + 1)) for k in range(1, 18)]
        for i in range(1, 18)
    ]
    lines = [4 * arb.sin_pi(arb(i) / (2 * (side + 1))) ** 2 for i in range(1, 18)]
    shapes = modal.arb_mat(
        [[one[i] * two[k] for one in sines for two in sines] for i in range(17) for k in range(17)]
    )
    squares = [2**14 * (a + b) ** 2 for a in lines for b in lines]
    modes = modal.Modes(shapes, shapes.transpose(), squares, [arb(0)] * n)
    xs, vs = modes.motion(x, v, times, load)
    for name, exact in (("x", xs), ("v", vs)):
        values, stated = getattr(result, name), getattr(result, f"error_{name}")
        true = np.array([modal.distances(*pair) for pair in zip(exact, values, strict=True)])
        check(true, stated, float(np.abs(values).max()), 1e-10)


def frame(elements: int) -> tuple[np.ndarray, np.ndarray]:
    """Return M and K of a portal frame, whose right column is longer, three dofs at each node."""
    corners = np.array([[0.0, 0.0], [0.0, 1.0], [1.5, 1.0], [1.5, -0.25]])
    nodes = 3 * elements + 1
    M, K = np.zeros((2, 3 * nodes, 3 * nodes))
    for bar, (start, stop) in enumerate(itertools.pairwise(corners)):
        span = stop - start
        h = float(np.linalg.norm(span)) / elements
        c, s = span / np.linalg.norm(span)
        turn = np.kron(np.eye(2), np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))
        bending, heavy = (np.zeros((6, 6)) for _ in range(2))
        bend, mass = finite_elements.element(h)
        across, along = np.array([1, 2, 4, 5]), np.array([0, 3])
        bending[np.ix_(across, across)], heavy[np.ix_(across, across)] = bend, mass
        bending[np.ix_(along, along)] = 1e6 / h * np.array([[1.0, -1.0], [-1.0, 1.0]])
        heavy[np.ix_(along, along)] = (
            finite_elements.RHO_A * h / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
        )
        for element in range(elements):
            first = 3 * (bar * elements + element)
            some = slice(first, first + 6)
            K[some, some] += turn.T @ bending @ turn
            M[some, some] += turn.T @ heavy @ turn
    held = slice(3, -3)
    return M[held, held], K[held, held]


@pytest.mark.needs("compiled kernels")
def test_a_frame() -> None:
    M, K = frame(30)
    M, K = 0.5 * (M + M.T), 0.5 * (K + K.T)
    n = len(M)
    matrices = [SymmetricMatrix.leanest(beams.scipy.sparse.csr_array(A)) for A in (M, K)]
    portal = System(*matrices, (Constraint.at(87, 10.0),))
    assert n > 256
    x, v = np.zeros((2, n))
    v[87::3] = 0.1
    times, load = np.array([0.0, 0.02, 0.3, 2.0]), (90, 3.0, 11.0)
    result = motion_of(portal, x, v, times, load)
    xs, vs = modal.Modes.of(M, K, None).motion(x, v, times, load)
    for name, exact, least in (("x", xs, 1e-10), ("v", vs, 1e-7)):
        values, stated = getattr(result, name), getattr(result, f"error_{name}")
        true = np.array([modal.distances(*pair) for pair in zip(exact, values, strict=True)])
        check(true, stated, float(np.abs(values).max()), least)
