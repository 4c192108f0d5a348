"""Time histories: what their plans leave out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Final

import numpy as np

from benchmarks.cases import GAP, chain
from benchmarks.free_motions import watching_all
from benchmarks.skips.scene import Scene, solve
from vibroimpact_solvers import presets, time_history
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.time_history import OUTPUTS, Power, Problem, State

_END: Final = 30.0
_TIMES: Final = np.linspace(0.0, _END, 301)
_ALL: Final = frozenset(OUTPUTS)


def scenes() -> Iterator[Scene]:
    """Yield scenes of time histories."""
    for name, problem, states in (
        ("a constraint that the energy does not reach, N=13", _one_far, "constraint 1"),
        ("thirteen constraints, few of them in reach", _many, "walls that are out of reach"),
        (
            "a motion that has no impact any more, N=13",
            _calm,
            "the search after the last possible impact",
        ),
    ):
        yield Scene(name, time_history, problem, partial(_watching, problem), (states,))
    yield Scene(
        "soft limiters",
        time_history,
        _soft,
        _with_restitution,
        ("restitution",),
    )
    yield _with_outputs(
        "only impacts requested, N=13", {"impacts"}, "history", "x", "v", "energy", "contacts"
    )
    yield _with_outputs("only displacements requested, N=13", {"x"}, "impacts")
    yield _with_outputs("one of 13 degrees of freedom requested", {"x", "v"}, dofs=np.array([5]))
    yield _with_outputs("no estimate of errors requested, N=13", _ALL, estimate=False)


def _with_outputs(name: str, outputs: Any, *states: str, **more: Any) -> Scene:
    return Scene(
        name,
        time_history,
        partial(_problem, partial(chain, 13), outputs=frozenset(outputs), t=_TIMES, **more),
        lambda: solve(time_history, _problem(partial(chain, 13), outputs=_ALL, t=_TIMES)),
        states,
    )


def _problem(system: Callable[[], System], speed: float = 1.0, **more: Any) -> Problem:
    """Return the motion from rest at a push of the first mass."""
    structure = system()
    v = np.zeros(structure.n)
    v[0] = speed
    return Problem(structure, State(np.zeros(structure.n), v), _END, **more)


def _watching(problem: Callable[[], Problem]) -> object:
    with watching_all():
        return solve(time_history, problem())


def _one_far() -> Problem:
    constraints = [Constraint.at(5, GAP), Constraint.at(9, 10.0)]
    return _problem(partial(presets.chain, 13, constraints))


def _many() -> Problem:
    """Return a motion whose walls are the farther the farther they are from the push."""
    constraints = [Constraint.at(dof, GAP * (1.0 + dof)) for dof in range(13)]
    return _problem(partial(presets.chain, 13, constraints))


def _calm() -> Problem:
    """Return a motion that is too slow for an impact: what is left after the last one."""
    return _problem(partial(chain, 13), speed=0.1)


_WALL: Final = Constraint.at(0, 1.0, 0.8)


def _soft() -> Problem:
    system = partial(presets.oscillator, [_WALL], 1.0)
    return _problem(system, speed=3.0, limiter=Power(17.0, 1.0))


def _with_restitution() -> object:
    """Follow the impacts at rigid walls too, whose restitution counts."""
    solve(time_history, _problem(partial(presets.oscillator, [_WALL], 1.0), speed=3.0))
    return solve(time_history, _soft())
