"""Time of the kernels that matter over the least that the hardware allows.

The lower bound of a kernel is the time of the functions that it cannot do without, as many of
them, by the fastest vector loop there is on this machine: numpy's, which is Intel's vector library
where there are vectors of 512 bits and one call after the other elsewhere, or the polynomials of
`kernels.phases` alone in a loop, whichever takes less in the same run. Where the result of the
kernel holds a number for each, the loops write as many; elsewhere theirs stay in the nearest
cache. Where steps wait for one another, the loops take the modes of one step at a time.

Only the kernels that requests spend their time in; the others are watched by the guard alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np

from benchmarks import hot
from benchmarks.cases import IMPULSE, chain, grid
from benchmarks.harness import Work, measure
from benchmarks.peers import ours
from benchmarks.peers.cases import from_mode
from benchmarks.tables import Goal, Table
from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.impact_modes import Problem
from vibroimpact_solvers.impact_modes.family import Family
from vibroimpact_solvers.impact_modes.modal import ModalFamily
from vibroimpact_solvers.kernels import response
from vibroimpact_solvers.kernels.jit import kernel
from vibroimpact_solvers.kernels.phases import sine_cosine, tangent

_WITHIN: Final = 3.0
_POINTS: Final = 512
_IMPACT: Final = 4  # three evaluations and one advance
_NUMBERS: Final = 1024  # that a lower bound is measured with
_REPEATS: Final = 20


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
def _own_quotients(x: Floats, out: Floats, other: Floats, repeats: int) -> None:
    for _ in range(repeats):
        for i in range(x.size):
            sine, cosine = sine_cosine(x[i], 0.0)
            out[i] = sine / cosine


def _turns(x: Floats, out: Floats, other: Floats) -> None:
    np.sin(x, out=out)
    np.cos(x, out=other)


def _quotients(x: Floats, out: Floats, other: Floats) -> None:
    _turns(x, out, other)
    np.divide(out, other, out=out)


class Functions(NamedTuple):
    """Functions that a kernel cannot do without: numpy's loop over them, and ours.

    Both take numbers and room for two results, ours also how often to do it.
    """

    name: str
    library: Callable[[Floats, Floats, Floats], object]
    own: Callable[[Floats, Floats, Floats, int], object]

    def works(self, numbers: int, repeats: int) -> dict[str, Any]:
        """Return both, over the same numbers."""
        x = np.linspace(0.1, 30.0, numbers)
        out, other = np.empty((2, numbers))

        def library() -> None:
            for _ in range(repeats):
                self.library(x, out, other)

        return {"library": library, "own": partial(self.own, x, out, other, repeats)}


_TANGENT: Final = Functions(
    "a tangent, with its division", lambda x, out, _: np.tan(x, out=out), _own_tangents
)
_TURN: Final = Functions("a sine and a cosine", _turns, _own_turns)
_QUOTIENT: Final = Functions("a sine, a cosine and a division", _quotients, _own_quotients)


@dataclass(frozen=True, slots=True)
class Case:
    """A kernel, and what it is compared with.

    Parameters
    ----------
    name : str
    n : int
        Masses.
    work : callable
    functions : Functions
    count : float
        How often they are needed.
    each : str
        For each of what.
    kept : bool
        Whether the result holds a number for each.
    together : int
        How many are known at a time: the modes of one step, where steps wait for one another.
    """

    name: str
    n: int
    work: Work
    functions: Functions
    count: float
    each: str
    kept: bool = False
    together: int = _NUMBERS

    def row(self) -> tuple[Any, ...]:
        """Return its row of the table."""
        numbers = int(self.count) if self.kept else self.together
        repeats = max(1, _REPEATS * _NUMBERS // numbers)
        timings = measure(rounds=5, work=self.work, **self.functions.works(numbers, repeats))
        time = 1e9 / self.count * timings["work"].processor
        least = min(timings["library"].processor, timings["own"].processor)
        bound = 1e9 / (repeats * numbers) * least
        what = f"{self.functions.name} for each {self.each}"
        return self.name, self.n, time, bound, time / bound, _WITHIN, what


def _family(n: int, constraints: int = 1) -> tuple[ModalFamily, Problem]:
    system, Omega = chain(n, constraints), grid(0.2, 3.0, _POINTS)
    problem = Problem(system, Omega * (2.0 / np.pi), outputs=IMPULSE, Omega=Omega)
    return ModalFamily(problem, Family.of(problem), spectrum.spectrum(system)), problem


def _families(n: int) -> Iterator[Case]:
    """Yield what impact modes are made of."""
    family, problem = _family(n)
    at, modes = problem.frequencies, family.roots.size * _POINTS
    weights = family.rows[0] ** 2
    one = partial(
        response.response_one, family.roots, family.rounding, weights, at.omega, at.rounding
    )
    yield Case("impulse of one constraint", n, one, _TANGENT, modes, "mode")
    motion = partial(family.solutions, at)
    yield Case("motion of one constraint", n, motion, _QUOTIENT, modes, "mode", kept=True)
    several, problem = _family(n, 2)
    modes, motion = several.roots.size * _POINTS, partial(several.solutions, problem.frequencies)
    yield Case("motion of two constraints", n, motion, _QUOTIENT, modes, "mode", kept=True)


def _searches(n: int) -> Iterator[Case]:
    """Yield the check of paths along limits, and the search for bands."""
    check, survey = hot.path_check(n), hot.survey(n)
    modes = check.arguments[0].roots.size
    steps, boxes = check(), survey().boxes
    each = "mode and step"
    yield Case("certified path check", n, check, _TURN, steps * modes, each, together=modes)
    modes, each = survey.arguments[0].root.size, "mode and box"
    yield Case("existence bands", n, survey, _TURN, boxes * modes, each, together=modes)


def _impact(n: int, dof: int, periods: int) -> Case:
    """Return impacts of prepared time histories: three evaluations, one advance."""
    top = spectrum.spectrum(chain(n)).largest_frequency
    motion = ours.prepared(from_mode(n, dof, 1.5 * 2.0 / np.pi * top, periods), estimate=False)
    count, each = _IMPACT * n * len(motion().times), "mode, four times an impact"
    return Case("one impact of a time history", n, motion, _TURN, count, each, together=n)


def _cases() -> Iterator[Case]:
    for n in (13, 100, 1000):
        yield from _families(n)
    for n in (13, 100):
        yield from _searches(n)
    for impact in ((1, 0, 500), (13, 5, 500), (100, 49, 250), (1000, 499, 200)):
        yield _impact(*impact)


_BESIDE: Final = {
    "impulse of one constraint": "every tangent comes with the rest of its phase and takes part "
    "in three sums, its own and two of the error",
    "motion of one constraint": "the response is summed with its error before the motion, whose "
    "cosines are taken anew; memory of the result is new in every call",
    "motion of two constraints": "of 100 modes the loop of sines takes a sixth, responses and six "
    "sums (three of the matrix, three of its error) three tenths, the search for modes near their "
    "poles, one by one, a quarter, and the system with its inverse, its error and the motion a "
    "quarter; of 13 modes nine tenths are what a frequency costs with however few of them",
    "certified path check": "paths have few steps, and before the first one there are a root and "
    "a division for each mode, and the sums that bound curvature and error",
    "existence bands": "three sums for each box, one number after the other; modes near their "
    "poles are bounded one by one; and every cell lays down coefficients and bounds of all modes "
    "before its first box; with 13 modes a search of 800 boxes takes 0.17 ms, and several times "
    "as long where the system clears memory for 131072 boxes that may wait in every call",
    "one impact of a time history": "with one mass, an inverse tangent, a root and divisions, one "
    "after the other; with more, the bound below which no wall is reached, an expansion of degree "
    "twelve and its first passage, all one number after the other, and sums of derivatives that "
    "keep their order, so that no vectors take part",
}
"""What the kernels do beside the lower bound."""


def bounds() -> Table:
    """Time six kernels, and the functions that they cannot do without."""
    rows: list[tuple[Any, ...]] = []
    reasons: dict[str, str] = {}
    for case in _cases():
        rows.append(case.row())
        reasons[f"{case.name}, N {case.n}"] = _BESIDE[case.name]
    return Table(
        "Time over the lower bound of the hardware",
        (
            "kernel",
            "N",
            "time [ns]",
            "lower bound [ns]",
            "time over lower bound",
            "goal",
            "the lower bound is",
        ),
        rows,
        "Time of the processor, one core, for each of what the lower bound is for. The bound is "
        "the faster of numpy's loop and of the polynomials alone; where the result holds a number "
        "for each, it writes as many. Divisions belong to it where no mode can do without: of "
        "the tangent, of the motion's amplitude. Impacts are those of a prepared motion without "
        "errors.",
        Goal("time over lower bound", "goal"),
        reasons=reasons,
    )
