"""How far hot kernels are from what the hardware allows: the transcendental functions alone.

The floor of a kernel is the time of the functions that it cannot do without, as many of them, by
the fastest vector loop there is on this machine: numpy's, which is Intel's vector library where
there are vectors of 512 bits and one call after the other elsewhere, or the polynomials of
`kernels.phases` alone in a loop, whichever takes less in the same run.
"""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import numpy as np

from benchmarks.cases import chain, grid
from benchmarks.harness import Timing, Work, measure
from benchmarks.motions import ours
from benchmarks.motions.cases import from_mode
from benchmarks.tables import Goal, Table
from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.impact_modes import Problem
from vibroimpact_solvers.impact_modes.family import Family
from vibroimpact_solvers.impact_modes.modal import ModalFamily
from vibroimpact_solvers.kernels import motions, response
from vibroimpact_solvers.kernels.jit import kernel
from vibroimpact_solvers.kernels.phases import sine_cosine, tangent

_WITHIN = 3.0
_POINTS = 512
_TIMES = 4  # at which modal coordinates are wanted
_IMPACT = 4  # three evaluations and one advance
_REPEATS = 1000


def _tangents(x: Floats, out: Floats) -> None:
    np.tan(x, out=out)


def _turns(x: Floats, out: Floats) -> None:
    """Take a sine and a cosine of each."""
    np.sin(x, out=out)
    np.cos(x, out=out)


@kernel
def _own_tangents(x: Floats, out: Floats) -> None:
    for i in range(x.size):
        out[i] = tangent(x[i], 0.0)


@kernel
def _own_turns(x: Floats, sines: Floats, cosines: Floats, repeats: int) -> None:
    for _ in range(repeats):
        for i in range(x.size):
            sines[i], cosines[i] = sine_cosine(x[i], 0.0)


@kernel
def _own_sines(x: Floats, out: Floats) -> None:
    for i in range(x.size):
        out[i] = sine_cosine(x[i], 0.0)[0]


def _over(found: dict[str, Timing], repeats: int = 1) -> tuple[float, float]:
    """Return the time of the kernel and that of the faster of the two floors, seconds."""
    least = min(found["numpy"].processor, found["own"].processor)
    return found["work"].processor, least / repeats


def floors() -> Table:
    """Time hot kernels and the functions that they cannot do without."""
    rows: list[tuple[Any, ...]] = []
    for n in (13, 100, 1000):
        system = chain(n)
        Omega = grid(0.2, 3.0, _POINTS)
        omega = Omega * (2.0 / np.pi)
        problem = Problem(system, omega, outputs=frozenset({"impulse"}), Omega=Omega)
        family = ModalFamily(problem, Family.of(problem), spectrum.spectrum(system))
        at, heard = problem.frequencies, family.roots.size
        weights, tau = family.rows[0] ** 2, np.linspace(0.0, 1.0, _TIMES)
        _, motion = family.members(at, with_motion=True)
        angles = np.outer(1.0 / omega, family.roots).ravel()
        out, other = np.empty((2, angles.size))
        times = np.multiply.outer(angles, tau).ravel()
        places = np.empty_like(times)
        impulse = partial(response.response_one, family.roots, family.rests, weights, omega)
        cases: list[tuple[str, Work, Work, Work, str]] = [
            (
                "impulse of one constraint",
                partial(impulse, at.rests),
                partial(_tangents, angles, out),
                partial(_own_tangents, angles, out),
                "a tangent for each mode",
            ),
            (
                "members with their motion",
                partial(family.members, at, with_motion=True),
                partial(_turns, angles, out),
                partial(_own_turns, angles, out, other, 1),
                "a sine and a cosine for each mode",
            ),
            (
                "modal coordinates at 4 times",
                partial(
                    motions.coordinates, family.roots, family.load, omega, motion.D, motion.U, tau
                ),
                partial(np.sin, times, out=places),
                partial(_own_sines, times, places),
                "a sine for each mode and time",
            ),
        ]
        for name, work, library, own, what in cases:
            spent, least = _over(measure(rounds=5, work=work, numpy=library, own=own))
            each = 1e9 / (_POINTS * heard)
            rows.append((name, n, spent * each, least * each, spent / least, _WITHIN, what))
    rows += _impacts()
    return Table(
        "Distance to the hardware",
        (
            "kernel",
            "N",
            "time [ns/mode]",
            "floor [ns/mode]",
            "time over floor",
            "goal",
            "the floor is",
        ),
        rows,
        "Time of the processor, one core. The floor is the faster of numpy's loop and of the "
        "polynomials alone. Members with their motion: beside the vector loop of sines and "
        "cosines every mode takes four divisions and two roots, one mode after the other, for "
        "its response, that of its derivative and its share of the error; and every frequency "
        "a bordered system with its inverse, which few modes do not pay for. Impacts are those "
        "of a prepared motion without errors: an expansion of degree twelve and its first "
        "passage, both one number after the other, are what few modes do not pay for.",
        Goal("time over floor", "goal"),
    )


def _impacts() -> list[tuple[Any, ...]]:
    """Return the same for impacts of prepared time histories: three evaluations, one advance."""
    rows: list[tuple[Any, ...]] = []
    for n, dof, periods in ((1, 0, 500), (13, 5, 500), (100, 49, 250), (1000, 499, 20)):
        top = spectrum.spectrum(chain(n)).largest_frequency
        scene = from_mode(n, dof, 1.5 * 2.0 / np.pi * top, periods)
        motion = ours.prepared(scene, estimate=False)
        impacts = len(motion().times)
        x = np.linspace(0.1, 3.0, n)
        out, other = np.empty((2, n))

        def library(x: Floats = x, out: Floats = out) -> None:
            for _ in range(_IMPACT * _REPEATS):
                _turns(x, out)

        own = partial(_own_turns, x, out, other, _IMPACT * _REPEATS)
        found = measure(rounds=3, work=motion, numpy=library, own=own)
        spent, least = _over(found, _REPEATS)
        each = 1e9 / n
        what = "a sine and a cosine for each mode, four times an impact"
        name, spent = "one impact of a time history", spent / impacts
        rows.append((name, n, spent * each, least * each, spent / least, _WITHIN, what))
    return rows


TABLES: Final = (floors,)
