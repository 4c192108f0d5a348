"""How far hot kernels are from what the hardware allows: the functions they cannot do without.

The floor of a kernel is the time of the functions that it cannot do without, as many of them, by
the fastest vector loop there is on this machine: numpy's, which is Intel's vector library where
there are vectors of 512 bits and one call after the other elsewhere, or the polynomials of
`kernels.phases` alone in a loop, whichever takes less in the same run. Where the result of the
kernel holds a number for each the loops write as many; elsewhere theirs stay in the nearest cache.
Where steps wait for one another the loops take the modes of one step at a time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np

from benchmarks import hot
from benchmarks.cases import chain, grid
from benchmarks.harness import SAMPLE, Work, measure
from benchmarks.motions import ours
from benchmarks.motions.cases import from_mode
from benchmarks.tables import Goal, Table
from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.impact_modes import Problem
from vibroimpact_solvers.impact_modes.family import Family
from vibroimpact_solvers.impact_modes.modal import ModalFamily
from vibroimpact_solvers.kernels import bands, limits, motions, response
from vibroimpact_solvers.kernels.jit import kernel
from vibroimpact_solvers.kernels.phases import sine_cosine, tangent

_WITHIN = 3.0
_POINTS = 512
_TIMES = 4  # at which modal coordinates are wanted
_IMPACT = 4  # three evaluations and one advance
_NUMBERS = 1024  # that a floor is measured with
_REPEATS = 20


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


_TANGENT: Final = Floor(
    "a tangent, with its division", lambda x, out, _: np.tan(x, out=out), _own_tangents
)
_TURN: Final = Floor("a sine and a cosine", _turns, _own_turns)
_SECANT: Final = Floor("a sine, a cosine and a division", _secants, _own_secants)
_SINE: Final = Floor("a sine", lambda x, out, _: np.sin(x, out=out), _own_sines)
_GROWTH: Final = Floor(
    "an exponential, a fourth root, two sines, a cosine and a division", _growths, _own_growths
)
_ARCTANGENT: Final = Floor(
    "an exponential, an inverse tangent, a sine and a cosine", _arctangents, _own_arctangents
)


@dataclass(frozen=True, slots=True)
class Case:
    """A kernel, and what it is compared with.

    Parameters
    ----------
    name : str
    n : int
        Masses.
    work : callable
    floor : Floor
    count : float
        How often its functions are needed.
    each : str
        For each of what.
    call : callable, optional
        The same work for one frequency: what a call costs whatever it is asked.
    why : str
        What there is beside the floor.
    kept : bool
        Whether the result holds a number for each: the floor writes as many, too, instead of
        staying in the nearest cache.
    together : int
        How many are known at a time: the modes of one step, where steps wait for one another.
    """

    name: str
    n: int
    work: Work
    floor: Floor
    count: float
    each: str
    call: Work | None = None
    why: str = ""
    kept: bool = False
    together: int = _NUMBERS


def _family(n: int, constraints: int = 1) -> tuple[ModalFamily, Problem]:
    system, Omega = chain(n, constraints), grid(0.2, 3.0, _POINTS)
    omega = Omega * (2.0 / np.pi)
    problem = Problem(system, omega, outputs=frozenset({"impulse"}), Omega=Omega)
    return ModalFamily(problem, Family.of(problem), spectrum.spectrum(system)), problem


def _families(n: int) -> Iterator[Case]:
    """Yield what impact modes are made of."""
    family, problem = _family(n)
    at, one = problem.frequencies, problem.slice(0, 1).frequencies
    weights, tau = family.rows[0] ** 2, np.linspace(0.0, 1.0, _TIMES)
    _, motion = family.members(at)
    modes = family.roots.size * _POINTS
    impulse = partial(response.response_one, family.roots, family.rests, weights)
    yield Case(
        "impulse of one constraint",
        n,
        partial(impulse, at.omega, at.rests),
        _TANGENT,
        modes,
        "mode",
        partial(impulse, one.omega, one.rests),
        "every tangent comes with the rest of its phase and takes part in three sums, its own "
        "and two of the error",
    )
    yield Case(
        "members with their motion",
        n,
        partial(family.members, at),
        _SECANT,
        modes,
        "mode",
        partial(family.members, one),
        "the response is summed with its error before the motion, whose cosines are taken "
        "anew; memory of the result is new in every call",
        kept=True,
    )

    def energy(frequencies: Any) -> None:
        family.energy(family.members(frequencies)[1])

    yield Case(
        "members with their energy",
        n,
        partial(energy, at),
        _SECANT,
        modes,
        "mode",
        partial(energy, one),
        "the response is summed with its error before the motion, whose cosines are taken "
        "anew; memory of the result is new in every call",
        kept=True,
    )
    some = partial(motions.coordinates, family.roots, family.load)
    yield Case(
        "modal coordinates at 4 times",
        n,
        partial(some, motion.omega, motion.D, motion.U, tau),
        _SINE,
        modes * _TIMES,
        "mode and time",
        partial(some, motion.omega[:1], motion.D[:1], motion.U[:1], tau),
        "phases and products with the amplitudes are loops of their own, and memory of the "
        "result is new in every call",
        kept=True,
    )
    several, problem = _family(n, 2)
    yield Case(
        "members of two constraints",
        n,
        partial(several.members, problem.frequencies),
        _SECANT,
        several.roots.size * _POINTS,
        "mode",
        partial(several.members, problem.slice(0, 1).frequencies),
        "of 100 modes the loop of sines takes a sixth, responses and six sums (three of the "
        "matrix, three of its error) three tenths, the search for modes near their poles, one by "
        "one, a quarter, and the system with its inverse, its error and the motion a quarter; of "
        "13 modes nine tenths are what a frequency costs with however few of them",
        kept=True,
    )


def _walks(n: int) -> Case:
    walks = hot.walks(n)
    steps = limits.check(*walks.arguments)
    return Case(
        "walks along limits",
        n,
        walks,
        _TURN,
        steps * walks.arguments[0].size,
        "mode and step",
        None,
        "walks have few steps, and before the first one there are a root and a division for each "
        "mode, and the sums that bound curvature and error",
        together=walks.arguments[0].size,
    )


def _bands(n: int) -> Case:
    survey = hot.survey(n)
    *_, boxes = bands.survey(*survey.arguments)
    return Case(
        "existence bands",
        n,
        survey,
        _TURN,
        boxes * survey.arguments[0].size,
        "mode and box",
        None,
        "three sums for each box, one number after the other; modes near their poles are bounded "
        "one by one; and every cell lays down coefficients and bounds of all modes before its "
        "first box; with 13 modes a search of 800 boxes takes 0.17 ms, and several times as long "
        "where the system clears memory for 131072 boxes that may wait in every call",
        together=survey.arguments[0].size,
    )


def _slow_flows() -> Iterator[Case]:
    """Yield closed forms, without what the interpreter does around them."""
    damped = hot.slow_flow("damped_walls", "truncated", "damped", "truncated")
    shapes = hot.slow_flow("damped_walls", "elastic_shapes", "damped", "truncated")

    def both() -> None:
        damped()
        shapes()

    yield Case(
        "slow flow, damped, truncated",
        1,
        both,
        _GROWTH,
        shapes.arguments[0].size,
        "time",
        None,
        "36 terms of a series for each time, and exponentials one after the other",
    )
    lossy = hot.HOT["slow flow, closed form"]()
    yield Case(
        "slow flow, restitution, corrected",
        1,
        lossy,
        _ARCTANGENT,
        lossy.arguments[0].size,
        "time",
        None,
        "Newton's method takes the inverse of the inverse tangent integral, an exponential, an "
        "inverse tangent and hyperbolic functions anew in each of two or three steps, one time "
        "after the other",
    )


_IMPACTS: Final = {
    1: "an inverse tangent, a root, divisions and a row of the table, one after the other, where "
    "the floor's sines go side by side",
    13: "the bound below which no wall is reached, an expansion of degree twelve and its first "
    "passage take most of an impact, and all are one number after the other",
    100: "sums of twelve derivatives over all modes keep their order, so that no vectors take "
    "part, and the products of the exact map are taken in two parts",
    1000: "the same as with 100, and the matrix of modes, 8 MB, is read at the start and the end",
}


def _impacts() -> Iterator[Case]:
    """Yield impacts of prepared time histories: three evaluations, one advance."""
    for n, dof, periods in ((1, 0, 500), (13, 5, 500), (100, 49, 250), (1000, 499, 200)):
        top = spectrum.spectrum(chain(n)).largest_frequency
        scene = from_mode(n, dof, 1.5 * 2.0 / np.pi * top, periods)
        motion = ours.prepared(scene, estimate=False)
        yield Case(
            "one impact of a time history",
            n,
            motion,
            _TURN,
            _IMPACT * n * len(motion().times),
            "mode, four times an impact",
            None,
            _IMPACTS[n],
            together=n,
        )


def _cases() -> Iterator[Case]:
    for n in (13, 100, 1000):
        yield from _families(n)
    for n in (13, 100):
        yield _walks(n)
        yield _bands(n)
    yield from _slow_flows()
    yield from _impacts()


def floors() -> Table:
    """Time hot kernels and the functions that they cannot do without."""
    rows: list[tuple[Any, ...]] = []
    reasons: dict[str, str] = {}
    for case in _cases():
        numbers = int(case.count) if case.kept else case.together
        repeats = max(1, _REPEATS * _NUMBERS // numbers)
        works: Mapping[str, Work] = {"work": case.work, **case.floor.works(numbers, repeats)}
        if case.call is not None:
            works = {**works, "call": case.call}
        found = measure(rounds=5, sample=SAMPLE, **works)
        each = 1e9 / case.count
        spent = found["work"].processor * each
        least = min(found["library"].processor, found["own"].processor)
        least *= 1e9 / (repeats * numbers)
        what = f"{case.floor.what} for each {case.each}"
        share = None
        if "call" in found:
            share = 100.0 * found["call"].processor / found["work"].processor
        rows.append((case.name, case.n, spent, share, least, spent / least, _WITHIN, what))
        reasons[f"{case.name}, N {case.n}"] = case.why
    return Table(
        "Distance to the hardware",
        (
            "kernel",
            "N",
            "time [ns]",
            "call [%]",
            "floor [ns]",
            "time over floor",
            "goal",
            "the floor is",
        ),
        rows,
        "Time of the processor, one core, for each of what the floor is for, and how much of it a "
        "call for one frequency alone takes, which few modes do not pay for. The floor is the "
        "faster of numpy's loop and of the polynomials alone; where the result holds a number "
        "for each, it writes as many. Divisions belong to it where no mode can do without: of "
        "the tangent, of the motion's amplitude. Impacts are those of a prepared motion without "
        "errors.",
        Goal("time over floor", "goal"),
        reasons=reasons,
    )


TABLES: Final = (floors,)
