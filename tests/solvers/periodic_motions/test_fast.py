"""Fast vibrations in closed form, against the quadrature that follows them."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest

from vibroimpact_solvers import periodic_motions as driven
from vibroimpact_solvers import spectrum
from vibroimpact_solvers.kernels.chosen_products import set_bounds
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.periodic_motions import along
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.pairs import Pairs

pytestmark = pytest.mark.needs("compiled kernels")
NAMES = "x_max", "x_min", "rms", "work", "energy_lost", "energy"
ENERGIES = NAMES[3:5]
SQUARES = np.array([1.0, 3.4, 40.0, 900.0, 901.0, 4e4, 2.5e5, 1e6])
"""Eigenvalues, two of them nearly equal."""


def system(
    C: str, *, k: float = 0.7, rigid: bool = False, force: float = 0.0, both: bool = False
) -> System:
    """Return a structure of eight modes whose frequencies differ by a factor of a thousand."""
    random, n = np.random.default_rng(5), SQUARES.size
    squares = np.where(np.arange(n) == 1, 0.0, SQUARES) if rigid else SQUARES
    E = np.linalg.qr(random.standard_normal((n, n)))[0]
    rate = np.sqrt(np.maximum(squares, 0.0))
    if C == "ratio":
        D = np.diag(0.02 * rate)
    elif C == "stiffness":  # the fast modes are overdamped, those of 500 and 1e3 by little
        D = np.diag(0.02 * rate + 0.0024 * squares)
    elif C == "coupled":
        part = random.standard_normal((n, 3)) * np.sqrt(rate)[:, np.newaxis]
        D = np.diag(0.02 * rate) + 0.01 * part @ part.T
    else:
        D = np.zeros((n, n))
    K = E @ np.diag(squares) @ E.T
    matrices = [SymmetricMatrix.dense(0.5 * (A + A.T)) for A in (np.eye(n), K, E @ D @ E.T)]
    walls = [Constraint((0,), (1.0,), 0.4 if both else None, 0.4, k)]
    walls.append(Constraint((1,), (1.0,), None, 0.5, k))
    constant = force * E[:, 1] * np.sign(E[0, 1])
    return System(matrices[0], matrices[1], tuple(walls), C=matrices[2], force=constant)


def both_ways(
    given: System, monkeypatch: pytest.MonkeyPatch, **options: Any
) -> tuple[driven.Result, driven.Result]:
    """Return the results with fast vibrations in closed form, and without."""
    load = driven.Force((2,), (1.0,), 6.0), driven.Force((3,), (1.0,), 2.0, 2, 0.4)
    if options.get("sequence") == driven.SYMMETRIC:
        load = load[:1]
    known = list[int]()
    chosen = along._divided

    def counted(*given: Any) -> Any:
        fast, mesh = chosen(*given)
        known.append(int(fast.sum()))
        return fast, mesh

    monkeypatch.setattr(along, "_divided", counted)
    results = []
    for pays in (0.0, math.inf):
        monkeypatch.setattr(along, "PAYS", pays)
        outputs = frozenset({"exists", "extremes", "energy"})
        problem = driven.Problem(given, np.array([0.7, 1.3, 2.1]), load, outputs=outputs, **options)
        results.append(driven.solve(problem, driven.plan(problem)))
    half = len(known) // 2
    assert max(known[:half]) >= 1
    assert max(known[half:]) == 0
    return results[0], results[1]


def compared(closed: driven.Result, followed: driven.Result) -> None:
    """Compare results by their errors, which are hardly larger than those of the quadrature."""
    assert (closed.solution_impacts > 0).any()
    for name in NAMES:
        values = [getattr(each, f"solution_{name}") for each in (closed, followed)]
        errors = [getattr(each, f"error_{name}") for each in (closed, followed)]
        assert np.isfinite(values[0]).all(), name
        within = sum(errors) if name in ENERGIES else 0.5 * errors[0]
        assert (np.abs(values[0] - values[1]) <= within).all(), name
        assert (errors[0] <= 4.0 * errors[1]).all(), name
        # Those of work and losses are by their difference, too.
        assert name in ENERGIES or (errors[0] >= 0.999 * errors[1]).all(), name


@pytest.mark.parametrize(
    ("C", "k"),
    [
        *itertools.product(("ratio", "stiffness", "coupled"), (0.0, 0.3, 1.0)),
        ("none", 0.0), ("none", 0.3),
    ],
)  # fmt: skip
def test_whatever_damps_them(C: str, k: float, monkeypatch: pytest.MonkeyPatch) -> None:
    compared(*both_ways(system(C, k=k), monkeypatch))


@pytest.mark.parametrize(
    ("C", "case"),
    [
        ("ratio", "symmetric"), ("stiffness", "symmetric"), ("ratio", "two stops"),
        ("coupled", "two stops"), ("stiffness", "two periods"), ("coupled", "two periods"),
    ],
)  # fmt: skip
def test_sequences(C: str, case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    impacts = driven.Impact(0), driven.Impact(1 if case == "two stops" else 0)
    options = {
        "symmetric": {"sequence": driven.SYMMETRIC},
        "two stops": {"sequence": impacts},
        "two periods": {"sequence": impacts, "periods": 2},
    }
    compared(*both_ways(system(C, both=case == "symmetric"), monkeypatch, **options[case]))


@pytest.mark.parametrize("force", [0.0, 0.05])
def test_beside_rigid_bodies_and_constant_loads(
    force: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    closed, followed = both_ways(
        system("ratio", rigid=force > 0.0, force=force), monkeypatch, dofs=np.array([0, 4, 7])
    )
    compared(closed, followed)


def test_extremes_are_not_below_any_displacement(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither beside the impact, where the fastest vibrations are, nor anywhere else."""
    monkeypatch.setattr(along, "PAYS", 0.0)
    tau = np.concatenate([np.logspace(-9.0, -2.0, 2000), np.linspace(0.01, 1.0, 20_000)])
    problem = driven.Problem(
        system("ratio"), np.array([0.7, 1.3]), (driven.Force((2,), (1.0,), 6.0),),
        outputs=frozenset({"extremes", "waveform"}), tau=tau,
    )  # fmt: skip
    result = driven.solve(problem, driven.plan(problem))
    assert result.waveform is not None
    assert result.solution_x_max is not None
    assert result.solution_x_min is not None
    assert result.error_x_max is not None
    size = np.abs(result.waveform).max(axis=1)
    for beyond in (
        result.solution_x_max - result.waveform.max(axis=1),
        result.waveform.min(axis=1) - result.solution_x_min,
    ):
        assert (beyond >= -2.0 * result.error_x_max).all()
        assert (beyond <= 1e-3 * size).all()
    where = np.argmax(result.waveform, axis=1)
    assert (where == 0).sum() < where.size


