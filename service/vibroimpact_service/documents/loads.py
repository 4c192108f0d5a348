"""Documents of loads of motions to those of the solvers."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import numpy as np

from vibroimpact_schema import motions, requests
from vibroimpact_solvers import time_history as histories
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import System


def decoded(term: Any, place: int, of: System) -> histories.Load:
    """Return a load of a motion; place is its place among them."""
    match term:
        case motions.HarmonicLoad():  # the first, as there may be thousands of them
            return histories.Harmonic(term.dof, term.amplitude, term.frequency, term.phase)
        case motions.SampledLoad():
            direction, values = _weights(term, place, of.n), np.array(term.force)
        case motions.BaseMotion():
            if len(term.base) != of.n:
                message = f"{len(term.base)} numbers for {of.n} degrees of freedom"
                raise ModelError(("load", place, "base"), message, code="wrong_length")
            direction, values = -(of.M @ np.array(term.base)), np.array(term.acceleration)
    t = np.array(term.t) if term.interval is None else term.interval * np.arange(values.size)
    return histories.Sampled(direction, t, values)


def _weights(term: motions.SampledLoad, place: int, n: int) -> Floats:
    """Return the direction of a load, shape (dof,)."""
    direction = np.zeros(n)
    given = [] if term.dof is None else [(term.dof, 1.0)]
    if term.direction is not None:
        dofs, weights = term.direction.dofs, term.direction.weights
        if len(dofs) != len(weights):
            message = f"{len(weights)} weights for {len(dofs)} degrees of freedom"
            raise ModelError(("load", place, "direction"), message, code="wrong_length")
        given = list(zip(dofs, weights, strict=True))
    for dof, weight in given:
        if not 0 <= dof < n:
            message = f"{dof} is not below {n}"
            raise ModelError(("load", place, "dof"), message, code="index_out_of_range")
        direction[dof] += weight
    return direction


@contextmanager
def as_sent(request: requests.MotionRequest) -> Iterator[None]:
    """Let errors of loads point to the field that was sent, whatever became of it."""
    try:
        yield
    except ModelError as error:
        match error.pointer:
            case ("load", int(place), str(name)) if request.load is not None:
                sent = request.load[place].model_fields_set
                names = (name, *_SENT.get(name, ()))
                own = next((each for each in names if each in sent), name)
                raise ModelError(("load", place, own), error.message, code=error.code) from None
        raise


_SENT: Final = {
    "t": ("interval",),
    "values": ("force", "acceleration"),
    "direction": ("base", "dof"),
    "dof": ("direction",),
}
"""Field of a load of the solver -> those of documents that it may be made of."""
