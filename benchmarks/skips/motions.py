"""Time histories and slow flows: what their plans leave out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Final

import numpy as np

from benchmarks.cases import chain
from benchmarks.error_against_time.slow_flows import motions
from benchmarks.skips.natural import STIFFNESS
from benchmarks.skips.scene import Scene, solve
from vibroimpact_solvers import attractors, periodic_motions, presets, slow_flow, time_history
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.slow_flow import Initial
from vibroimpact_solvers.time_history import OUTPUTS, Power, Problem, State

_END: Final = 30.0
_TIMES: Final = np.linspace(0.0, _END, 301)
_ALL: Final = frozenset(OUTPUTS)


def scenes() -> Iterator[Scene]:
    """Yield scenes of time histories, and of the slow flow of one model."""
    yield Scene("soft limiters", time_history, _soft, _with_restitution, ("restitution",))
    yield _with_outputs(
        "only impacts requested, N=13", {"impacts"}, "history", "x", "v", "energy", "contacts"
    )
    yield _with_outputs("only displacements requested, N=13", {"x"}, "impacts")
    yield _with_outputs("one of 13 degrees of freedom requested", {"x", "v"}, dofs=np.array([5]))
    yield _with_outputs("no estimate of errors requested, N=13", _ALL, estimate=False)
    push = partial(pushed, partial(chain, 13), t=_TIMES, outputs=frozenset({"x"}))
    yield Scene(
        "no derivatives of a time history requested, N=13",
        time_history,
        push,
        lambda: solve(time_history, push(parameters=(STIFFNESS,))),
        ("derivatives",),
    )
    for output in ("exists", "energy"):
        others = frozenset(periodic_motions.OUTPUTS) - {output}
        yield Scene(
            f"only {output} of periodic motions requested, N=13",
            periodic_motions,
            partial(_periodic, {output}),
            lambda: solve(periodic_motions, _periodic(periodic_motions.OUTPUTS)),
            tuple(sorted(others)),
        )
    for output, other in (("section", "stability"), ("stability", "section")):
        yield Scene(
            f"only {output} of attractors requested",
            attractors,
            partial(_attractors, {output}),
            lambda: solve(attractors, _attractors(attractors.OUTPUTS)),
            (other,),
        )
    (lossy,) = (motion for motion in motions() if motion[0] == "restitution")
    for variant in ("exact", "corrected"):
        yield from slow_flow_scenes(variant, *lossy)


def _periodic(outputs: Any) -> periodic_motions.Problem:
    """Return the response of a damped chain to a drive at its first mass."""
    structure = chain(13)
    K = structure.K.to_dense()
    damped = System(
        structure.M, structure.K, structure.constraints, C=SymmetricMatrix.dense(0.02 * K)
    )
    load, tau = (periodic_motions.Force((0,), (1.0,), 0.1),), np.linspace(0.0, 1.0, 33)
    return periodic_motions.Problem(
        damped, np.linspace(0.2, 1.0, 30), load, outputs=frozenset(outputs), tau=tau
    )


def _attractors(outputs: Any) -> attractors.Problem:
    """Return four motions of a driven mass with one stop."""
    one = SymmetricMatrix.diagonal([1.0])
    stop = Constraint((0,), (1.0,), lower=None, upper=0.5, restitution=0.8)
    system = System(one, one, (stop,), C=SymmetricMatrix.diagonal([0.1]))
    v = np.linspace(-2.0, 1.0, 4)[:, np.newaxis]
    return attractors.Problem(
        system, np.array([1.2]), np.zeros((4, 1)), v, (attractors.Force((0,), (1.0,), 1.0),),
        settle=100, observe=100, outputs=frozenset(outputs),
    )  # fmt: skip


def _with_outputs(name: str, outputs: Any, *states: str, **more: Any) -> Scene:
    push = partial(pushed, partial(chain, 13), t=_TIMES)
    return Scene(
        name,
        time_history,
        partial(push, outputs=frozenset(outputs), **more),
        lambda: solve(time_history, push(outputs=_ALL)),
        states,
    )


def pushed(system: Callable[[], System], speed: float = 1.0, **more: Any) -> Problem:
    """Return the motion from rest at a push of the first mass."""
    structure = system()
    v = np.zeros(structure.n)
    v[0] = speed
    return Problem(structure, State(np.zeros(structure.n), v), _END, **more)


_WALL: Final = Constraint.at(0, 1.0, 0.8)


def _soft() -> Problem:
    system = partial(presets.oscillator, [_WALL], 1.0)
    return pushed(system, speed=3.0, limiter=Power(17.0, 1.0))


def _with_restitution() -> object:
    """Follow the impacts at rigid walls too, whose restitution counts."""
    solve(time_history, pushed(partial(presets.oscillator, [_WALL], 1.0), speed=3.0))
    return solve(time_history, _soft())


def slow_flow_scenes(
    variant: str, model: str, system: System, initial: Initial, end: float
) -> Iterator[Scene]:
    """Yield scenes of one variant of a model."""
    t, every = np.linspace(0.0, end, 300), frozenset(slow_flow.OUTPUTS)

    def requested(*outputs: str) -> slow_flow.Problem:
        return slow_flow.Problem(system, model, variant, initial, t, frozenset(outputs))

    def twice() -> object:
        """Compare the exact motion with itself."""
        problem = requested("x", "error")
        problem.moving.motion("exact", problem.t)
        return solve(slow_flow, problem)

    if variant == "exact":
        name, states = f"{model}, exact: its own error", ("a second solution for the error",)
        yield Scene(name, slow_flow, partial(requested, "x", "error"), twice, states)
        return
    for output in ("x", "state"):
        yield Scene(
            f"{model}, {variant}: only {output} requested",
            slow_flow,
            partial(requested, output),
            lambda: solve(slow_flow, requested(*every)),
            tuple(sorted(every - {output})),
        )
