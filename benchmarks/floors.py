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
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import Any, Final

import numpy as np

from benchmarks import hot
from benchmarks.cases import chain, grid
from benchmarks.harness import SAMPLE, Work, measure
from benchmarks.loops import (
    ADDITION,
    ARCTANGENT,
    DECAY,
    FOLD,
    GROWTH,
    RESPONSE,
    ROTATION,
    SECANT,
    SHARE,
    SINE,
    TANGENT,
    TURN,
    Floor,
)
from benchmarks.motions import ours
from benchmarks.motions.cases import from_mode
from benchmarks.tables import Goal, Table
from vibroimpact_solvers import spectrum
from vibroimpact_solvers.impact_modes import Problem
from vibroimpact_solvers.impact_modes.family import Family
from vibroimpact_solvers.impact_modes.modal import ModalFamily
from vibroimpact_solvers.kernels import bands, limits, motions, response, taylor

_WITHIN = 3.0
_POINTS = 512
_TIMES = 4  # at which modal coordinates are wanted
_IMPACT = 4  # three evaluations and one advance
_NUMBERS = 1024  # that a floor is measured with
_REPEATS = 20


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
        TANGENT,
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
        SECANT,
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
        SECANT,
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
        SINE,
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
        SECANT,
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
        TURN,
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
        TURN,
        boxes * survey.arguments[0].size,
        "mode and box",
        None,
        "three sums for each box, one number after the other; modes near their poles are bounded "
        "one by one; and every cell lays down coefficients and bounds of all modes before its "
        "first box; with 13 modes a search of 800 boxes takes 0.17 ms, and several times as long "
        "where the system clears memory for 131072 boxes that may wait in every call",
        together=survey.arguments[0].size,
    )


def _harmonics() -> Case:
    found = hot.HOT["harmonics"]()
    roots, _, omega, D, _, orders = found.arguments
    odd = int(np.sum(orders % 2 == 1)) if D.shape[1] else 0
    return Case(
        "harmonics",
        roots.size,
        found,
        SHARE,
        omega.size * roots.size * odd,
        "mode and odd order",
        None,
        "sines of the mathematical library, one after the other, a root for each, and a result "
        "cleared before it is filled in, even orders with it",
    )


def _deviations() -> Iterator[Case]:
    """Yield what stability is made of: deviations through flights and impacts."""
    flight, strike = hot.HOT["stability, flights"](), hot.HOT["stability, impacts"]()
    X = flight.arguments[0]
    yield Case(
        "stability, flights",
        X.shape[0] // 2,
        flight,
        ROTATION,
        flight.calls * X.size / 2,
        "pair of deviations",
        None,
        "the deviations, 0.3 MB with 100 modes, come from beyond the nearest cache, where those of "
        "the floor stay, and are copied for each call measured; sines are few beside them",
    )
    X = strike.arguments[0]
    yield Case(
        "stability, impacts",
        X.shape[0] // 2,
        strike,
        ADDITION,
        2.0 * strike.calls * X.size,
        "deviation, twice",
        None,
        "the deviations, 0.3 MB with 100 modes, come from beyond the nearest cache, where those of "
        "the floor stay, and are copied for each call measured",
    )


def _series() -> Case:
    """Return a motion between soft limiters, by Taylor series."""
    found = hot.HOT["soft limiters"]()
    arguments = [a.copy() if isinstance(a, np.ndarray) else a for a in found.arguments]
    taylor.follow(*arguments)
    F, _, _, levels, _, _, settings, _, _, _, counts, *_ = arguments
    terms = int(settings[2]) + 1
    products = math.floor(math.log2(settings[0])) + int(settings[0]).bit_count() - 1
    each = products * terms * (terms + 1) / 2 * levels.size + 4 * terms * F.shape[1]
    return Case(
        "soft limiters",
        F.shape[1],
        found,
        ADDITION,
        float(counts[0]) * each,
        "product of coefficients in a step",
        None,
        "coefficients follow one another: each sum has few terms, which wait for the last one; "
        "besides, forces are checked at the end of each step, and the state is laid down",
    )


def _flights() -> Iterator[Case]:
    """Yield impacts of slow flows' exact motions: a state found, and a state taken."""
    for name, n, rates, why in (
        (
            "slow flow, impacts of one mass",
            1,
            1,
            "Newton's method takes the same functions anew in each step, one impact after the "
            "other, by the mathematical library",
        ),
        (
            "slow flow, impacts of two masses",
            2,
            4,
            "the first impact is searched in steps, each with its own complex exponentials, so "
            "that none is missed",
        ),
    ):
        found = hot.HOT[name]()
        arguments = [a.copy() if isinstance(a, np.ndarray) else a for a in found.arguments]
        function = getattr(import_module(found.module), found.function)
        impacts = abs(function(*arguments))
        yield Case(name, n, found, DECAY, 2.0 * rates * impacts, "rate, twice an impact", None, why)


def _triangle_time() -> Iterator[Case]:
    responses, waves = hot.HOT["responses to triangle waves"](), hot.HOT[_WAVES]()
    yield Case(
        "responses to triangle waves",
        1,
        responses,
        RESPONSE,
        responses.arguments[0].size,
        "response",
        None,
        "tangents and exponentials of the mathematical library, one after the other, with a case "
        "for every sign; formulas that few numbers pass through",
    )
    yield Case(
        _WAVES,
        1,
        waves,
        FOLD,
        waves.arguments[0].size,
        "phase",
        None,
        "the loop that is watched adds up what it finds, one number after the other; where the "
        "solvers fold phases, in loops of their own, nothing waits for the last one",
    )


_WAVES: Final = "triangle and square waves"


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
        GROWTH,
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
        ARCTANGENT,
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
            TURN,
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
    yield _harmonics()
    yield from _deviations()
    yield from _impacts()
    yield _series()
    yield from _slow_flows()
    yield from _flights()
    yield from _triangle_time()


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
