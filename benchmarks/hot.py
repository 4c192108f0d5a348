"""The hot kernels that the guard watches, with arguments as the solvers give them.

To watch another one: add a line to `HOT`, and ``python -m benchmarks.instructions --usual`` and
``python -m benchmarks.guard --usual`` measure what is usual for it. Solvers are imported where
they are called: under valgrind, where every import takes seconds, kernels alone are wanted.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from importlib import import_module
from types import ModuleType
from typing import Any, Final
from unittest import mock

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.jit import fma, kernel
from vibroimpact_solvers.kernels.passages import first_passage
from vibroimpact_solvers.kernels.triangle_time import (
    even_response,
    hyperbolic_cosine,
    hyperbolic_sine,
    odd_response,
)
from vibroimpact_solvers.kernels.waves import fold

VECTOR: Final = "a vector loop"
SCALAR: Final = "a loop of sines and cosines"


@dataclass(frozen=True, slots=True)
class Watched:
    """A hot kernel and what it is called with.

    Parameters
    ----------
    module, function : str
        Where it is.
    arguments : tuple
        Arrays are copied before the call: kernels write into theirs.
    reference : str
        The loop it is compared with, `VECTOR` or `SCALAR`.
    calls : int
        How often it is called in one go.
    """

    module: str
    function: str
    arguments: tuple[Any, ...]
    reference: str = SCALAR
    calls: int = 1

    def __call__(self) -> None:
        """Call it."""
        function = getattr(import_module(self.module), self.function)
        for _ in range(self.calls):
            function(*(a.copy() if isinstance(a, np.ndarray) else a for a in self.arguments))


@kernel
def polynomials(x: Floats, y: Floats, terms: int) -> None:
    """Sum quotients of polynomials: a vector loop."""
    for j in range(terms):
        shift = 1e-3 * j
        for i in range(x.size):
            z = x[i] * x[i] + shift
            top = fma(z, fma(z, fma(z, fma(z, fma(z, 0.1, 0.2), 0.3), 0.4), 0.5), 1.0)
            low = fma(z, fma(z, fma(z, fma(z, fma(z, 0.3, 0.1), 0.2), 0.3), 0.2), 2.0)
            y[i] = fma(top / low, x[i], y[i])


@kernel
def sines(x: Floats, terms: int) -> float:
    """Sum sines and cosines of the mathematical library one after the other: no vector loop."""
    total = 0.0
    for j in range(terms):
        for i in range(x.size):
            total += math.sin(x[i] + j) * math.cos(x[i] - j)
    return total


@kernel
def passages(arguments: tuple[Any, ...], count: int) -> float:
    """Search the same first passage again and again: a call from Python would cost more."""
    total = 0.0
    for _ in range(count):
        h, side = first_passage(*arguments)
        total += h * side
    return total


@kernel
def triangle_time(mu: Floats) -> float:
    """Sum the responses to the triangle wave, and the shapes of single modes."""
    total = 0.0
    for i in range(mu.size):
        odd, odd_slope = odd_response(mu[i])
        even, even_slope = even_response(mu[i])
        total += odd + odd_slope + even + even_slope
        total += hyperbolic_sine(mu[i], 0.3) + hyperbolic_cosine(mu[i], 0.3)
    return total


@kernel
def waves(phi: Floats) -> float:
    """Sum the triangular sine and its square wave."""
    total = 0.0
    for i in range(phi.size):
        tau, e = fold(phi[i])
        total += tau * e
    return total


_HERE: Final = "benchmarks.hot"
_KERNELS: Final = "vibroimpact_solvers.kernels"


def references() -> Mapping[str, Watched]:
    """Return the loops that kernels are compared with."""
    some = np.linspace(0.1, 0.9, 64)
    return {
        VECTOR: Watched(_HERE, "polynomials", (some, np.zeros(64), 7000)),
        SCALAR: Watched(_HERE, "sines", (some, 1000)),
    }


def recorded(place: ModuleType, name: str, work: Callable[[], object], **more: Any) -> Watched:
    """Return the first call that some work makes of a kernel, where a solver calls it."""
    found: list[tuple[Any, ...]] = []
    function = getattr(place, name)

    def called(*args: Any) -> Any:
        if not found:
            found.append(tuple(a.copy() if isinstance(a, np.ndarray) else a for a in args))
        return function(*args)

    with mock.patch.object(place, name, called):
        work()
    return Watched(function.__module__, name, found[0], **more)


@cache
def _modes(asked: str, num: int, constraints: int = 1, n: int = 100) -> Callable[[], object]:
    from benchmarks.cases import chain, grid
    from vibroimpact_solvers import impact_modes

    Omega = grid(0.2, 3.0, num)
    tau = np.linspace(0.0, 1.0, 16)
    problem = impact_modes.Problem(
        chain(n, constraints),
        Omega * (2.0 / np.pi),
        outputs=frozenset({asked}),
        Omega=Omega,
        tau=tau,
    )
    return partial(impact_modes.solve, problem, impact_modes.plan(problem))


def _motions(name: str, asked: str, num: int) -> Watched:
    from vibroimpact_solvers.kernels import motions

    return recorded(motions, name, _modes(asked, num))


def _impulse() -> Watched:
    from vibroimpact_solvers.kernels import response

    return recorded(response, "response_one", _modes("impulse", 1024), reference=VECTOR)


def _amplitudes() -> Watched:
    from vibroimpact_solvers.kernels import response

    return recorded(response, "amplitudes_one", _modes("shape", 1024), reference=VECTOR)


def _bordered() -> Watched:
    from vibroimpact_solvers.kernels import families

    return recorded(families, "members", _modes("shape", 256, 2))


def walks(n: int = 100) -> Watched:
    """Return walks along the limits of a chain."""
    from vibroimpact_solvers.kernels import limits

    return recorded(limits, "check", _modes("exists", 128, n=n))


def survey(n: int = 13) -> Watched:
    """Return the search for existence bands of a chain in a small range."""
    from benchmarks.cases import chain
    from vibroimpact_solvers import existence_bands
    from vibroimpact_solvers.kernels import bands

    problem = existence_bands.Problem(chain(n), 1.85, 1.95)
    plan = existence_bands.plan(problem)
    return recorded(bands, "survey", partial(existence_bands.solve, problem, plan))


def _flight(n: int, t_end: float) -> Watched:
    """Return a motion of one mass with loss, or of a chain without."""
    from benchmarks.cases import chain
    from vibroimpact_solvers import presets, time_history
    from vibroimpact_solvers.model import Constraint
    from vibroimpact_solvers.time_history import launcher

    system = chain(n) if n > 1 else presets.oscillator([Constraint.at(0, 1.0, 0.999)], 1.0)
    v = np.random.default_rng(n).standard_normal(n) if n > 1 else np.array([5.0])
    problem = time_history.Problem(system, time_history.State(np.zeros(n), v), t_end)
    plan = time_history.plan(problem)
    return recorded(launcher, "launch", partial(time_history.solve, problem, plan))


def _passages() -> Watched:
    from benchmarks import flights
    from benchmarks.cases import chain
    from vibroimpact_solvers import time_history
    from vibroimpact_solvers.kernels import flight

    state = time_history.State(np.zeros(13), np.random.default_rng(13).standard_normal(13))
    problem = time_history.Problem(chain(13), state, 1.0)
    plan = time_history.plan(problem)
    with flights.counted(Counter()):
        found = recorded(flight, "first_passage", partial(time_history.solve, problem, plan))
    return _own("passages", found.arguments, 2000)


def _history() -> Watched:
    from benchmarks.cases import chain
    from vibroimpact_solvers import time_history
    from vibroimpact_solvers.time_history import run

    v = np.random.default_rng(0).standard_normal(13)
    problem = time_history.Problem(
        chain(13),
        time_history.State(np.zeros(13), v),
        100.0,
        t=np.linspace(0.0, 100.0, 1001),
        outputs=frozenset({"x", "v"}),
    )
    plan = time_history.plan(problem)
    return recorded(run, "fly", partial(time_history.solve, problem, plan))


def _soft() -> Watched:
    from benchmarks.cases import chain
    from vibroimpact_solvers import time_history
    from vibroimpact_solvers.time_history import soft

    state = time_history.State(np.zeros(13), np.ones(13))
    problem = time_history.Problem(
        chain(13), state, 10.0, limiter=time_history.Power(17.0, 1.0), tolerance=1e-9
    )
    plan = time_history.plan(problem)
    return recorded(soft, "follow", partial(time_history.solve, problem, plan))


def slow_flow(place: str, name: str, model: str, variant: str) -> Watched:
    """Return a kernel of a slow flow at ten thousand times."""
    from benchmarks.slow_flows import motions
    from vibroimpact_solvers import slow_flow

    system, initial, end = next(found[1:] for found in motions() if found[0] == model)
    t = np.linspace(0.0, end, 10_000)
    outputs = frozenset({"state", "x", "v"})
    problem = slow_flow.Problem(system, model, variant, initial, t, outputs)
    plan = slow_flow.plan(problem)
    kernels = import_module(f"{_KERNELS}.{place}")
    return recorded(kernels, name, partial(slow_flow.solve, problem, plan))


def _stability(name: str) -> Watched:
    from vibroimpact_solvers import stability

    return recorded(vars(stability)["saltation"], name, _modes("stability", 4), calls=4)


def _own(name: str, *arguments: Any) -> Watched:
    return Watched(_HERE, name, arguments)


HOT: Final[Mapping[str, Callable[[], Watched]]] = {
    "impulse of one constraint": _impulse,
    "members with their motion": _amplitudes,
    "members of two constraints": _bordered,
    "walks along limits": walks,
    "displacements": partial(_motions, "coordinates", "waveform", 64),
    "harmonics": partial(_motions, "fourier", "harmonics", 64),
    "energies": partial(_motions, "energies", "energy", 512),
    "bands": survey,
    "stability, flights": partial(_stability, "fly"),
    "stability, impacts": partial(_stability, "strike"),
    "time history, N=1": partial(_flight, 1, 2000.0),
    "time history, N=13": partial(_flight, 13, 100.0),
    "time history, N=100": partial(_flight, 100, 10.0),
    "time history with samples, N=13": _history,
    "passages": _passages,
    "soft limiters": _soft,
    "slow flow, closed form": partial(
        slow_flow, "lossy_walls", "slow_flow", "restitution", "corrected"
    ),
    "slow flow, impacts of one mass": partial(
        slow_flow, "damped_walls", "flights", "damped", "exact"
    ),
    "slow flow, impacts of two masses": partial(
        slow_flow, "linear_flights", "flights", "two_oscillator", "exact"
    ),
    "responses to triangle waves": partial(
        _own, "triangle_time", np.linspace(-20.0, 900.0, 20_001)
    ),
    "triangle and square waves": partial(_own, "waves", np.linspace(-50.0, 50.0, 200_001)),
}
"""What is watched."""