def test_one_kind_of_output_is_the_same_without_the_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(along, "PAYS", 0.0)
    load = (driven.Force((2,), (1.0,), 6.0),)
    results = []
    for wanted in ({"extremes", "energy"}, {"extremes"}, {"energy"}):
        problem = driven.Problem(
            system("coupled"), np.array([0.7]), load, outputs=frozenset(wanted)
        )
        results.append(driven.solve(problem, driven.plan(problem)))
    both, extremes, energy = results
    assert np.array_equal(both.solution_x_max, extremes.solution_x_max)
    assert np.allclose(both.solution_rms, extremes.solution_rms, rtol=1e-14)
    assert np.allclose(both.solution_work, energy.solution_work, rtol=1e-13)


@pytest.mark.parametrize("derivative", [2, 3])
@pytest.mark.parametrize("width", [1e-3, 0.1, 3.0])
def test_bounds_of_vibrations(derivative: int, width: float) -> None:
    """Of what rotates, what is overdamped, nearly critical, unstable and rigid, at many times."""
    prepared = pairs_of_all_kinds()
    count = prepared.alpha.size
    start = np.random.default_rng(1).standard_normal((5, 2, count))
    out = np.empty((5, 2 * count))
    set_bounds(prepared.flow, start, np.full(5, width), derivative, out)
    bounds = out.reshape(5, count, 2).transpose(0, 2, 1)[:, np.newaxis]
    times = np.linspace(0.0, width, 301)
    z = prepared.move(prepared.propagators(times), start[:, np.newaxis])
    if derivative == 2:
        parts = (times / width)[:, np.newaxis, np.newaxis]
        found = np.abs(z - (1.0 - parts) * z[:, :1] - parts * z[:, -1:])
    else:
        found = np.abs(prepared.rate(prepared.rate(prepared.rate(z))))
    assert (found <= bounds * (1.0 + 1e-9) + 1e-12).all()
    own = prepared.moving
    assert (found.max(axis=1) >= 1e-3 * bounds[:, 0])[..., own].any(axis=(0, 1)).all()


def pairs_of_all_kinds() -> Pairs:
    """Return the pairs of eight modes without coupling."""
    roots = np.array([1.0, 5.0, 40.0, 1.0, 2.0, 3.0, 0.0, 0.0])
    damping = np.array([0.0, 0.3, 2.0, 2.0 + 1e-9, 7.0, 6.0, 0.0, 0.5])
    system = System(
        SymmetricMatrix.dense(np.eye(8)), SymmetricMatrix.dense(np.diag(roots**2)),
        (Constraint.at(0, 1.0),), C=SymmetricMatrix.dense(np.diag(damping)),
    )  # fmt: skip
    problem = driven.Problem(system, np.array([0.8]), (driven.Force((0,), (1.0,), 1.0),))
    return Driven.of(problem, spectrum.choose(system)).pairs


@pytest.mark.parametrize(("fastest", "closed"), [(30.0, False), (1e6, True)])
def test_plans_tell_what_is_in_closed_form(fastest: float, closed: bool) -> None:
    """And price it, whether or not the fast mode is damped: with what the quadrature would take."""
    flops = []
    for C in (None, SymmetricMatrix.dense(np.diag([0.1, 0.01 * fastest]))):
        M, K = (SymmetricMatrix.dense(A) for A in (np.eye(2), np.diag([1.0, fastest**2])))
        given = System(M, K, (Constraint((0, 1), (1.0, 1.0), None, 0.5, 0.7),), C=C)
        load = (driven.Force((0,), (1.0,), 1.0),)
        planned = driven.plan(driven.Problem(given, np.array([0.9]), load))
        (step,) = (step for step in planned.steps if step.method == "quadrature")
        assert ("closed form" in step.reason) == closed
        flops.append(step.flops)
    assert flops[0] == flops[1]
    assert 1e5 < flops[0] < 1e9
