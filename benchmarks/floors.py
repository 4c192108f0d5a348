"""How far hot kernels are from what the hardware allows: the transcendental functions alone.

The floor of a kernel is the time of the functions that it cannot do without, as many of them, by
numpy, whose loops are Intel's vector library, or by a plain copy of the memory that it writes.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Final

import numpy as np

from benchmarks.cases import chain, grid
from benchmarks.harness import measure
from benchmarks.tables import Goal, Table
from benchmarks.time_histories import from_mode, ours
from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.impact_modes import Problem
from vibroimpact_solvers.impact_modes.family import Family
from vibroimpact_solvers.impact_modes.modal import ModalFamily
from vibroimpact_solvers.kernels import families, response

_WITHIN = 3.0
_POINTS = 512


def _tangents(x: Floats, out: Floats) -> None:
    np.tan(x, out=out)


def _turns(x: Floats, out: Floats) -> None:
    """Take a sine and a cosine of each."""
    np.sin(x, out=out)
    np.cos(x, out=out)


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
        weights, tau = family.rows[0] ** 2, np.linspace(0.0, 1.0, 4)
        _, motion = family.members(at, with_motion=True)
        angles = np.outer(1.0 / omega, family.roots)
        out = np.empty_like(angles)
        times = np.multiply.outer(angles, tau)
        places = np.empty_like(times)
        impulse = partial(response.response_one, family.roots, family.rests, weights, omega)
        cases: list[tuple[str, Callable[[], object], Callable[[], object], str]] = [
            (
                "impulse of one constraint",
                partial(impulse, at.rests),
                partial(_tangents, angles, out),
                "a tangent for each mode",
            ),
            (
                "members with their motion",
                partial(family.members, at, with_motion=True),
                partial(_turns, angles, out),
                "a sine and a cosine for each mode",
            ),
            (
                "modal coordinates at 4 times",
                partial(
                    families.coordinates, family.roots, family.load, omega, motion.D, motion.U, tau
                ),
                partial(np.sin, times, out=places),
                "a sine for each mode and time",
            ),
        ]
        for name, work, floor, what in cases:
            found = measure(rounds=5, work=work, floor=floor)
            each = 1e6 / (_POINTS * heard)
            kernel, least = found["work"].processor * each, found["floor"].processor * each
            rows.append((name, n, kernel * 1e3, least * 1e3, kernel / least, _WITHIN, what))
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
        "Time of the processor, one core. Members with their motion are solved one after the "
        "other, each sum with its error and the search for modes near a pole, by the scalar "
        "functions of the mathematical library: no vector loop. Impacts include planning and the "
        "natural modes seen by all degrees of freedom, which few impacts of many masses do not "
        "pay for.",
        Goal("time over floor", "goal"),
    )


def _impacts() -> list[tuple[Any, ...]]:
    """Return the same for impacts of time histories: three evaluations and one advance."""
    rows: list[tuple[Any, ...]] = []
    for n, dof, factor, periods in ((13, 5, 1.5, 100), (100, 49, 1.5, 50), (1000, 499, 1.5, 5)):
        top = spectrum.spectrum(chain(n)).largest_frequency
        system, scene, _ = from_mode(n, dof, factor * 2.0 / np.pi * top, periods)
        impacts = max(1, len(ours(system, scene).times))
        x = np.linspace(0.1, 3.0, n)
        out = np.empty(n)

        def floor(x: Floats = x, out: Floats = out) -> None:
            for _ in range(4):
                _turns(x, out)

        found = measure(rounds=3, work=partial(ours, system, scene), floor=floor)
        each = found["work"].processor * 1e9 / (impacts * n)
        least = found["floor"].processor * 1e9 / n
        what = "a sine and a cosine for each mode, four times an impact"
        rows.append(("one impact of a time history", n, each, least, each / least, _WITHIN, what))
    return rows


TABLES: Final = (floors,)
