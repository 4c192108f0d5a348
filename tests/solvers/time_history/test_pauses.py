"""Motions look at their signal after every piece of work, and pieces leave no trace in them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.solvers.time_history.test_windows import ALL, sticky
from tests.truth import histories
from vibroimpact_solvers import presets
from vibroimpact_solvers import time_history as th
from vibroimpact_solvers.errors import Cancelled
from vibroimpact_solvers.model import Constraint
from vibroimpact_solvers.time_history import rigid_motions, run, soft

_WHOLE = 2**60
_MOST = 20_000
"""Expansions or steps in one call of a compiled loop: of a small structure some 5 ms."""


def bits(result: Any) -> dict[str, bytes]:
    """Return everything that a result consists of."""
    values = {field.name: getattr(result, field.name) for field in dataclasses.fields(result)}
    return {
        name: value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode()
        for name, value in values.items()
    }


def solved(problem: th.Problem) -> tuple[dict[str, bytes], int]:
    """Compute a motion; return its bits, and how often it looks at its signal."""
    looks = 0

    def tick(done: int, total: int) -> None:
        nonlocal looks
        looks += 1

    return bits(th.solve(problem, th.plan(problem), tick)), looks


def in_pieces(
    monkeypatch: pytest.MonkeyPatch, problem: Callable[[], th.Problem]
) -> tuple[int, int]:
    """Compare a motion in one piece with that in the smallest ones; return the looks of both."""
    monkeypatch.setattr(run, "WORK", _WHOLE)
    monkeypatch.setattr(soft, "WORK", _WHOLE)
    whole, few = solved(problem())
    monkeypatch.setattr(run, "WORK", 1)
    monkeypatch.setattr(soft, "WORK", 1)
    pieces, many = solved(problem())
    assert pieces == whole
    return few, many


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("maker", histories.MAKERS)
def test_pieces_change_no_bit(maker: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of motions of all kinds: damped, loaded, in contact, grazing, from rest."""
    for seed in range(3):
        document = histories.MAKERS[maker](np.random.default_rng([seed, 17]))
        T = 12.0 / histories.top_frequency(document)
        T = min([T, *(term[1][-1] for term in document.get("sampled", ()))])
        document["t_end"], document["t"] = T, np.linspace(0.0, T, 40).tolist()
        few, many = in_pieces(monkeypatch, lambda document=document: histories.problem_of(document))
        assert many > few + 40  # one for each of the samples at least


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("outputs", [{"x", "v"}, {"x", "energy"}])
@pytest.mark.parametrize("estimate", [False, True])
@pytest.mark.parametrize("exponent", [1.5, 3.0, 17.0])
def test_pieces_change_no_bit_of_motions_with_soft_limiters(
    exponent: float, estimate: bool, outputs: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def problem() -> th.Problem:
        chain = presets.chain(3, [Constraint.at(0, 1.0), Constraint.at(2, 0.7)])
        state = th.State(np.zeros(3), np.array([2.0, -1.0, 1.5]))
        return th.Problem(
            chain, state, 20.0, t=np.linspace(0.0, 20.0, 50), outputs=frozenset(outputs),
            limiter=th.Power(exponent, 5.0), estimate=estimate,
        )  # fmt: skip

    few, many = in_pieces(monkeypatch, problem)
    assert many > few + 50


def fast() -> th.Problem:
    """Return a motion between two walls; those that are fast fill the table of impacts."""
    system = presets.chain(2, [Constraint.at(0, 1.0), Constraint.at(1, 0.8, 0.9)])
    start = th.State(np.zeros(2), np.ones(2))
    return th.Problem(system, start, 20.0, t=np.linspace(0.0, 20.0, 50), outputs=ALL)


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("scene", [sticky, fast])
def test_pieces_change_no_bit_of_many_motions(
    scene: Callable[[], th.Problem], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Some fill the table of impacts, some come to rest, some are outside of the limits."""
    rng, pieces = np.random.default_rng(5), []
    x, v = rng.uniform(-0.04, 0.04, (12, 2)), rng.normal(size=(12, 2))
    x[3], v[7], v[8] = 2.0, (0.0, 0.0) if scene is sticky else (900.0, -700.0), 0.0
    for work in (_WHOLE, 1, 40_000):
        monkeypatch.setattr(run, "WORK", work)
        given = scene()
        prepared = th.many.prepare(given, th.plan(given)).rigid
        assert isinstance(prepared, rigid_motions.RigidMotions)
        pieces.append(prepared.solve_some(x, v, 0, 12, lambda *_: None))
    first = pieces[0]
    assert first.places.size == (0 if scene is sticky else 10)
    for piece in pieces[1:]:
        assert piece.places.tolist() == first.places.tolist()
        assert {name: np.asarray(value).tobytes() for name, value in piece.arrays.items()} == {
            name: np.asarray(value).tobytes() for name, value in first.arrays.items()
        }
        assert piece.others.keys() == first.others.keys()
        for place, other in piece.others.items():
            if isinstance(other, Exception):
                assert str(other) == str(first.others[place])
            else:
                assert bits(other) == bits(first.others[place])


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("zeta", [1e3, 1e6, 1e9, 1e12])
def test_hostile_damping_is_looked_after(zeta: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """A search that finds no impact for long is no long call: expansions are counted."""
    longest, calls, follow = 0, 0, run.follow

    def counted(*arguments: Any) -> Any:
        nonlocal longest, calls
        now = arguments[1][2][0]
        before = int(now["expansions"])
        stopped = follow(*arguments)
        longest, calls = max(longest, int(now["expansions"]) - before), calls + 1
        return stopped

    monkeypatch.setattr(run, "follow", counted)
    monkeypatch.setattr(rigid_motions, "follow", counted)

    def tick(done: int, total: int) -> None:
        if calls >= 5:
            raise Cancelled

    wall = [Constraint((0,), (1.0,), None, 0.0, 0.8)]
    problem = th.Problem(
        presets.oscillator(wall, 1.0, zeta), th.State(np.array([-2.0]), np.array([1.0])), 1e5,
        load=(th.Harmonic(0, 1.0, 2.6, 0.0),),
    )  # fmt: skip
    with pytest.raises(Cancelled):
        th.solve(problem, th.plan(problem), tick)
    assert 0 < longest <= _MOST


@pytest.mark.parametrize("first", [0, 1])
def test_motions_of_many_can_be_stopped(first: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every motion looks at the signal, also where it goes on alone: the first and all others."""
    monkeypatch.setattr(run, "WORK", 1)
    given = sticky()
    prepared = th.many.prepare(given, th.plan(given)).rigid
    assert isinstance(prepared, rigid_motions.RigidMotions)
    looks = 0

    def tick(done: int, total: int) -> None:
        nonlocal looks
        looks += 1
        if looks == 20:
            raise Cancelled

    x, v = np.zeros((3, 2)), np.full((3, 2), 0.1)
    with pytest.raises(Cancelled):
        prepared.solve_some(x, v, first, 3, tick)
    assert looks == 20
