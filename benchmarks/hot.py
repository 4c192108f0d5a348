"""The watched kernels, with arguments as the solvers give them.

To watch another one: add a line to `HOT`, and ``python -m benchmarks.guard --usual`` stores what
is usual for it. Solvers are imported where they are called: under valgrind, where every import
takes seconds, only the kernels are loaded.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from importlib import import_module
from types import ModuleType
from typing import Any, Final
from unittest import mock

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels import threads
from vibroimpact_solvers.kernels.jit import kernel
from vibroimpact_solvers.kernels.triangle_time import (
    antisymmetric_response,
    hyperbolic_cosine,
    hyperbolic_sine,
    symmetric_response,
)


@dataclass(frozen=True, slots=True)
class Watched:
    """A watched kernel and what it is called with.

    Parameters
    ----------
    module, function : str
        Where it is.
    arguments : tuple
        Arrays are copied before the call: kernels write into theirs.
    calls : int
        How often it is called in one go.
    """

    module: str
    function: str
    arguments: tuple[Any, ...]
    calls: int = 1

    def __call__(self) -> Any:
        """Call it; return what the last call returns."""
        for _ in range(self.calls):
            result, _ = self.result()
        return result

    def result(self) -> tuple[Any, tuple[Any, ...]]:
        """Call it once; return what it returns, and its arguments, which it may have filled."""
        copies = tuple(map(_copied, self.arguments))
        function = getattr(import_module(self.module), self.function)
        return function(*copies), copies


def _copied(argument: Any) -> Any:
    """Return an argument of a kernel, its arrays copied, those of tuples as well."""
    if isinstance(argument, tuple):
        parts = map(_copied, argument)
        return type(argument)(*parts) if hasattr(argument, "_fields") else tuple(parts)
    if isinstance(argument, np.ndarray) and argument.dtype.names is not None:
        # Rows of several types are copied number by number, bytes are not.
        return argument.view(np.uint8).copy().view(argument.dtype)
    return argument.copy() if hasattr(argument, "copy") else argument


@kernel
def triangle_time(mu: Floats) -> float:
    """Sum the responses to the triangle wave, and the shapes of single modes."""
    total = 0.0
    for i in range(mu.size):
        odd, odd_slope = antisymmetric_response(mu[i])
        even, even_slope = symmetric_response(mu[i])
        total += odd + odd_slope + even + even_slope
        total += hyperbolic_sine(mu[i], 0.3) + hyperbolic_cosine(mu[i], 0.3)
    return total


_KERNELS: Final = "vibroimpact_solvers.kernels"
_WHOLE: Final = 2**60


def recorded(
    place: ModuleType, name: str, work: Callable[[], object], calls: int = 1, which: int = 0
) -> Watched:
    """Return a call that some work makes of a kernel, the first one for `which` = 0.

    The work is done by one thread: pieces of several would come in any order. A motion is one
    piece, however long it is.
    """
    from vibroimpact_solvers.time_history import run, soft

    seen: list[tuple[Any, ...]] = []
    function = getattr(place, name)

    def called(*args: Any) -> Any:
        if len(seen) <= which:
            seen.append(tuple(map(_copied, args)))
        return function(*args)

    with (
        mock.patch.object(place, name, called),
        mock.patch.object(threads, "cores", return_value=1),
        mock.patch.object(run, "WORK", _WHOLE),
        mock.patch.object(soft, "WORK", _WHOLE),
    ):
        work()
    return Watched(function.__module__, name, seen[which], calls)


def _kernel(place: str, name: str, work: Callable[[], object], which: int = 0) -> Watched:
    """Return a call of a kernel where its module is looked up, ``place`` inside the kernels."""
    return recorded(import_module(f"{_KERNELS}.{place}"), name, work, which=which)


def _solved(solver: ModuleType, problem: Any) -> Callable[[], object]:
    return partial(solver.solve, problem, solver.plan(problem))


@cache
def _modes(output: str, num: int, constraints: int = 1, n: int = 100) -> Callable[[], object]:
    """Return the solution for impact modes of a chain, planned beforehand."""
    from benchmarks.cases import chain, grid
    from vibroimpact_solvers import impact_modes

    Omega = grid(0.2, 3.0, num)
    omega, tau = Omega * (2.0 / np.pi), np.linspace(0.0, 1.0, 16)
    system, outputs = chain(n, constraints), frozenset({output})
    problem = impact_modes.Problem(system, omega, outputs=outputs, Omega=Omega, tau=tau)
    return _solved(impact_modes, problem)


def path_check(n: int = 100) -> Watched:
    """Return the check of paths along the limits of a chain."""
    return _kernel("path_check", "check", _modes("exists", 128, n=n))


def survey(n: int = 13) -> Watched:
    """Return the search for existence bands of a chain, in one of the intervals between poles.

    The first one is narrow and soon decided; the second one takes 814 boxes with 13 masses.
    """
    from benchmarks.cases import chain
    from vibroimpact_solvers import existence_bands

    problem = existence_bands.Problem(chain(n), 1.85, 1.95)
    return _kernel("bands", "survey", _solved(existence_bands, problem), which=1)


def _motion(system: Any, v: Any, t_end: float, **more: Any) -> Callable[[], object]:
    """Return the solution for a time history from x = 0."""
    from vibroimpact_solvers import time_history

    state = time_history.State(np.zeros(system.n), v)
    return _solved(time_history, time_history.Problem(system, state, t_end, **more))


def _chain_motion(n: int, t_end: float, seed: int, **more: Any) -> Callable[[], object]:
    from benchmarks.cases import chain

    v = np.random.default_rng(seed).standard_normal(n)
    return _motion(chain(n), v, t_end, **more)


def _launch(n: int, t_end: float) -> Watched:
    """Return a motion of one mass with loss, or of a chain without."""
    from vibroimpact_solvers import presets
    from vibroimpact_solvers.model import Constraint
    from vibroimpact_solvers.time_history import rigid_motions

    if n > 1:
        return recorded(rigid_motions, "follow", _chain_motion(n, t_end, n))
    system = presets.oscillator([Constraint.at(0, 1.0, 0.999)], 1.0)
    return recorded(rigid_motions, "follow", _motion(system, np.array([5.0]), t_end))


def _samples(times: int) -> Watched:
    from vibroimpact_solvers.time_history import rigid_motions

    t, outputs = np.linspace(0.0, 100.0, times), frozenset({"x", "v"})
    return recorded(rigid_motions, "follow", _chain_motion(13, 100.0, 0, t=t, outputs=outputs))


def _soft() -> Watched:
    from benchmarks.cases import chain
    from vibroimpact_solvers.time_history import Power, soft

    law = Power(17.0, 1.0)
    work = _motion(chain(13), np.ones(13), 10.0, limiter=law, tolerance=1e-9)
    return recorded(soft, "follow", work)


def _switchings() -> Watched:
    """Return a motion of a chain with two linear stops, whose scenes are prepared beforehand."""
    from vibroimpact_solvers import presets
    from vibroimpact_solvers.laws import Linear
    from vibroimpact_solvers.model import Constraint
    from vibroimpact_solvers.time_history.stops import motion

    stops = [Constraint((dof,), (1.0,), 0.2, 0.2, law=Linear(100.0, 0.3)) for dof in (4, 8)]
    v, outputs = np.random.default_rng(3).standard_normal(13), frozenset({"x", "contacts"})
    work = _motion(presets.chain(13, stops), v, 20.0, t=np.linspace(2.0, 20.0, 10), outputs=outputs)
    work()
    with mock.patch.object(motion, "WORK", _WHOLE):
        return recorded(motion, "follow", work)


def slow_flow(place: str, name: str, model: str, variant: str) -> Watched:
    """Return a kernel of a slow flow at ten thousand times."""
    from benchmarks.error_against_time.slow_flows import motions
    from vibroimpact_solvers import slow_flow

    system, initial, end = next(motion[1:] for motion in motions() if motion[0] == model)
    t, outputs = np.linspace(0.0, end, 10_000), frozenset({"state", "x", "v"})
    problem = slow_flow.Problem(system, model, variant, initial, t, outputs)
    return _kernel(place, name, _solved(slow_flow, problem))


def _stability(name: str) -> Watched:
    from vibroimpact_solvers.stability import period_map

    # Of two constraints: those of one need no map.
    return recorded(vars(period_map)["saltation"], name, _modes("stability", 4, 2), calls=4)


def _of_modes(place: str, name: str, output: str, num: int, constraints: int = 1) -> Watched:
    return _kernel(place, name, _modes(output, num, constraints))


HOT: Final[Mapping[str, Callable[[], Watched]]] = {
    "impulse of one constraint": partial(_of_modes, "response", "response_one", "impulse", 1024),
    "motion of one constraint": partial(_of_modes, "response", "amplitudes_one", "shape", 1024),
    "motion of two constraints": partial(_of_modes, "families", "solutions", "shape", 256, 2),
    "certified path check": path_check,
    "displacements": partial(_of_modes, "motions", "coordinates", "waveform", 64),
    "harmonics": partial(_of_modes, "motions", "fourier", "harmonics", 64),
    "energies": partial(_of_modes, "motions", "energies", "energy", 512),
    "existence bands": survey,
    "stability, free motion": partial(_stability, "advance"),
    "stability, impacts": partial(_stability, "strike"),
    "stability, zeros": partial(_of_modes, "secular", "find", "stability", 4),
    "time history, N=1": partial(_launch, 1, 2000.0),
    "time history, N=13": partial(_launch, 13, 100.0),
    "time history, N=100": partial(_launch, 100, 10.0),
    "time history with 10 samples, N=13": partial(_samples, 10),
    "time history with samples, N=13": partial(_samples, 1001),
    "linear stops, N=13": _switchings,
    "soft limiters": _soft,
    "slow flow, closed form": partial(
        slow_flow, "lossy_walls", "slow_flow", "restitution", "corrected"
    ),
    "slow flow, impacts of one mass": partial(
        slow_flow, "damped_walls", "impacts", "damped", "exact"
    ),
    "slow flow, impacts of two masses": partial(
        slow_flow, "elastic_walls", "impacts", "two_oscillator", "exact"
    ),
    "responses to triangle waves": partial(
        Watched, "benchmarks.hot", "triangle_time", (np.linspace(-20.0, 900.0, 20_001),)
    ),
}
"""The kernels that the guard watches, by name."""
