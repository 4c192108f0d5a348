"""The functions that kernels cannot do without, in the fastest loops there are on this machine."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from benchmarks.harness import Work
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.jit import fma, kernel
from vibroimpact_solvers.kernels.phases import sine_cosine, tangent


@kernel
def _own_tangents(x: Floats, out: Floats, other: Floats, repeats: int) -> None:
    for _ in range(repeats):
        for i in range(x.size):
            out[i] = tangent(x[i], 0.0)


@kernel
def _own_turns(x: Floats, out: Floats, other: Floats, repeats: int) -> None:
    for _ in range(repeats):
        for i in range(x.size):
            out[i], other[i] = sine_cosine(x[i], 0.0)


@kernel
def _own_secants(x: Floats, out: Floats, other: Floats, repeats: int) -> None:
    for _ in range(repeats):
        for i in range(x.size):
            sine, cosine = sine_cosine(x[i], 0.0)
            out[i] = sine / cosine


@kernel
def _own_sines(x: Floats, out: Floats, other: Floats, repeats: int) -> None:
    for _ in range(repeats):
        for i in range(x.size):
            out[i] = sine_cosine(x[i], 0.0)[0]


@kernel
def _own_growths(x: Floats, out: Floats, other: Floats, repeats: int) -> None:
    for _ in range(repeats):
        for i in range(x.size):
            out[i] = math.exp(-x[i])
        for i in range(x.size):
            gamma = math.sqrt(math.sqrt(out[i]))
            sine, cosine = sine_cosine(x[i], 0.0)
            over = 1.0 / sine_cosine(gamma, 0.0)[0]
            out[i], other[i] = sine * over, cosine * over


@kernel
def _own_arctangents(x: Floats, out: Floats, other: Floats, repeats: int) -> None:
    for _ in range(repeats):
        for i in range(x.size):
            out[i] = math.atan(math.exp(-x[i]))
        for i in range(x.size):
            out[i], other[i] = sine_cosine(x[i] * out[i], 0.0)


@kernel
def _own_shares(x: Floats, out: Floats, other: Floats, repeats: int) -> None:
    for _ in range(repeats):
        for i in range(x.size):
            out[i] = sine_cosine(x[i], 0.0)[0] / x[i]


@kernel
def _own_rotations(x: Floats, out: Floats, other: Floats, repeats: int) -> None:
    for _ in range(repeats):
        for i in range(x.size):
            a, b = x[i], other[i]
            out[i] = 0.8 * a + 0.6 * b
            other[i] = 0.8 * b - 0.6 * a


@kernel
def _own_additions(x: Floats, out: Floats, other: Floats, repeats: int) -> None:
    for _ in range(repeats):
        for i in range(x.size):
            out[i] = fma(0.9, out[i], x[i])


@kernel
def _own_decays(x: Floats, out: Floats, other: Floats, repeats: int) -> None:
    for _ in range(repeats):
        for i in range(x.size):
            out[i] = math.exp(-x[i])
        for i in range(x.size):
            sine, cosine = sine_cosine(x[i], 0.0)
            out[i], other[i] = out[i] * sine, out[i] * cosine


@kernel
def _own_responses(x: Floats, out: Floats, other: Floats, repeats: int) -> None:
    for _ in range(repeats):
        for i in range(x.size):
            out[i] = tangent(x[i], 0.0)
        for k in range(1, 5):
            for i in range(x.size):
                other[i] = math.exp(-k * x[i])


@kernel
def _own_folds(x: Floats, out: Floats, other: Floats, repeats: int) -> None:
    for _ in range(repeats):
        for i in range(x.size):
            half = math.floor(x[i])
            out[i] = x[i] - half - math.floor(0.5 * half)


def _turns(x: Floats, out: Floats, other: Floats) -> None:
    np.sin(x, out=out)
    np.cos(x, out=other)


def _secants(x: Floats, out: Floats, other: Floats) -> None:
    _turns(x, out, other)
    np.divide(out, other, out=out)


def _growths(x: Floats, out: Floats, other: Floats) -> None:
    np.exp(-x, out=out)
    np.sin(np.sqrt(np.sqrt(out)), out=out)
    np.divide(np.sin(x), out, out=other)
    np.divide(np.cos(x), out, out=out)


def _arctangents(x: Floats, out: Floats, other: Floats) -> None:
    np.arctan(np.exp(-x), out=out)
    np.multiply(x, out, out=out)
    _turns(out, other, out)


def _shares(x: Floats, out: Floats, other: Floats) -> None:
    np.divide(np.sin(x, out=out), x, out=out)


def _rotations(x: Floats, out: Floats, other: Floats) -> None:
    np.add(0.8 * x, 0.6 * other, out=out)
    np.subtract(0.8 * other, 0.6 * x, out=other)


def _additions(x: Floats, out: Floats, other: Floats) -> None:
    np.add(np.multiply(0.9, out, out=out), x, out=out)


def _decays(x: Floats, out: Floats, other: Floats) -> None:
    decay = np.exp(-x)
    _turns(x, out, other)
    np.multiply(out, decay, out=out)
    np.multiply(other, decay, out=other)


def _responses(x: Floats, out: Floats, other: Floats) -> None:
    np.tan(x, out=out)
    for k in range(1, 5):
        np.exp(-k * x, out=other)


def _folds(x: Floats, out: Floats, other: Floats) -> None:
    np.floor(x, out=other)
    np.subtract(x, other, out=out)
    np.subtract(out, np.floor(0.5 * other, out=other), out=out)


@dataclass(frozen=True, slots=True)
class Floor:
    """Functions that a kernel cannot do without.

    Parameters
    ----------
    what : str
    library : callable
        Takes numbers and room for two results.
    own : callable
        The same as many times over as its last argument says.
    """

    what: str
    library: Callable[[Floats, Floats, Floats], object]
    own: Callable[[Floats, Floats, Floats, int], object]

    def works(self, numbers: int, repeats: int) -> dict[str, Work]:
        """Return both, over the same numbers."""
        x = np.linspace(0.1, 30.0, numbers)
        out, other = np.empty((2, numbers))

        def library() -> None:
            for _ in range(repeats):
                self.library(x, out, other)

        return {"library": library, "own": partial(self.own, x, out, other, repeats)}


TANGENT: Final = Floor(
    "a tangent, with its division", lambda x, out, _: np.tan(x, out=out), _own_tangents
)
TURN: Final = Floor("a sine and a cosine", _turns, _own_turns)
SECANT: Final = Floor("a sine, a cosine and a division", _secants, _own_secants)
SINE: Final = Floor("a sine", lambda x, out, _: np.sin(x, out=out), _own_sines)
GROWTH: Final = Floor(
    "an exponential, a fourth root, two sines, a cosine and a division", _growths, _own_growths
)
ARCTANGENT: Final = Floor(
    "an exponential, an inverse tangent, a sine and a cosine", _arctangents, _own_arctangents
)
SHARE: Final = Floor("a sine and a division", _shares, _own_shares)
ROTATION: Final = Floor("a rotation", _rotations, _own_rotations)
ADDITION: Final = Floor("a multiplication and addition", _additions, _own_additions)
DECAY: Final = Floor("an exponential, a sine and a cosine", _decays, _own_decays)
RESPONSE: Final = Floor("a tangent and four exponentials", _responses, _own_responses)
FOLD: Final = Floor("two numbers rounded down", _folds, _own_folds)
