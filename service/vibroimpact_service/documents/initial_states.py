"""Documents of initial states to those of the solvers."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from vibroimpact_schema import motions
from vibroimpact_solvers import time_history as histories
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import System

One = motions.InitialState | motions.InitialMode


def one(document: One | None, of: System) -> histories.State | histories.ImpactMode:
    """Return what a motion starts from; rest where nothing is said."""
    match document:
        case None:
            return histories.State(np.zeros(of.n), np.zeros(of.n))
        case motions.InitialState(x=x, v=v):
            return histories.State(np.array(x), np.array(v))
        case motions.InitialMode(impact_mode=mode):
            return histories.ImpactMode(mode.Omega, tuple(mode.active or ()))


def many(
    document: motions.InitialStates | One | Sequence[One],
    of: System,
    meter: Callable[[], None] | None = None,
) -> tuple[Floats, Floats]:
    """Return displacements and velocities of many motions, each shape (motion, dof).

    Parameters
    ----------
    document
        Impact modes are computed here.
    of : System
    meter : callable, optional
        Called before each of a list; may raise to end that.

    Raises
    ------
    ModelError
        With the pointer from the request.
    """
    match document:
        case motions.InitialStates(x=x, v=v):
            return np.array(x), np.array(v)
        case motions.InitialState() | motions.InitialMode():
            state = _state(document, of)
            return state.x[np.newaxis], state.v[np.newaxis]
    states = list[histories.State]()
    for place, each in enumerate(document):
        if meter is not None:
            meter()
        try:
            states.append(_state(each, of))
        except ModelError as error:
            pointer = ("initial", place, *error.pointer[1:])
            raise ModelError(pointer, error.message, code=error.code) from None
        for name in ("x", "v"):
            size = getattr(states[-1], name).size
            if size != of.n:
                message = f"{size} numbers for {of.n} degrees of freedom"
                raise ModelError(("initial", place, name), message, code="wrong_length")
    return np.array([state.x for state in states]), np.array([state.v for state in states])


def _state(document: One, of: System) -> histories.State:
    start = one(document, of)
    return start if isinstance(start, histories.State) else histories.state_of(of, start)
