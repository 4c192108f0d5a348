"""Documents of loads of motions to those of the solvers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

import numpy as np

from vibroimpact_schema import motions, requests, systems
from vibroimpact_solvers import periodic_motions as driven
from vibroimpact_solvers import time_history as histories
from vibroimpact_solvers import walls
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import System


def decoded(term: Any, place: int, of: System) -> Sequence[histories.Load]:
    """Return what a load of a motion is made of; place is its place among them."""
    match term:
        case motions.HarmonicLoad():  # the first, as there may be thousands of them
            return (histories.Harmonic(term.dof, term.amplitude, term.frequency, term.phase),)
        case motions.HarmonicBase():
            base = force(
                motions.DriveTerm(base=term.base, amplitude=term.amplitude, phase=term.phase),
                place,
                of,
            ).at(term.frequency)
            return [
                histories.Harmonic(dof, base.amplitude * weight, term.frequency, base.phase)
                for dof, weight in zip(base.dofs, base.weights, strict=True)
            ]
        case motions.SampledLoad():
            direction, values = _weights(term, place, of.n), np.array(term.force)
        case motions.BaseMotion():
            given = term.base
            influence = _influence(of, place) if isinstance(given, str) else np.array(given)
            if influence.size != of.n:
                message = f"{influence.size} numbers for {of.n} degrees of freedom"
                raise ModelError(("load", place, "base"), message, code="wrong_length")
            direction, values = -(of.M @ influence), np.array(term.acceleration)
    t = np.array(term.t) if term.interval is None else term.interval * np.arange(values.size)
    return (histories.Sampled(direction, t, values),)


def force(term: motions.DriveTerm, place: int, of: System) -> driven.Force:
    """Return a load of periodic motions; place is its place among them.

    A base whose acceleration is a(t) is the load ``-M r a`` on the displacements relative to it;
    a velocity ``A cos(s)``, s = h Omega t + phase, is the acceleration ``h Omega A cos(s + pi/2)``,
    a displacement ``-(h Omega)^2 A cos(s)``.
    """
    amplitude, phase, power = term.amplitude, term.phase, 2 if term.scale else 0
    if term.base is not None:
        push = -(of.M @ _influence(of, place))
        if term.base == "velocity":
            amplitude, phase, power = term.harmonic * amplitude, phase + 0.5 * math.pi, 1
        elif term.base == "displacement":
            push, amplitude, power = -push, term.harmonic**2 * amplitude, 2
        moved = np.flatnonzero(push)
        dofs, weights = moved.tolist(), push[moved].tolist()
    elif term.direction is None:
        assert term.dof is not None
        dofs, weights = [term.dof], [1.0]
    else:
        dofs, weights = term.direction.dofs, term.direction.weights
    return driven.Force(tuple(dofs), tuple(weights), amplitude, term.harmonic, phase, power)


def wall(document: Sequence[systems.WallSwing] | systems.WallSamples) -> walls.Wall:
    """Return how both walls of a stop move.

    Raises
    ------
    ModelError
        With the pointer inside the constraint.
    """
    if isinstance(document, systems.WallSamples):
        try:
            return walls.Samples(tuple(document.t), tuple(document.y))
        except ModelError as error:
            raise error.under("wall") from None
    terms: list[walls.Swing | walls.Turn] = []
    for place, term in enumerate(document):
        try:
            terms.append(_term(term))
        except ModelError as error:
            raise error.under("wall", place) from None
    return tuple(terms)


def _term(document: systems.WallSwing) -> walls.Swing | walls.Turn:
    frequency, harmonic = document.frequency, document.harmonic
    if harmonic is not None and frequency is None:
        return walls.Turn(document.amplitude, harmonic, document.phase)
    if frequency is not None and harmonic is None:
        return walls.Swing(document.amplitude, frequency, document.phase)
    message = (
        "a term has a frequency or, in periodic motions, a harmonic of the drive: give one of them"
    )
    raise ModelError(("frequency",), message, code="missing_frequency")


def _influence(of: System, place: int) -> Floats:
    if of.influence is None:
        message = "the system needs its influence, the displacements by those of its base"
        raise ModelError(("load", place, "base"), message, code="missing_influence")
    return of.influence


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
def as_sent(request: requests.MotionRequest, of: System) -> Iterator[None]:
    """Let errors of loads point to the field that was sent, whatever became of it."""
    try:
        yield
    except ModelError as error:
        match error.pointer:
            case ("load", int(made), str(name)) if request.load is not None:
                place = _place(request.load, made, of)
                sent = request.load[place].model_fields_set
                names = (name, *_SENT.get(name, ()))
                own = next((each for each in names if each in sent), name)
                raise ModelError(("load", place, own), error.message, code=error.code) from None
        raise


def _place(load: Sequence[Any], made: int, of: System) -> int:
    """Return which term is meant: the first that is wrong itself, or that of a load made of it."""
    last = 0
    for place, term in enumerate(load):
        try:
            last += len(decoded(term, place, of))
        except ModelError:
            return place
        if last > made:
            return place
    return len(load) - 1


_SENT: Final = {
    "t": ("interval",),
    "values": ("force", "acceleration"),
    "direction": ("base", "dof"),
    "dof": ("direction", "base"),
}
"""Field of a load of the solver -> those of documents that it may be made of."""
